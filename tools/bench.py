"""Benches, each printing a table: python tools/bench.py NAME [options]."""

from __future__ import annotations

import importlib
import sys

BENCHES = (
    "estimator",
    "efficiency",
    "windup",
    "confidence",
    "link",
    "live",
    "replay",
    "aliasing",
    "memory",
)


def main() -> int:
    """Run the bench that is named first; the rest are its options."""
    if len(sys.argv) < 2 or sys.argv[1] not in BENCHES:
        print(f"usage: bench.py {'|'.join(BENCHES)} [options]", file=sys.stderr)
        return 2
    importlib.import_module(f"bench_{sys.argv[1]}").main(sys.argv[2:])
    return 0


if __name__ == "__main__":
    sys.exit(main())
