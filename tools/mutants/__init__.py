"""Small mutants of src/yawid: drawn at random, and run against the tests that reach their line."""
