"""Flight-test records that never were MAVLink: CSV and Parquet with a column for each channel."""
