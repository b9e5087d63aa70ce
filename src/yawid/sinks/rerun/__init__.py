"""The run in the Rerun viewer."""
