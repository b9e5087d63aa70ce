"""Headless regression: recorded logs replayed and compared with their references.

A case is a folder with log.tlog, case.toml (origin, licence, sha256, floor, options, tolerances),
and the references expected.csv and expected.json. Only ``update`` writes references, and it wants a
reason.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from yawid.errors import ConfigError
from yawid.golden import (
    NOT_COMPARED,
    RowsSink,
    compare_summaries,
    compare_tables,
    read_csv,
    write_csv,
)
from yawid.outputs import versions
from yawid.pipeline import Pipeline
from yawid.run_config import RunConfig, check_settings
from yawid.sources.tlog import read_tlog
from yawid.summary import summarise

_KEYS = {
    "origin": str,
    "licence": str,
    "sha256": str,
    "floor": int,
    "options": dict,
    "tolerances": dict,
    "updates": list,
}


@dataclass(frozen=True, slots=True)
class Case:
    """One case as its case.toml describes it; ``floor`` is the least number of updates."""

    folder: Path
    sha256: str
    floor: int
    config: RunConfig
    tolerances: Mapping[str, float]

    @staticmethod
    def read(folder: Path) -> Case:
        """Read a case.

        Raises:
            ConfigError: there is none, or its case.toml is not one.
        """
        path = folder / "case.toml"
        try:
            loaded = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise ConfigError(f"{path}: not a readable case: {error}") from error
        for key, value in loaded.items():
            if key not in _KEYS or not isinstance(value, _KEYS[key]):
                raise ConfigError(f"{path}: {key} is not a key of a case, or of the wrong type")
        if missing := {"origin", "licence", "sha256"} - loaded.keys():
            raise ConfigError(f"{path}: {', '.join(sorted(missing))} missing")
        config = RunConfig(**check_settings(loaded.get("options", {}), str(path)))
        tolerances = loaded.get("tolerances", {})
        return Case(folder, loaded["sha256"], loaded.get("floor", 1), config, tolerances)


def find_cases(folder: Path, names: Sequence[str]) -> list[Case]:
    """Return the cases named, by folder or by name below ``folder``; all of them where none is.

    Raises:
        ConfigError: there is no such case, or none at all.
    """
    if names:
        paths = [Path(n) if (Path(n) / "case.toml").exists() else folder / n for n in names]
    else:
        paths = sorted(path.parent for path in folder.glob("*/case.toml"))
    if not paths:
        raise ConfigError(f"{folder}: no case there (a case is a folder with a case.toml)")
    return [Case.read(path) for path in paths]


def run_case(case: Case) -> tuple[RowsSink, dict[str, Any]]:
    """Replay a case's log; return its rows and its summary as JSON gives it back."""
    rows = RowsSink()
    pipeline = Pipeline(case.config, [rows])
    digest = hashlib.sha256()
    for chunk in read_tlog(case.folder / "log.tlog", digest=digest):
        pipeline.feed(chunk)
    pipeline.finish()
    summary, _ = summarise(pipeline, "log.tlog", digest.hexdigest())
    rows.finish(summary, {})
    kept = {key: value for key, value in summary.items() if key not in NOT_COMPARED}
    loaded: dict[str, Any] = json.loads(json.dumps(kept))
    return rows, loaded


def check_case(case: Case) -> list[str]:
    """Return what is wrong with a case, worst first; nothing where it matches its references."""
    rows, summary = run_case(case)
    wrong = []
    if summary["sha256"] != case.sha256:
        wrong.append(f"log.tlog is not the log of the case: sha256 {summary['sha256']}")
    updates = max((e["updates"] for e in summary.get("estimates", {}).values()), default=0)
    if updates < case.floor:
        wrong.append(f"{updates} updates, below the floor of {case.floor}")
    try:
        columns, expected = read_csv(case.folder / "expected.csv")
        reference = json.loads((case.folder / "expected.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        return [*wrong, f"no readable reference: {error}"]
    # The reference went through text; so does what it is compared with.
    actual = np.array([[float(f"{v:.9g}") for v in row] for row in rows.rows])
    actual = actual.reshape(len(rows.rows), len(rows.columns))
    mismatches = compare_tables(columns, expected, rows.columns, actual, case.tolerances)
    wrong += [mismatch.text for mismatch in mismatches]
    wrong += compare_summaries(reference, summary)
    if wrong:
        write_csv(case.folder / "actual.csv", rows.columns, rows.rows)
    return wrong


def regress(folder: Path, names: Sequence[str], say: Callable[[str], None]) -> int:
    """Replay cases and compare; return 0 where all match, else 1."""
    failed = 0
    for case in find_cases(folder, names):
        wrong = check_case(case)
        failed += bool(wrong)
        say(f"{'FAILED' if wrong else 'ok':>6}  {case.folder.name}")
        for line in wrong:
            say(f"        {line}")
        if wrong:
            say(f"        actual rows in {case.folder / 'actual.csv'}; if the change is meant:")
            say(f'        yawid regress --update --why "..." {case.folder}')
    return 1 if failed else 0


def update(folder: Path, names: Sequence[str], why: str, say: Callable[[str], None]) -> int:
    """Write the references of cases anew, and into case.toml when, why and by which versions."""
    if not why.strip():
        raise ConfigError("--why must give a reason")
    for case in find_cases(folder, names):
        rows, summary = run_case(case)
        write_csv(case.folder / "expected.csv", rows.columns, rows.rows)
        text = json.dumps(summary, indent=1) + "\n"
        (case.folder / "expected.json").write_text(text, encoding="utf-8")
        used = ", ".join(f"{name} {number}" for name, number in versions().items())
        with (case.folder / "case.toml").open("a", encoding="utf-8") as stream:
            stream.write(
                f"\n[[updates]]\ndate = {datetime.now(UTC):%Y-%m-%d}\n"
                f"why = {json.dumps(why)}\nversions = {json.dumps(used)}\n"
            )
        say(f"updated  {case.folder.name}")
    return 0
