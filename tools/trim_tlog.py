"""Cuts a stretch of vehicle time out of a tlog: see flights/trim_tlog.py."""

import sys

from flights.trim_tlog import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
