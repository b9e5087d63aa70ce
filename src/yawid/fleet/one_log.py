"""Turns one log into rows: replays each vehicle and each boot in it by itself, writing no files.

Every error becomes an outcome with a text; none is raised.
"""

import errno
import stat
import traceback
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from yawid.answers.model_parts import flat
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import RunSummary
from yawid.config.run import OF_RECORDS, RunConfig
from yawid.dataset.schema import LOGS
from yawid.dataset.summary_rows import flight_rows, manoeuvre_rows, of_table, run_rows
from yawid.dataset.values import FAILED, USAGE, ReadRow, Row, failed, known_date, plain, serial_of
from yawid.errors import ConfigError, SourceError, YawidError
from yawid.fleet.spec import Spec
from yawid.runs.job import Recording, open_log, run
from yawid.sinks.base import Event, RunRows, Sink
from yawid.sources.open_log import ReadOptions
from yawid.system.stores import StoredPath, brought
from yawid.version import __version__

Rows = dict[str, list[Row]]


class Flown(Sink):
    """One replay of one boot of one vehicle, and what is kept of its samples.

    ``boots`` are the numbers of all boots that it saw; ``first_us`` (us since 1970) is None if
    unknown, ``duration_s`` is in s. ``seconds`` has a row of the table ``modes`` for each second,
    taken from its first sample.

    Raises:
        ConfigError: the configuration excludes this boot.
        YawidError: it cannot be replayed.
    """

    def __init__(self, source: Recording, config: RunConfig) -> None:
        self.first_us: int | None = None
        self.duration_s: float | None = None
        self.seconds: list[Row] = []
        self._boot_s, self._last_s = 0.0, -1
        job = run(source, config, [self])
        self.boots = tuple(job.pipeline.channels.boots.spans_us)
        self.boot = config.boot or next(iter(self.boots), 1)
        self.vehicle_id = source.vehicle_id or serial_of(source.parameters(job.pipeline))
        self.summary, self.ordinary_sums = job.conclude(), job.pipeline.ordinary_sums()

    def take(self, event: Event) -> None:
        """See :class:`Sink`; the modes are those of the first method."""
        if not isinstance(event, RunRows):
            return
        samples, modes = event.samples, event.modes
        if self.duration_s is None:
            self.first_us = known_date(int(samples.unix_ns[0]) // 1000)
            self._boot_s = samples.boot_us[0] / 1e6
        self.duration_s = float(samples.boot_us[-1] / 1e6 - self._boot_s)
        seconds = samples.boot_us // 1_000_000
        rows = np.flatnonzero(np.diff(seconds, prepend=self._last_s))
        self._last_s = int(seconds[-1])
        names = ("wn_rad_s", "wn_std_noise", "zeta", "zeta_std_noise")
        for row in rows.tolist():
            self.seconds.append(
                {
                    "date": known_date(int(samples.unix_ns[row]) // 1000),
                    "boot_s": float(samples.boot_us[row] / 1e6),
                    "method": next(iter(event.estimates)),
                    "held": bool(samples.held[row]),
                    **dict(zip(names, modes.dutch_roll[row].tolist(), strict=True)),
                }
            )


def rows_here(path: str, spec: Spec, copies: Path) -> Rows:
    """Return the rows of a log by table; a URL is first copied below the folder ``copies``."""
    place = StoredPath(path) if "://" in path else Path(path)
    try:
        path.encode()
        if isinstance(place, Path) and not stat.S_ISREG(place.stat().st_mode):
            return failed(FAILED, "it is not a regular file: only those are read")
        with brought(place, copies) as local:
            return rows_of(local, spec)
    except UnicodeEncodeError:  # the tables hold UTF-8
        return failed(FAILED, "its name is not UTF-8: rename the file or its folder")
    except (YawidError, OSError) as error:
        return failed(FAILED, str(error))


def rows_of(path: Path, spec: Spec) -> Rows:
    """Return a log's rows by table; ``logs`` has exactly one, which alone has the log's hash.

    The caller adds ``path``, ``size_bytes``, ``modified``, ``config_hash`` and
    ``analysis_version``.
    """
    try:
        options = spec.read_options()
    except ConfigError as error:
        return failed(FAILED, str(error))
    try:
        return _rows_of(path, spec, options)
    except SourceError as error:
        outcome, text = FAILED if _may_pass(error.__cause__) else "unreadable", str(error)
    except ConfigError as error:
        outcome, text = USAGE, str(error)
    except YawidError as error:
        outcome, text = "unusable", str(error)
    except Exception as error:
        outcome, text = FAILED if _may_pass(error) else "crashed", _where(error)
    reason = "refused" if outcome == "unusable" else None
    return failed(outcome, text.replace(str(path), path.name), reason)


def _may_pass(error: BaseException | None) -> bool:
    """Return whether an error comes from the machine or the store, and not from the log.

    EINVAL counts as the log's: readers of a damaged log seek to places that do not exist.
    """
    is_system = isinstance(error, OSError) and error.errno not in (None, errno.EINVAL)
    return is_system or isinstance(error, ImportError)


def _where(error: Exception) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})"


