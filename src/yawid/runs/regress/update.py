"""The only place that writes references."""

import json
import tomllib
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tomli_w

from yawid.errors import ConfigError, SinkError
from yawid.runs.regress.case import Case, Replayed, find_cases
from yawid.runs.regress.table import csv_of
from yawid.runs.stop import Interrupted
from yawid.runs.versions import versions
from yawid.sinks.door import say as to_stderr
from yawid.system.part_file import write_whole


def update(folder: Path, names: Sequence[str], why: str, say: Callable[[str], None]) -> None:
    """Write the references of cases again, and note date, reason and versions in case.toml.

    A case whose replay does not belong to it (another log, too few updates) keeps its references
    and is reported after the others are updated.

    Raises:
        ConfigError: no reason is given, or it is not text; a case does not exist, its case.toml
        cannot take another update, or a replay does not belong to its case.
        SourceError: a log cannot be read.
        SinkError: a reference cannot be written.
        Interrupted: a signal came; the cases not reached are named on stderr.
    """
    if not why.strip():
        raise ConfigError("--why must give a reason")
    cases = find_cases(folder, names)
    # This comes before any replay, so that a reason that cannot be recorded is refused early.
    recorded = {case.folder: _recorded(case, why) for case in cases}
    refused, done = [], 0
    try:
        for case in cases:
            replayed = case.replay()
            if wrong := case.unsound(replayed):
                refused.append(f"{case.folder}: {wrong[0]}")
            else:
                _write(case, replayed, case.flown(), recorded[case.folder])
                say(f"updated  {case.name}")
            done += 1
    except Interrupted:
        to_stderr(f"not updated: {', '.join(case.name for case in cases[done:])}")
        raise
    if refused:
        raise ConfigError("; ".join(refused))


def _recorded(case: Case, why: str) -> bytes:
    """Return the case's case.toml with one more entry in its updates."""
    path = case.folder / "case.toml"
    used = ", ".join(f"{name} {number}" for name, number in versions().items())
    row = {"date": datetime.now(UTC).date(), "why": why, "versions": used}
    try:
        text = f"{path.read_text(encoding='utf-8')}\n[[updates]]\n{tomli_w.dumps(row)}"
        tomllib.loads(text)
        return text.encode()
    except UnicodeEncodeError as error:
        raise ConfigError(f"--why is not a text: {error.reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path} cannot take another [[updates]]: {error}") from error
    except OSError as error:
        raise SinkError(f"cannot write {case.folder}: {error.strerror}") from error


def _write(case: Case, replayed: Replayed, flown: dict[str, Any], toml: bytes) -> None:
    """Write all four files under other names first, then rename each, the references last."""
    answers = {"expected.json": replayed.summary, "flight.json": flown}
    files = {
        "case.toml": toml,
        "expected.csv": csv_of(replayed.columns, replayed.rows),
        **{name: (json.dumps(of, indent=1) + "\n").encode() for name, of in answers.items()},
    }
    write_whole({case.folder / name: data for name, data in files.items()}, force=True)
