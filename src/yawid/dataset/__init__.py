"""Data sets of many runs: their tables, columns and files."""
