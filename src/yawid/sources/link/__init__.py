"""Live taps."""
