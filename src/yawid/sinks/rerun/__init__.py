"""A run as a Rerun recording, in a file or in the viewer."""
