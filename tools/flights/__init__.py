"""Flights with a known truth, by JSBSim or made; the logs they leave, and what befalls logs."""
