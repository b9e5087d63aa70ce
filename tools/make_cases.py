"""Makes the logs of replay_logs/ again, as case.toml says: the same bytes each time.

    python tools/make_cases.py                    # every case whose sources are available
    python tools/make_cases.py c172p_vtail
    python tools/make_cases.py --check            # make them, compare, write nothing

The table ``[made]`` of a case.toml says how its log is made: see tools/cases/recipes.py. Most logs
are flights of JSBSim (tools/fly_jsbsim.py), some changed; others are cut out of recorded flights
(--flights DIR), so this also cuts the log of a case in another folder (--cases DIR). Log, checksum
and truth.json are written, but no references: see tests/test_replay_logs.py.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

from cases.recipes import make
from flights.fly import written

CASES = Path(__file__).resolve().parents[1] / "replay_logs"
MOST_BYTES = 1_000_000


def main(argv: Sequence[str]) -> int:
    """Make cases; return 0, or 1 if --check finds that a log is not the one of its case.toml."""
    parser = argparse.ArgumentParser(
        prog="make_cases.py", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("names", nargs="*", metavar="CASE", help="(all)")
    parser.add_argument("--cases", type=Path, default=CASES, help="the folder of the cases")
    parser.add_argument("--flights", type=Path, default=Path("flights"), help="recorded flights")
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    options = parser.parse_args(argv)
    differ = False
    for name in options.names or sorted(x.parent.name for x in options.cases.glob("*/case.toml")):
        folder = options.cases / name
        text = (folder / "case.toml").read_text(encoding="utf-8")
        how = tomllib.loads(text).get("made", {})
        if not how or ("cut" in how and not options.flights.is_dir()):
            print(f"left out  {name}: {'no recorded flights' if how else 'no [made]'}")
            continue
        made = make(how, options.flights)
        assert len(made.log) < MOST_BYTES, f"{len(made.log)} bytes: a case's log has less"
        checksum = f'sha256 = "{hashlib.sha256(made.log).hexdigest()}"'
        print(f"{'same' if checksum in text else 'differs':>8}  {name}", flush=True)
        if options.check:
            differ |= checksum not in text
            continue
        (folder / "log.tlog").write_bytes(made.log)
        text = re.sub(r'^sha256 = "\w*"', checksum, text, count=1, flags=re.MULTILINE)
        (folder / "case.toml").write_text(text, encoding="utf-8")
        if made.truth is not None:
            (folder / "truth.json").write_text(written(made), encoding="utf-8")
    return int(differ)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
