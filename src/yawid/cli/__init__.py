"""Arguments to runs, errors to one line and an exit code."""
