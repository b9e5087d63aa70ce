"""Runs a bench: python tools/bench.py NAME [options] [--readme]; see bench/frame.py."""

import sys

from bench.frame import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
