"""yawid's answers: the structs that ``--json`` prints, an MCAP keeps, and every page shows."""
