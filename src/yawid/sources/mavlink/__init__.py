"""MAVLink's wire format, for files and links alike."""
