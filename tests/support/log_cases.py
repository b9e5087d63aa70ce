"""A case: a log, the options it is replayed with, and the answers it must give.

It is a folder with the log (log.tlog, .bin or .ulg), ``case.toml`` (origin, licence, sha256, floor,
``[made]``, ``[options]``, ``[flight]``, ``[tolerances]``, ``[[updates]]``) and the references
``expected.csv``, ``expected.json`` and ``flight.json``. Only :func:`update` writes references, and
it needs a reason.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import tomli_w
from case_compare import (
    NOT_COMPARED,
    TableSink,
    compare_summaries,
    compare_tables,
    csv_of,
    read_csv,
    split_tolerances,
)
from matplotlib.figure import Figure

from yawid.blocks import Floats
from yawid.config.run import RunConfig
from yawid.config.settings import check_settings
from yawid.runs.job import open_log, run
from yawid.runs.versions import versions
from yawid.sinks.base import Done
from yawid.sources.formats import FORMATS
from yawid.system.part_file import write_whole

KEYS = {
    "origin": str, "licence": str, "sha256": str, "floor": int, "options": dict, "flight": dict,
    "tolerances": dict, "made": dict, "updates": list,
}  # fmt: skip
ANSWERS = ("exit_code", "verdict", "manoeuvres", "flight", "flights", "bare", "ordinary")
"""The keys of ``flight.json``."""
FLOOR_SHARE = 0.9
"""The part of a first update's samples that each later replay must estimate from."""
ALWAYS, WORST = ("wn", "zeta"), 2
"""What the picture of a difference shows, and how many of the columns that differ most."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """A replay: a row for each second, the summary, and what the options ``flight`` answer."""

    columns: list[str]
    rows: list[list[float]]
    summary: dict[str, Any]
    flown: dict[str, Any]

    @property
    def updates(self) -> int:
        """The largest number of updates of any estimator, 0 where there is none."""
        return max((e["updates"] for e in self.summary.get("estimates", {}).values()), default=0)


@dataclass(frozen=True, slots=True)
class Case:
    """A case as its case.toml describes it; the log is replayed with ``config`` and ``flight``."""

    folder: Path
    settings: Mapping[str, Any]
    config: RunConfig
    flight: RunConfig

    @property
    def log(self) -> Path:
        """The path of the log: the first of log.tlog, log.bin, ... that exists."""
        return next(each for each in (self.folder / f"log{f.suffix}" for f in FORMATS)
                    if each.is_file())  # fmt: skip

    @staticmethod
    def read(folder: Path) -> Case:
        """Read a case; its case.toml has ``KEYS``, of which only origin and licence are needed."""
        path = folder / "case.toml"
        loaded = tomllib.loads(path.read_text(encoding="utf-8"))
        wrong = [k for k, v in loaded.items() if k not in KEYS or not isinstance(v, KEYS[k])]
        assert not wrong, f"{path}: {wrong} are no keys of a case, or of the wrong type"
        assert {"origin", "licence"} <= loaded.keys(), f"{path}: say whose log it is"
        both = (loaded.get(key, {}) for key in ("options", "flight"))
        return Case(folder, loaded, *(RunConfig(**check_settings(e, str(path))) for e in both))

    def replay(self) -> Replayed:
        """Replay the log with the options of the case, and once more with those of ``flight``."""
        rows = TableSink()
        source = open_log(self.log)
        summary = run(source, source.settled(asdict(self.config)), [rows]).conclude()
        rows.take(Done(summary, {}))
        source = open_log(self.log)
        flown = run(source, source.settled(asdict(self.flight))).conclude()
        whole = {"exit_code": flown.exit_code} | flown.to_json()
        kept = {key: whole[key] for key in ANSWERS if key in whole}
        return Replayed(rows.columns, rows.rows, _compared(summary.to_json()),
                        json.loads(json.dumps(kept), object_hook=_compared))  # fmt: skip

    def unsound(self, found: Replayed) -> list[str]:
        """Return why a replay cannot be one of this case: another log, too few updates."""
        own = hashlib.sha256(self.log.read_bytes()).hexdigest()
        is_other = self.settings.get("sha256", own) != own
        wrong = [f"{self.log.name} is not the log of the case: its sha256 is {own}"] * is_other
        if found.updates < (floor := self.settings.get("floor", 0)):
            wrong.append(f"{found.updates} updates, below the floor of {floor}")
        return wrong


def check(case: Case) -> list[str]:
    """Return what differs from the references, the worst first; draw it next to them."""
    found = case.replay()
    wrong = case.unsound(found)
    if missing := [name for name in ("expected.csv", "expected.json", "flight.json")
                   if not (case.folder / name).is_file()]:  # fmt: skip
        return [*wrong, f"no reference {', '.join(missing)}: --update-cases WHY writes it"]
    columns, expected = read_csv(case.folder / "expected.csv")
    reference, flown = (
        json.loads((case.folder / name).read_text(encoding="utf-8"))
        for name in ("expected.json", "flight.json")
    )
    reference |= {"flown": flown}
    tolerances = case.settings.get("tolerances", {})
    by_column, by_key = split_tolerances(tolerances, columns, reference)
    rounded = [[float(f"{value:.9g}") for value in row] for row in found.rows]  # as in text
    actual = np.array(rounded).reshape(len(rounded), len(found.columns))
    mismatches = compare_tables(columns, expected, found.columns, actual, by_column)
    wrong += [each.text for each in mismatches]
    wrong += compare_summaries(reference, found.summary | {"flown": found.flown}, by_key)
    with suppress(OSError):  # a case in a folder that is read-only can still be checked
        for name in ("actual.csv", "actual.svg"):
            (case.folder / name).unlink(missing_ok=True)
        if wrong:
            (case.folder / "actual.csv").write_bytes(csv_of(found.columns, found.rows))
            if columns == found.columns and len(expected) and len(actual):
                worst = [each.column for each in mismatches if each.column not in ALWAYS][:WORST]
                _draw(case.folder / "actual.svg", columns, expected, actual, [*ALWAYS, *worst])
    return wrong


def update(case: Case, why: str) -> None:
    """Write the references again, and the reason (of a new case sha256, floor) into case.toml."""
    assert why.strip(), "--update-cases needs a reason"
    found = case.replay()
    assert not (wrong := case.unsound(found)), wrong[0]
    path = case.folder / "case.toml"
    used = ", ".join(f"{name} {number}" for name, number in versions().items())
    row = {"date": datetime.now(UTC).date(), "why": why, "versions": used}
    first = {"sha256": hashlib.sha256(case.log.read_bytes()).hexdigest(),
             "floor": int(FLOOR_SHARE * found.updates)}  # fmt: skip
    head = tomli_w.dumps({k: v for k, v in first.items() if k not in case.settings})
    text = f"{head}{path.read_text(encoding='utf-8')}\n[[updates]]\n{tomli_w.dumps(row)}"
    tomllib.loads(text)
    answers = {"expected.json": found.summary, "flight.json": found.flown}
    files = {"case.toml": text.encode(), "expected.csv": csv_of(found.columns, found.rows)}
    files |= {name: (json.dumps(of, indent=1) + "\n").encode() for name, of in answers.items()}
    write_whole({case.folder / name: data for name, data in files.items()}, force=True)


def _compared(found: dict[str, Any]) -> dict[str, Any]:
    return dict(json.loads(json.dumps({k: v for k, v in found.items() if k not in NOT_COMPARED})))


def _draw(path: Path, columns: list[str], expected: Floats, actual: Floats, shown: Any) -> None:
    """Write an SVG of columns, expected and actual over time; equal tables give equal bytes."""
    with mpl.rc_context({"svg.hashsalt": "yawid", "font.size": 9}):
        figure = Figure(figsize=(8.0, 1.0 + 1.7 * len(shown)), layout="constrained")
        axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axis, name in zip(axes, shown, strict=True):
            own = [columns.index("t"), columns.index(name)]
            axis.plot(*expected[:, own].T, color="#b0b0b0", linewidth=4.0)
            axis.plot(*actual[:, own].T, color="#c03000", linewidth=1.2)
            values = np.concatenate([expected[:, own[1]], actual[:, own[1]]])
            if np.isfinite(values).any():
                # The first seconds of an estimate may have any value, which would flatten the rest.
                low, high = np.nanpercentile(values, [2.0, 98.0])
                margin = 0.15 * (high - low) or 0.1 * abs(high) or 1.0
                axis.set_ylim(low - margin, high + margin)
            axis.set_ylabel(name)
        axes[0].set_title(f"{path.absolute().parent.name}: expected and actual (thin, red)")
        axes[-1].set_xlabel("vehicle time, s")
        figure.savefig(path, metadata={"Date": None})
