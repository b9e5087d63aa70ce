"""The benches: each is a module that tools/bench.py NAME runs."""
