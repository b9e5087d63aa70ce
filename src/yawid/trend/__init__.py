"""Finds what changed in a vehicle's numbers over its flights, or between runs and data sets."""

SEVERAL = "several_aircraft"
"""The warning that only a trend has; it stands here, as what explains it needs no tables."""
