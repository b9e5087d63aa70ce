"""How the cases of replay_logs/ are made, and what compares two commits on them."""
