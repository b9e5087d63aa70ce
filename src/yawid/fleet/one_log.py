"""Turns one log into rows: replays each vehicle and each boot in it by itself, writing no files.

Every error becomes an outcome with a text; none is raised.
"""

import errno
import os
import traceback
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from yawid.answers.heard import LinkCounts
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import RunSummary
from yawid.config.run import OF_RECORDS, RunConfig
from yawid.dataset.summary_rows import flight_rows, manoeuvre_rows, run_rows
from yawid.dataset.values import FAILED, USAGE, ReadRow, Row, failed, known_date, plain, serial_of
from yawid.errors import ConfigError, SourceError, YawidError
from yawid.fleet.spec import Spec
from yawid.runs.job import Recording, open_log, run
from yawid.sinks.base import Event, Grid, RunRows, Sink
from yawid.sources.open_log import ReadOptions
from yawid.system.stores import StoredPath
from yawid.version import __version__

Rows = dict[str, list[Row]]
_LINK = ("frames", "skipped_bytes", "bad_crc", "unknown", "lost", "reboots", "clock_steps", "gaps")


class FlightSink(Sink):
    """Keeps ``first_us`` (us since 1970, None if unknown), ``duration_s`` (s) and ``seconds``.

    With ``every_second``, ``seconds`` has a row of the table ``modes`` for each second, taken from
    its first sample.
    """

    def __init__(self, *, every_second: bool = False) -> None:
        self.first_us: int | None = None
        self.duration_s: float | None = None
        self.seconds: list[Row] = []
        self._every_second = every_second
        self._boot_s, self._last_s = 0.0, -1

    def take(self, event: Event) -> None:
        """See :class:`Sink`; the modes are those of the first method."""
        if isinstance(event, Grid):
            self._method = event.methods[0]
        if not isinstance(event, RunRows):
            return
        samples, modes = event.samples, event.modes
        if self.duration_s is None:
            self.first_us = known_date(int(samples.unix_ns[0]) // 1000)
            self._boot_s = samples.boot_us[0] / 1e6
        self.duration_s = float(samples.boot_us[-1] / 1e6 - self._boot_s)
        if not self._every_second:
            return
        seconds = samples.boot_us // 1_000_000
        rows = np.flatnonzero(np.diff(seconds, prepend=self._last_s))
        self._last_s = int(seconds[-1])
        names = ("wn_rad_s", "wn_std_noise", "zeta", "zeta_std_noise")
        for row in rows.tolist():
            self.seconds.append(
                {
                    "date": known_date(int(samples.unix_ns[row]) // 1000),
                    "boot_s": float(samples.boot_us[row] / 1e6),
                    "method": self._method,
                    "held": bool(samples.held[row]),
                    **dict(zip(names, modes.dutch_roll[row].tolist(), strict=True)),
                }
            )


@dataclass(frozen=True, slots=True)
class _Flown:
    """One replay of one boot of one vehicle, and the numbers of all ``boots`` that it saw."""

    summary: RunSummary
    boot: int
    boots: tuple[int, ...]
    vehicle_id: str | None
    sink: FlightSink


class _OtherKeyError(SourceError):
    """The key file on this machine cannot be read, or is not the one the fleet started with."""


def rows_here(path: str, spec: Spec, copies: Path) -> Any:
    """Return the rows of a log by table, or None if this machine has no such file.

    A URL is first copied into a folder of this process below ``copies``.
    """
    if "://" not in path:
        return rows_of(Path(path), spec) if Path(path).is_file() else None
    local = copies / f"{os.getpid()}" / StoredPath(path).local_name
    try:
        local.parent.mkdir(parents=True, exist_ok=True)
        StoredPath(path).copy_to(local)
        return rows_of(local, spec)
    except (YawidError, OSError) as error:
        return failed(FAILED, str(error))
    finally:
        local.unlink(missing_ok=True)


def rows_of(path: Path, spec: Spec) -> Rows:
    """Return a log's rows by table; ``logs`` has exactly one, which alone has the log's hash.

    The caller adds ``path``, ``size_bytes``, ``modified``, ``config_hash`` and
    ``analysis_version``.
    """
    try:
        return _rows_of(path, spec)
    except SourceError as error:
        may_pass = isinstance(error, _OtherKeyError) or _may_pass(error.__cause__)
        outcome, text = FAILED if may_pass else "unreadable", str(error)
    except ConfigError as error:
        outcome, text = USAGE, str(error)
    except YawidError as error:
        outcome, text = "unusable", str(error)
    except Exception as error:
        outcome, text = FAILED if _may_pass(error) else "crashed", _where(error)
    reason = "refused" if outcome == "unusable" else None
    return failed(outcome, text.replace(str(path), path.name), reason)


def read_options_of(spec: Spec) -> ReadOptions:
    """Return how the log's bytes are read: with the signing key, if any.

    Raises:
        _OtherKeyError: the key cannot be read here, or differs from the one the fleet started with.
    """
    path = None if spec.key_file is None else Path(spec.key_file)
    try:
        options = ReadOptions.asked(path)
    except ConfigError as error:
        raise _OtherKeyError(str(error)) from error
    if options.key is not None and options.key.mark != spec.key_mark:
        raise _OtherKeyError(
            f"signing key file {path}: it holds another key than when the fleet was started"
        )
    return options


def _may_pass(error: BaseException | None) -> bool:
    """Return whether an error comes from the machine or the store, and not from the log.

    EINVAL counts as the log's: readers of a damaged log seek to places that do not exist.
    """
    is_system = isinstance(error, OSError) and error.errno not in (None, errno.EINVAL)
    return is_system or isinstance(error, ImportError)


def _where(error: Exception) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})"


