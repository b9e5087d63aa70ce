"""Replay cases, compare them with their references, and write what differs for a person to see.

For machines the result is written as JUnit XML and JSON.
"""

import json
import multiprocessing
import re
import signal
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from yawid.answers.reports import CaseReport, RegressReport
from yawid.blocks import Floats
from yawid.errors import ConfigError, SinkError, YawidError
from yawid.runs.regress.case import Case, Replayed
from yawid.runs.regress.compare import Mismatch, compare_summaries, compare_tables, split_tolerances
from yawid.runs.regress.table import csv_of, read_csv
from yawid.system.part_file import os_errors_as_sink_error
from yawid.system.processes import cores

ACTUAL, PICTURE = "actual.csv", "actual.svg"
PARALLEL_BYTES = 50_000_000
"""Logs larger than this in sum are replayed by several processes: each has to import everything,
which takes as long as replaying some tens of megabytes."""
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of one case.

    ``wrong`` lists what differs, of each table the worst first; it is empty where the case matches.
    ``code`` is its exit code: 0, 1 (differs), 2 (the case does not fit its log), 6 (its log cannot
    be read), 130 or 143 (not reached). ``files`` names the files written, by "actual" and
    "picture".
    """

    name: str
    folder: Path
    code: int = 0
    wrong: tuple[str, ...] = ()
    seconds: float = 0.0
    files: dict[str, str] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the case matches its references."""
        return self.code == 0


def regress(cases: Sequence[Case], workers: int | None = None) -> Iterator[Outcome]:
    """Replay cases and compare; yield the result of each, in their order.

    ``workers`` is the largest number of processes; None means one for each core where the logs are
    large, else one. There are never more processes than cases.
    """
    count = min(workers or _worthwhile(cases), len(cases))
    if count == 1:
        return map(check_case, cases)
    return _in_processes(cases, count)


def _worthwhile(cases: Sequence[Case]) -> int:
    size = sum(case.log.stat().st_size for case in cases if case.log.is_file())
    return cores() if size > PARALLEL_BYTES else 1


def _in_processes(cases: Sequence[Case], workers: int) -> Iterator[Outcome]:
    # Spawned, not forked: the libraries in use have threads of their own.
    context = multiprocessing.get_context("spawn")
    # Only the parent handles Ctrl-C.
    ignore = (signal.SIGINT, signal.SIG_IGN)
    with ProcessPoolExecutor(workers, context, signal.signal, ignore) as pool:
        yield from pool.map(check_case, cases)


def check_case(case: Case) -> Outcome:
    """Replay one case and compare; what differs is written next to its references."""
    began = time.perf_counter()
    files: dict[str, str] = {}
    try:
        wrong, code = _compare(case, files), 0
    except YawidError as error:
        wrong, code = [" ".join(str(error).split())], 2 if isinstance(error, ConfigError) else 6
    code = code or int(bool(wrong))
    seconds = time.perf_counter() - began
    return Outcome(case.name, case.folder.absolute(), code, tuple(wrong), seconds, files)


def _compare(case: Case, files: dict[str, str]) -> list[str]:
    replayed = case.replay()
    wrong = case.unsound(replayed)
    try:
        columns, expected = read_csv(case.folder / "expected.csv")
        reference, flown = (
            json.loads((case.folder / name).read_text(encoding="utf-8"))
            for name in ("expected.json", "flight.json")
        )
    except (OSError, ValueError) as error:
        return [*wrong, f"no readable reference: {error}"]
    reference |= {"flown": flown}
    by_column, by_key = split_tolerances(case.tolerances, columns, reference)
    actual = _as_read(replayed)
    mismatches = compare_tables(columns, expected, replayed.columns, actual, by_column)
    wrong += [mismatch.text for mismatch in mismatches]
    wrong += compare_summaries(reference, replayed.summary | {"flown": case.flown()}, by_key)
    _leave(case.folder, replayed, (columns, expected, actual), mismatches, files, bool(wrong))
    return wrong


