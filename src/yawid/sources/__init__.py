"""The sources: bytes from a log or a link, and the MAVLink messages in them."""
