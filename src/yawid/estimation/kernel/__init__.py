"""The compiled recursion: one private room."""
