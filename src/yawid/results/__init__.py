"""The verdict: whether the answer is usable, why not, and what to do about it."""
