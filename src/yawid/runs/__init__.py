"""The runs that a user starts: a replay, an inspection, a live session and others, a file each."""
