"""Plants with known parameters: the paper's equations 17 to 23, and inputs that excite them."""
