"""``yawid fleet``: replays the logs that a data set does not have yet, and merges their rows."""

import importlib.util
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from yawid.config.run import OF_RECORDS
from yawid.dataset.files import DataSet, misfit, peek
from yawid.dataset.schema import ANALYSIS_VERSION
from yawid.dataset.values import FAILED, USAGE, Entry, ReadRow, failed
from yawid.errors import SinkError, SourceError
from yawid.fleet.find_logs import FoundLog, check_apart, find_logs
from yawid.fleet.pools import HERE, check_installed, ended_logs, workers_here, workers_of
from yawid.fleet.spec import Spec
from yawid.fleet.worker import Task
from yawid.runs.stop import StopFlag
from yawid.sinks.words import duration
from yawid.sources.formats import FORMATS

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
class Plan:
    """Which logs are to be run."""

    todo: list[FoundLog]
    known: int
    """How many logs the data set already has as they are now."""
    answered: frozenset[str] = frozenset()
    """Paths that have an outcome other than "failed", even of an older state of the log."""

    @property
    def size(self) -> int:
        """The number of bytes to be read."""
        return sum(log.size for log in self.todo)


@dataclass(slots=True)
class Progress:
    """How far a run has come.

    ``logs`` and ``size`` (bytes) are the whole, ``done`` and ``done_bytes`` what has ended.
    ``threads`` workers each replay a log. ``start_s`` is on the monotonic clock. ``why_failed``
    is the text of the first log that failed, ``why_usage`` that of the first that the options do
    not fit.
    """

    logs: int
    size: int
    threads: int = 0
    done: int = 0
    done_bytes: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    start_s: float = field(default_factory=time.monotonic)
    why_failed: str = ""
    why_usage: str = ""

    @property
    def failed(self) -> int:
        """The number of logs that failed for a reason that may pass."""
        return self.outcomes[FAILED]

    def add(self, outcome: str, size: int) -> None:
        """Count a log that has ended."""
        self.done, self.done_bytes = self.done + 1, self.done_bytes + size
        self.outcomes[outcome] += 1

    def left_s(self, passed_s: float) -> float:
        """Return the time in s that the logs left will take, if those done took ``passed_s``."""
        left = self.size - self.done_bytes + LOG_BYTES * (self.logs - self.done)
        return passed_s * left / (self.done_bytes + LOG_BYTES * self.done)

    def line(self) -> str:
        """Return the progress in words, with the rate and the time that remains."""
        if not self.threads:
            return f"{self.done} of {self.logs} logs; waiting for workers"
        passed_s = max(time.monotonic() - self.start_s, 1e-3)
        counts = ", ".join(f"{name} {count}" for name, count in self.outcomes.most_common())
        text = f"{self.done} of {self.logs} logs, {self.done / passed_s:.2g}/s"
        if self.done_bytes:
            rate = f"{self.done_bytes / passed_s / 1e6:.2g} MB/s"
            text += f", {rate}, {duration(self.left_s(passed_s))} left"
        return f"{text}; {counts}" if counts else text


def plan_of(run: FleetRun, found: Sequence[FoundLog], known: Mapping[str, ReadRow]) -> Plan:
    """Return which logs are to be run: those that the data set does not have as they are now.

    Raises:
        SourceError: a log needs a library that is not installed.
    """
    config_hash = run.spec.config_hash
    todo = [log for log in found if not _is_known(log, known.get(log.path), config_hash, run)]
    _need_libraries(todo)
    answered = frozenset(path for path, row in known.items() if row["outcome"] != FAILED)
    return Plan(_spread(todo), len(found) - len(todo), answered)


def _spread(logs: list[FoundLog]) -> list[FoundLog]:
    """Return logs, which are sorted by size, with every tenth first."""
    return logs[::SPREAD] + [log for i, log in enumerate(logs) if i % SPREAD]


def _is_known(log: FoundLog, row: ReadRow | None, config_hash: str, run: FleetRun) -> bool:
    now = (config_hash, ANALYSIS_VERSION, log.size)
    if row is None or (row["config_hash"], row["analysis_version"], row["size_bytes"]) != now:
        return False
    if (
        log.failure is not None
        or row["outcome"] == FAILED
        or (run.retry and row["outcome"] in TRIED_AGAIN)
    ):
        return False
    return bool(row["modified"] == log.modified)


