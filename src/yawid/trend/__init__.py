"""Finds what changed in a vehicle's numbers over its flights, or between runs and data sets."""