def _rows_of(path: Path, spec: Spec, options: ReadOptions) -> Rows:
    """Return the rows of a log. An MCAP gets the hash of the log that it was made from."""
    source = open_log(path, options)
    settings = dict(spec.settings)
    if not source.format.has_columns:  # a folder may hold records and logs
        settings = {name: each for name, each in settings.items() if name not in OF_RECORDS}
    config = source.settled(settings)
    first = Flown(source, config)

    def another(config: RunConfig) -> Flown | None:
        again = open_log(path, options)
        again.settled(settings)
        try:
            return Flown(again, config)
        except ConfigError:  # the settings exclude this boot
            return None

    flights = list(_each(first, config, another))
    summary, first_us = first.summary, source.link.first_us
    made_from = None if summary.source is None else summary.source.sha256
    log = {
        "log_sha256": made_from or summary.sha256,
        "file_sha256": summary.sha256,
        "kind": source.format.name,
        "date": first.first_us if first_us is None else known_date(first_us),
    }
    return _rows(summary, flights, log, spec)


def _each(first: Flown, config: RunConfig, another: Any) -> Iterator[Flown]:
    """Yield every boot of every vehicle that the configuration does not exclude.

    ``first`` is the replay that was already made; ``another`` makes one with a configuration.
    """
    if (own := first.summary.vehicle) is None:
        yield first
        return
    found = [own] if config.sysid is not None else first.summary.vehicles or [own]
    for sysid in dict.fromkeys(each.sysid for each in found):
        chosen = replace(config, sysid=sysid)
        flown = first if sysid == own.sysid else another(chosen)
        if flown is not None and len(flown.boots) > 1 and config.boot is None:
            each_boot = (another(replace(chosen, boot=boot)) for boot in flown.boots)
            yield from filter(None, each_boot)
        elif flown is not None:
            yield flown


def _rows(summary: RunSummary, flights: list[Flown], log: ReadRow, spec: Spec) -> Rows:
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
        of_flight = whose | {"ordinary_sums": flown.ordinary_sums}
        first_us = flown.first_us or log["date"]
        by_loop = flight_rows(flown.summary, first_us, flown.duration_s)
        rows["flights"].append(of_flight | by_loop[0])
        rows["flights_by_loop"] += [of_flight | row for row in by_loop]
        date = {"date": by_loop[0]["date"]}
        rows["runs"] += [whose | date | row for row in run_rows(flown.summary)]
        rows["manoeuvres"] += [whose | row for row in manoeuvre_rows(flown.summary)]
        rows["modes"] += [whose | row for row in flown.seconds if spec.modes]
    judged = [flown.summary.deciding for flown in flights]
    said = [reason for verdict in judged for reason in verdict.reasons]
    is_ok = any(flown.summary.exit_code == 0 for flown in flights)
    row = {
        **flat(summary.link),
        **log,
        "yawid_version": __version__,
        "outcome": "ok" if is_ok else "unusable",
        "reasons": [] if is_ok else _ids(said, "fatal"),
        "warnings": _ids(said, "warning"),
        "text": "; ".join(dict.fromkeys(map(str, said))),
        "duration_s": summary.duration_s,
        "flights": len(rows["flights"]),
        "manoeuvres": len(rows["manoeuvres"]),
    }
    return {name: plain(each) for name, each in {"logs": [of_table(LOGS, row)], **rows}.items()}


def _ids(reasons: Iterable[Reason], weight: str) -> list[str]:
    return list(dict.fromkeys(each.id for each in reasons if each.weight == weight))
