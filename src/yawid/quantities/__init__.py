"""What every number is called, its unit and what it says: one table that all outputs read."""
