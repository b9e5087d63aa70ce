"""What is measured: each bench is a module here, started by tools/bench.py NAME."""
