"""The recipes of the cases in replay_logs/, and what runs them."""
