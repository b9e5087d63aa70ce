"""Is the answer usable, why not, and what to do."""
