"""Methods for a whole record at once: the paper's step responses, its program, and batch fits."""
