"""Output for a person at a terminal: tables, the live screen, progress, the test card."""
