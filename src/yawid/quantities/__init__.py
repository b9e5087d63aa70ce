"""The quantities: name, unit and words of every number, in one table that all outputs read."""