def _as_read(replayed: Replayed) -> Floats:
    """Return the rows (n, m) rounded as they are in text, since the reference is a text file."""
    rows = [[float(f"{value:.9g}") for value in row] for row in replayed.rows]
    return np.array(rows).reshape(len(rows), len(replayed.columns))


def _leave(
    folder: Path,
    replayed: Replayed,
    tables: tuple[list[str], Floats, Floats],
    mismatches: list[Mismatch],
    files: dict[str, str],
    differs: bool,
) -> None:
    """Write the actual rows and a picture where something differs; remove older ones first."""
    actual, picture = (folder / name for name in (ACTUAL, PICTURE))
    try:
        actual.unlink(missing_ok=True)
        picture.unlink(missing_ok=True)
        if not differs:
            return
        actual.write_bytes(csv_of(replayed.columns, replayed.rows))
        files["actual"] = str(actual.absolute())
        columns, expected, now = tables
        if columns == replayed.columns and len(expected) and len(now):
            from yawid.runs.regress.picture import draw

            draw(picture, folder.absolute().name, columns, expected, now, mismatches)
            files["picture"] = str(picture.absolute())
    except OSError:
        return  # a case in a read-only folder can still be checked


def check_junit(path: Path) -> None:
    """Check before a run that its result may be written there; an earlier result is overwritten.

    Raises:
        SinkError: the file exists and holds something else.
    """
    try:
        is_result = not path.stat().st_size or ET.parse(path).getroot().tag == "testsuites"
    except (FileNotFoundError, NotADirectoryError):
        return
    except (OSError, ET.ParseError):
        is_result = False
    if not is_result:
        raise SinkError(f"{path} exists and does not hold test results: choose another --junit")


def write_junit(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Write JUnit XML, a test case per case: a difference is a failure, a failed replay an error.

    Raises:
        SinkError: the file cannot be written.
    """
    counts = {
        "tests": len(outcomes),
        "failures": sum(o.code == 1 for o in outcomes),
        "errors": sum(o.code > 1 for o in outcomes),
    }
    suites = ET.Element("testsuites")
    suite = ET.SubElement(suites, "testsuite", name="yawid regress", time=_seconds(outcomes))
    suite.attrib |= {key: str(value) for key, value in counts.items()}
    for outcome in outcomes:
        named = {"classname": "yawid.runs.regress", "name": _clean(outcome.name)}
        case = ET.SubElement(suite, "testcase", named, time=_seconds([outcome]))
        if not outcome.ok:
            kind = "failure" if outcome.code == 1 else "error"
            problem = ET.SubElement(case, kind, message=_clean(outcome.wrong[0]))
            problem.text = _clean("\n".join(outcome.wrong))
    ET.indent(suites)
    with os_errors_as_sink_error(path):
        path.write_bytes(ET.tostring(suites, encoding="utf-8", xml_declaration=True) + b"\n")


def as_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return what ``--json`` prints; equal logs and references give equal output."""
    cases = [
        CaseReport(
            name=o.name, folder=str(o.folder), ok=o.ok, exit_code=o.code, wrong=list(o.wrong),
            files=o.files,
        )
        for o in outcomes
    ]  # fmt: skip
    return RegressReport(exit_code=exit_code(outcomes), cases=cases).to_json()


def exit_code(outcomes: Sequence[Outcome]) -> int:
    """Return the highest exit code of all cases, 0 where there is none."""
    return max((o.code for o in outcomes), default=0)


def _seconds(outcomes: Sequence[Outcome]) -> str:
    return f"{sum(o.seconds for o in outcomes):.3f}"


def _clean(text: str) -> str:
    """Return the text with U+FFFD for what XML cannot hold: names in a log may hold anything."""
    return _NOT_XML.sub("\ufffd", text)
