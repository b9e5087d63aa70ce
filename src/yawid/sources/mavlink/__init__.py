"""The wire format, for files and links alike."""
