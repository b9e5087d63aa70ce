"""The readers of recorded files."""
