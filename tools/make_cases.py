"""Makes the logs of replay_logs/ again: see cases/make.py."""

import sys

from cases.make import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
