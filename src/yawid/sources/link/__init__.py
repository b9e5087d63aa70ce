"""Live links: taps that receive, and the only parts that transmit."""
