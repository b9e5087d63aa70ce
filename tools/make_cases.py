"""Makes the logs of replay_logs/ again: every case by its recipe, the same bytes each time.

    python tools/make_cases.py                    # every case whose sources are available
    python tools/make_cases.py c172p_vtail --folder /tmp/cases
    python tools/make_cases.py --check            # make them, compare, write nothing

Most logs are flights of JSBSim (tools/fly_jsbsim.py), some changed by tools/flights/surgery.py;
those named sitl_ are cut out of recorded flights (--flights DIR). A new case needs a recipe, and a
case.toml. This does not write references: see tests/test_replay_logs.py.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from cases.recipes import RECIPES
from flights.fly import Made, written

CASES = Path(__file__).resolve().parents[1] / "replay_logs"
MOST_BYTES = 1_000_000


def write(name: str, made: Made, folder: Path) -> None:
    """Write a case's log and truth, and the log's checksum into its case.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "log.tlog").write_bytes(made.log)
    if made.truth is not None:
        command = {"command": f"python tools/make_cases.py {name}"}  # unless it has another one
        truth = written(Made(made.log, made.truth | command | made.truth))
        (folder / "truth.json").write_text(truth, encoding="utf-8")
    text = (CASES / name / "case.toml").read_text(encoding="utf-8")
    checksum = f'sha256 = "{hashlib.sha256(made.log).hexdigest()}"'
    text = re.sub(r'^sha256 = "\w*"', checksum, text, count=1, flags=re.MULTILINE)
    (folder / "case.toml").write_text(text, encoding="utf-8")


def _one(name: str, options: argparse.Namespace) -> bool:
    if name.startswith("sitl_") and not options.flights.is_dir():
        print(f"left out  {name}: no recorded flights in {options.flights}")
        return True
    made = RECIPES[name](options.flights)
    assert len(made.log) < MOST_BYTES, f"{len(made.log)} bytes: a case's log has less"
    path = options.folder / name / "log.tlog"
    same = path.exists() and path.read_bytes() == made.log
    if not options.check:
        write(name, made, path.parent)
    print(f"{'same' if same else 'differs':>8}  {name}: {len(made.log)} bytes", flush=True)
    return same or not options.check


def main(argv: Sequence[str]) -> int:
    """Make cases; return 0, or 1 if --check finds that a log differs from the one in the folder."""
    parser = argparse.ArgumentParser(
        prog="make_cases.py", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("names", nargs="*", metavar="CASE", help=f"(all) {', '.join(RECIPES)}")
    parser.add_argument("--folder", type=Path, default=CASES)
    parser.add_argument("--flights", type=Path, default=Path("flights"), help="recorded flights")
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    options = parser.parse_args(argv)
    if unknown := set(options.names) - RECIPES.keys():
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    same = [_one(name, options) for name in options.names or RECIPES]
    return 0 if all(same) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
