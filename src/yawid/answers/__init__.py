"""What yawid answers: the structs that are printed with --json, kept in an MCAP, and shown."""
