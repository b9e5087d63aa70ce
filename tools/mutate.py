"""Seeds small defects and checks that the tests notice each: see checks/mutate.py."""

import sys

from checks.mutate import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
