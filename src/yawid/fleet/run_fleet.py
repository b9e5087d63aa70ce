"""``yawid fleet``: replays the logs that a data set does not have yet, and merges their rows."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from yawid.config.run import OF_RECORDS
from yawid.dataset.files import DataSet, peek, table_of
from yawid.dataset.schema import ANALYSIS_VERSION, TABLES
from yawid.dataset.values import FAILED, USAGE, Entry, ReadRow, failed
from yawid.fleet.find_logs import FoundLog, check_apart, find_logs
from yawid.fleet.pools import check_installed, ended_logs, workers_here, workers_of
from yawid.fleet.spec import Spec
from yawid.fleet.worker import Task
from yawid.runs.stop import StopFlag
from yawid.sinks.words import duration

TIMEOUT_S: Final = 600.0
"""Default time limit of one log in s."""
LOG_BYTES: Final = 300_000
"""A log costs as much time as so many bytes, and that of its own bytes (0.3 s, and 1 s for a MB).
"""
SPREAD: Final = 10
"""Every tenth log by size is run first, so that the time for the others is known from them."""
TRIED_AGAIN: Final = ("crashed", "timeout")
"""Outcomes of logs that are run again only with ``--retry``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetRun:
    """The settings of a fleet run: which logs, where the data set is, and which workers."""

    paths: Sequence[str]
    out: Path
    spec: Spec = field(default_factory=Spec)
    workers: int | None = None
    scheduler: str | None = None
    retry: bool = False
    timeout_s: float = TIMEOUT_S


@dataclass(slots=True)
class Progress:
    """Which logs are to be run, and how far that has come.

    The data set already has ``known`` further logs as they are now. ``done_bytes`` is the size
    of what has ended. ``threads`` workers each replay a log. ``start_s`` is on the monotonic clock.
    ``first`` has the first log of each outcome with its text.
    """

    todo: Sequence[FoundLog]
    known: int = 0
    threads: int = 0
    done_bytes: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)
    start_s: float = field(default_factory=time.monotonic)

    @property
    def done(self) -> int:
        """The number of logs that have ended."""
        return self.outcomes.total()

    @property
    def size(self) -> int:
        """The number of bytes to be read."""
        return sum(log.size for log in self.todo)

    def add(self, outcome: str, size: int, text: str = "") -> None:
        """Count a log that has ended."""
        self.done_bytes += size
        self.outcomes[outcome] += 1
        self.first.setdefault(outcome, text)

    def left_s(self, passed_s: float) -> float:
        """Return the time in s that the logs left will take, if those done took ``passed_s``."""
        left = self.size - self.done_bytes + LOG_BYTES * (len(self.todo) - self.done)
        return passed_s * left / (self.done_bytes + LOG_BYTES * self.done)

    def line(self) -> str:
        """Return the progress in words, with the rate and the time that remains."""
        text = f"{self.done} of {len(self.todo)} logs"
        if not self.threads:
            return f"{text}; waiting for workers"
        passed_s = max(time.monotonic() - self.start_s, 1e-3)
        counts = ", ".join(f"{name} {count}" for name, count in self.outcomes.most_common())
        text += f", {self.done / passed_s:.2g}/s"
        if self.done_bytes:
            rate = f"{self.done_bytes / passed_s / 1e6:.2g} MB/s"
            text += f", {rate}, {duration(self.left_s(passed_s))} left"
        return f"{text}; {counts}" if counts else text


def plan_of(run: FleetRun, found: Sequence[FoundLog], known: Mapping[str, ReadRow]) -> Progress:
    """Return which logs are to be run: those that the data set does not have as they are now.

    They are sorted by size as they were found, with every tenth first.
    """
    own, again = _own(run.spec), (FAILED, *TRIED_AGAIN) if run.retry else (FAILED,)

    def is_known(log: FoundLog) -> bool:
        row = known.get(log.path, {"outcome": FAILED})
        now = own | {"size_bytes": log.size, "modified": log.modified}
        return row["outcome"] not in again and now.items() <= row.items()

    todo = [log for log in found if not is_known(log)]
    spread = todo[::SPREAD] + [log for i, log in enumerate(todo) if i % SPREAD]
    return Progress(spread, len(found) - len(todo))


