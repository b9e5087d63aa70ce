"""Flies an aircraft of JSBSim, and writes the log and its truth: see flights/command.py."""

import sys

from flights.command import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