def _rows_of(path: Path, spec: Spec) -> Rows:
    """Return the rows of a log. An MCAP gets the hash of the log that it was made from."""
    options = read_options_of(spec)
    source = open_log(path, options)
    settings = dict(spec.settings)
    if not source.format.has_columns:  # a folder may hold records and logs
        settings = {name: each for name, each in settings.items() if name not in OF_RECORDS}
    config = source.settled(settings)
    first = _flown(source, config, spec)

    def another(config: RunConfig) -> _Flown | None:
        again = open_log(path, options)
        again.settled(settings)
        try:
            return _flown(again, config, spec)
        except ConfigError:  # the settings exclude this boot
            return None

    flights = list(_each(first, config, another))
    summary, first_us = first.summary, source.link.first_us
    made_from = None if summary.source is None else summary.source.sha256
    log = {
        "log_sha256": made_from or summary.sha256,
        "file_sha256": summary.sha256,
        "kind": source.format.name,
        "date": first.sink.first_us if first_us is None else known_date(first_us),
    }
    return _rows(summary, flights, log, spec)


def _each(first: _Flown, config: RunConfig, another: Any) -> Iterator[_Flown]:
    """Yield every boot of every vehicle that the configuration does not exclude.

    ``first`` is the replay that was already made; ``another`` makes one with a configuration.
    """
    own = first.summary.vehicle
    found = first.summary.vehicles or ([] if own is None else [own])
    sysids = list(dict.fromkeys(each.sysid for each in found))
    if config.sysid is not None or own is None:
        sysids = [own.sysid] if own is not None else []
    if not sysids:
        yield first
    for sysid in sysids:
        is_first = own is not None and sysid == own.sysid
        chosen = config if is_first else replace(config, sysid=sysid)
        flown = first if is_first else another(chosen)
        if flown is None:
            continue
        if len(flown.boots) < 2 or config.boot is not None:
            yield flown
            continue
        for boot in flown.boots:
            if (alone := another(replace(chosen, sysid=sysid, boot=boot))) is not None:
                yield alone


def _flown(source: Recording, config: RunConfig, spec: Spec) -> _Flown:
    sink = FlightSink(every_second=spec.modes)
    job = run(source, config, [sink])
    boots = tuple(job.pipeline.channels.boots.spans_us)
    own = source.vehicle_id or serial_of(source.parameters(job.pipeline))
    summary = job.conclude()
    return _Flown(summary, config.boot or next(iter(boots), 1), boots, own, sink)


def _rows(summary: RunSummary, flights: list[_Flown], log: ReadRow, spec: Spec) -> Rows:
    rows: Rows = {"flights": [], "flights_by_loop": [], "runs": [], "manoeuvres": [], "modes": []}
    for flown in flights:
        vehicle = flown.summary.vehicle
        if vehicle is None and flown.summary.estimates is None:
            continue
        sysid = None if vehicle is None else vehicle.sysid
        whose = {
            "vehicle": flown.vehicle_id or ("unknown" if sysid is None else f"sysid:{sysid}"),
            "sysid": sysid,
            "boot": flown.boot,
        }
        first_us = flown.sink.first_us or log["date"]
        by_loop = flight_rows(flown.summary, first_us, flown.sink.duration_s)
        rows["flights"].append(whose | by_loop[0])
        rows["flights_by_loop"] += [whose | row for row in by_loop]
        date = {"date": by_loop[0]["date"]}
        rows["runs"] += [whose | date | row for row in run_rows(flown.summary)]
        rows["manoeuvres"] += [whose | row for row in manoeuvre_rows(flown.summary)]
        rows["modes"] += [whose | row for row in flown.sink.seconds]
    judged = [flown.summary.deciding for flown in flights]
    said = [reason for verdict in judged for reason in verdict.reasons]
    is_ok = any(flown.summary.exit_code == 0 for flown in flights)
    fatal = [] if is_ok else _ids(said, "fatal")
    row = {
        **log,
        "yawid_version": __version__,
        "outcome": "ok" if is_ok else "unusable",
        "reasons": fatal,
        "warnings": _ids(said, "warning"),
        "text": "; ".join(dict.fromkeys(map(str, said))),
        "duration_s": summary.duration_s,
        **{name: getattr(summary.link or LinkCounts(), name) for name in _LINK},
        "flights": len(rows["flights"]),
        "manoeuvres": len(rows["manoeuvres"]),
    }
    return {name: plain(each) for name, each in {"logs": [row], **rows}.items()}


def _ids(reasons: Iterable[Reason], weight: str) -> list[str]:
    return list(dict.fromkeys(each.id for each in reasons if each.weight == weight))
