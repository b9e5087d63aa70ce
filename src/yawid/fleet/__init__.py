"""Replays thousands of logs into one data set of Parquet files, which other programs can read."""