def _own(spec: Spec) -> dict[str, str]:
    """Return the keys that all logs of a run share."""
    return {"config_hash": spec.config_hash, "analysis_version": ANALYSIS_VERSION}


def dry_run(run: FleetRun) -> Progress:
    """Return what a run would do, without writing anything. Raises as :func:`run_fleet` does."""
    return plan_of(run, _found(run), peek(run.out))


def _found(run: FleetRun) -> list[FoundLog]:
    asked = run.spec.settings
    found = find_logs(run.paths, with_records=any(name in asked for name in OF_RECORDS))
    check_apart(run.paths, found, run.out)
    return found


def run_fleet(
    run: FleetRun,
    stop: StopFlag,
    show: Callable[[Progress], None] = lambda progress: None,
    began: Callable[[Progress], None] = lambda progress: None,
) -> Progress:
    """Run every log that the data set does not have; return the progress.

    When ``stop`` is set, finished logs are kept. ``began`` is called once, ``show`` after
    each log and while waiting for one.

    Raises:
        Interrupted: ``stop`` was set before the run began.
        SourceError: there is no log; the data set is of another version.
        SinkError: the data set cannot be written, or the scheduler is lost.
        ConfigError: a scheduler is asked for and Dask is not installed, or the data set's folder
            contains the logs or lies among them.
    """
    if run.scheduler is not None:
        check_installed()
    with stop.raising():
        found = _found(run)
    with DataSet(run.out) as data:
        known = data.known()
        progress = plan_of(run, found, known)
        began(progress)
        if not progress.todo:
            return progress
        answered = {path for path, row in known.items() if row["outcome"] != FAILED}
        logs, address = {log.path: log for log in progress.todo}, run.scheduler
        tasks = (Task(path, run.spec, run.timeout_s) for path in logs)
        with (
            (
                workers_here(run.workers, data.copies) if address is None else workers_of(address)
            ) as workers,
            closing(ended_logs(workers, tasks, stop)) as done,
        ):
            progress.start_s = time.monotonic()
            for ended in done:
                progress.threads = workers.threads
                if ended is not None:
                    log = logs[ended[0].path]
                    entry = _entry(log, ended[1], run.spec)
                    row = entry["logs"][0]
                    # A failure does not replace an earlier answer.
                    is_new = row["outcome"] != FAILED or row["path"] not in answered
                    if is_new and row["outcome"] != USAGE:
                        data.add(entry)
                    progress.add(row["outcome"], log.size, f"{row['path']}: {row['text']}")
                show(progress)
    return progress


def _entry(log: FoundLog, rows: Any, spec: Spec) -> Entry:
    """Return a log's rows with their keys, checked to fit the tables."""
    try:
        entry = with_keys(log, rows, spec)
        for name, each in entry.items():
            table_of(TABLES[name], each)
    except (pa.ArrowException, ValueError, TypeError, OverflowError) as error:
        return with_keys(log, failed("crashed", f"its rows do not fit the tables: {error}"), spec)
    return entry


def with_keys(log: FoundLog, rows: Any, spec: Spec) -> Entry:
    """Return a log's rows with their keys, and the name of its aircraft where one was given.

    Where several vehicles fly in one log, each has its id as well.
    """
    row, name = rows["logs"][0], spec.name_of(log.path)
    keys = _own(spec) | {n: row.get(n) for n in ("yawid_version", "log_sha256")}
    path = log.path.encode("utf-8", "backslashreplace").decode()  # what a table can hold
    found = {"path": path, "size_bytes": log.size, "modified": log.modified}
    entry = {table: [each | keys for each in below] for table, below in rows.items()}
    if name is not None:
        several = len({each["sysid"] for each in rows.get("flights", ())}) > 1
        for each in (each for below in entry.values() for each in below if "vehicle" in each):
            each["vehicle"] = f"{name} sysid:{each['sysid']}" if several else name
    return entry | {"logs": [found | row | keys]}