def _need_libraries(logs: Sequence[FoundLog]) -> None:
    """Find out before the first log is run whether the readers of all can be."""
    for each in FORMATS:
        if each.needs is None or not any(log.path.lower().endswith(each.suffix) for log in logs):
            continue
        module, extra = each.needs
        if importlib.util.find_spec(module) is None:
            raise SourceError(
                f"{each.said} is among the logs: reading it needs {module} (yawid[{extra}])"
            )


def dry_run(run: FleetRun) -> Plan:
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
    began: Callable[[Plan], None] = lambda plan: None,
) -> Progress:
    """Run every log that the data set does not have; return the progress.

    When ``stop`` is set, finished logs are kept. ``began`` is called once with the plan, ``show``
    after each log and while waiting for one.

    Raises:
        Interrupted: ``stop`` was set before the run began.
        SourceError: there is no log, or a log cannot be read; the data set is of another version.
        SinkError: the data set cannot be written, or the scheduler is lost.
        ConfigError: a scheduler is asked for and Dask is not installed, or the data set's folder
            contains the logs or lies among them.
    """
    if run.scheduler is not None:
        check_installed()
    with stop.raising():
        found = _found(run)
    with DataSet(run.out) as data:
        with stop.raising():
            plan = plan_of(run, found, data.known())
        began(plan)
        progress = Progress(len(plan.todo), plan.size)
        if plan.todo:
            _run(run, plan, data, progress, stop, show)
    return progress


def _run(
    run: FleetRun,
    plan: Plan,
    data: DataSet,
    progress: Progress,
    stop: StopFlag,
    show: Callable[[Progress], None],
) -> None:
    found = {log.path: log for log in plan.todo}
    own = {"config_hash": run.spec.config_hash, "analysis_version": ANALYSIS_VERSION}
    address = run.scheduler
    readable = (log for log in plan.todo if log.failure is None)
    tasks = (Task(log.path, run.spec, run.timeout_s) for log in readable)

    def add(log: FoundLog, rows: Any, address: str) -> None:
        entry = _entry(log, rows, own, address, run.spec.name_of(log.path))
        row = entry["logs"][0]
        if row["outcome"] == FAILED:
            progress.why_failed = progress.why_failed or f"{log.path}: {row['text']}"
        if row["outcome"] == USAGE:
            progress.why_usage = progress.why_usage or f"{log.path}: {row['text']}"
        elif row["outcome"] != FAILED or log.path not in plan.answered:
            data.add(entry)  # a failure does not replace an earlier answer
        progress.add(row["outcome"], log.size)
        show(progress)

    for log in plan.todo:
        if log.failure is not None:
            add(log, failed(FAILED, log.failure), HERE)
    with (
        workers_here(run.workers, data.copies) if address is None else workers_of(address)
    ) as workers:
        progress.start_s = time.monotonic()
        with closing(ended_logs(workers, tasks, stop)) as done:
            for ended in done:
                progress.threads = workers.threads
                if ended is None:
                    show(progress)
                else:
                    task, rows = ended
                    add(found[task.path], rows, workers.address)


def _entry(
    log: FoundLog, rows: Any, own: Mapping[str, str], address: str, name: str | None
) -> Entry:
    """Return a log's rows with their keys, checked to fit the tables.

    ``rows`` are None where the worker found no such file.
    """
    if rows is None:
        if Path(log.path).is_file():
            raise SinkError(
                f"a worker of {address} does not see {log.path}: all machines need the same "
                "files below the same paths, or URLs"
            )
        rows = failed(FAILED, "it was removed before it was read")
    entry = with_keys(log, rows, own, name)
    text = misfit(entry)
    return entry if text is None else with_keys(log, failed("crashed", text), own)


def with_keys(log: FoundLog, rows: Any, own: Mapping[str, str], name: str | None = None) -> Entry:
    """Return a log's rows with their keys; ``own`` are the keys that all logs of a run share.

    ``name`` is that of the log's aircraft, None where none was given; where several vehicles fly
    in one log, each has its id as well.
    """
    row = rows["logs"][0]
    keys = {**own, "yawid_version": row["yawid_version"], "log_sha256": row.get("log_sha256")}
    found = {"path": log.path, "size_bytes": log.size, "modified": log.modified}
    entry = {table: [each | keys for each in below] for table, below in rows.items()}
    if name is not None:
        several = len({each["sysid"] for each in rows.get("flights", ())}) > 1
        for each in (each for below in entry.values() for each in below if "vehicle" in each):
            each["vehicle"] = f"{name} sysid:{each['sysid']}" if several else name
    return entry | {"logs": [found | row | keys]}
