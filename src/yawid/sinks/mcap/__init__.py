"""The MCAP file of a run: writing it, reading it, and recovering a damaged one."""
