"""Flights with a known truth, flown by JSBSim or made up; their logs, and damage to logs."""
