"""Makes the logs of replay_logs/ again: every case by its recipe, the same bytes each time.

    python tools/make_cases.py                    # every case whose sources are available
    python tools/make_cases.py c172p_vtail --folder /tmp/cases
    python tools/make_cases.py --check            # make them, compare, write nothing

Most logs are flights of JSBSim (tools/fly_jsbsim.py), some changed by tools/flights/surgery.py;
those named sitl_ are cut out of recorded flights (--flights DIR). This does not write references:
see ``yawid regress --update``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flights.fly import Made

from cases.recipes import RECIPES, Recipe

ROOT = Path(__file__).resolve().parents[2]
MOST_BYTES = 1_000_000


def write(name: str, recipe: Recipe, made: Made, folder: Path) -> None:
    """Write a case's log, truth and case.toml; keep the tolerances and updates of case.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "log.tlog").write_bytes(made.log)
    if made.truth is not None:
        text = json.dumps(_with_command(name, made.truth), indent=1) + "\n"
        (folder / "truth.json").write_text(text, encoding="utf-8")
    path = folder / "case.toml"
    rest = _kept(path.read_text(encoding="utf-8")) if path.exists() else ""
    path.write_text(_header(recipe, made) + rest, encoding="utf-8")


def _with_command(name: str, truth: dict[str, Any]) -> dict[str, Any]:
    """Return the truth with the command that makes the case, unless it already has one."""
    return (
        truth if "command" in truth else truth | {"command": f"python tools/make_cases.py {name}"}
    )


def _header(recipe: Recipe, made: Made) -> str:
    pinned = recipe.pinned.items()
    options = "".join(f"{key} = {json.dumps(value)}\n" for key, value in pinned)
    return (
        f"origin = {json.dumps(recipe.origin)}\nlicence = {json.dumps(recipe.licence)}\n"
        f'sha256 = "{hashlib.sha256(made.log).hexdigest()}"\nfloor = {recipe.floor}\n'
        + (f"\n[options]\n{options}" if options else "")
    )


def _kept(text: str) -> str:
    """Return what follows the options in a case.toml: tolerances and the history of updates."""
    tables = [text.find(f"\n{mark}") for mark in ("[tolerances]", "[[updates]]")]
    starts = [at for at in tables if at >= 0]
    return text[min(starts) :] if starts else ""


def make(recipe: Recipe, flights: Path) -> Made:
    """Make a case's log by its recipe.

    Raises:
        ValueError: the log is too large for a case.
    """
    with tempfile.TemporaryDirectory() as scratch:
        made = recipe.make(Path(scratch), flights)
    if len(made.log) >= MOST_BYTES:
        raise ValueError(f"{len(made.log)} bytes: a case's log has less than {MOST_BYTES}")
    return made


def _one(name: str, options: argparse.Namespace) -> bool:
    recipe, folder = RECIPES[name], options.folder / name
    if recipe.recorded and not options.flights.is_dir():
        print(f"left out  {name}: no recorded flights in {options.flights}")
        return True
    made, path = make(recipe, options.flights), folder / "log.tlog"
    same = path.exists() and path.read_bytes() == made.log
    if not options.check:
        write(name, recipe, made, folder)
    print(f"{'same' if same else 'differs':>8}  {name}: {len(made.log)} bytes", flush=True)
    return same or not options.check


def main(argv: Sequence[str]) -> int:
    """Make cases; return 0, or 1 if --check finds that a log differs from the one in the folder."""
    parser = argparse.ArgumentParser(
        prog="make_cases.py", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("names", nargs="*", metavar="CASE", help=f"(all) {', '.join(RECIPES)}")
    parser.add_argument("--folder", type=Path, default=ROOT / "replay_logs")
    parser.add_argument("--flights", type=Path, default=Path("flights"), help="recorded flights")
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    options = parser.parse_args(argv)
    if unknown := set(options.names) - RECIPES.keys():
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    same = [_one(name, options) for name in options.names or RECIPES]
    return 0 if all(same) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
