"""Many runs: a data set of thousands of logs, made once, read by anything that reads Parquet."""
