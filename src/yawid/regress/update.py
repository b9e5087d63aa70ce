"""The only place that writes references."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from yawid.errors import ConfigError, SinkError
from yawid.golden import write_csv
from yawid.outputs import versions
from yawid.regress.case import Case, Replayed, find_cases


def update(folder: Path, names: Sequence[str], why: str, say: Callable[[str], None]) -> None:
    """Write the references of cases anew, and into case.toml when, why and by which versions.

    A case whose replay is not one of it (another log, too few updates) keeps its references; the
    others are updated first.

    Raises:
        ConfigError: no reason is given, there is no such case, or a replay is not one of its case.
        SourceError: a log cannot be read.
        SinkError: a reference cannot be written.
    """
    if not why.strip():
        raise ConfigError("--why must give a reason")
    refused = []
    for case in find_cases(folder, names):
        replayed = case.replay()
        if wrong := case.unsound(replayed):
            refused.append(f"{case.folder}: {wrong[0]}")
            continue
        try:
            _write(case, replayed, why)
        except OSError as error:
            raise SinkError(f"cannot write {case.folder}: {error.strerror}") from error
        say(f"updated  {case.name}")
    if refused:
        raise ConfigError("; ".join(refused))


def _write(case: Case, replayed: Replayed, why: str) -> None:
    write_csv(case.folder / "expected.csv", replayed.columns, replayed.rows)
    text = json.dumps(replayed.summary, indent=1) + "\n"
    (case.folder / "expected.json").write_text(text, encoding="utf-8")
    used = ", ".join(f"{name} {number}" for name, number in versions().items())
    with (case.folder / "case.toml").open("a", encoding="utf-8") as stream:
        stream.write(
            f"\n[[updates]]\ndate = {datetime.now(UTC):%Y-%m-%d}\n"
            f"why = {json.dumps(why)}\nversions = {json.dumps(used)}\n"
        )
