"""Plants with known truth: the paper's equations 17 to 23 and the inputs that excite them."""
