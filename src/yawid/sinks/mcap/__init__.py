"""The run's file: written, read, recovered."""
