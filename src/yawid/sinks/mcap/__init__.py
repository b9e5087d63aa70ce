"""The MCAP file of a run: writing it, reading it, and what is left of a damaged one."""
