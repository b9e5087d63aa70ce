"""The recipes of the cases in replay_logs/."""
