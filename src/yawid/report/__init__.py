"""A finished run to one HTML page."""
