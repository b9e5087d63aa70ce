"""How a case is made from a log: a tlog is cut to a stretch and to the messages yawid reads."""

import hashlib
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from yawid.channels.series import boot_us
from yawid.channels.stage import WANTED
from yawid.channels.yaw_reader import SOURCES
from yawid.config.run import COMMAND_LINE, RunConfig, check_settings
from yawid.errors import ConfigError, SinkError, SourceError
from yawid.runs.regress.case import Case
from yawid.sources.formats import TLOG, format_of
from yawid.sources.logs.tlog import CHUNK, read_tlog, record_at
from yawid.sources.open_log import in_memory
from yawid.system.part_file import os_errors_as_sink_error

MOST_BYTES = 1_000_000
LEAD_S = 10.0
"""Kept before --from and after --to: the first seconds of both channels set the grid's rate."""
FLOOR_SHARE = 0.9
FACTS = ("PARAM_VALUE", "HEARTBEAT")
"""Messages kept from the whole log: the facts about the vehicle do not depend on the stretch."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


def new_case(log: Path, name: str, folder: Path, options: Mapping[str, Any]) -> Case:
    """Make ``folder/name`` with its log and case.toml; ``update`` then writes its references.

    An on-board log, or a telemetry log of less than 1 MB without --from and --to, is copied as it
    is. Of other telemetry logs only the messages that yawid reads are kept, from the stretch asked
    for.

    Raises:
        ConfigError: the name is not allowed, the case exists, the options do not fit the log, or
        the case's log would have 1 MB or more.
        SourceError: the log cannot be read.
        SinkError: the case cannot be written.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(f"--name must be letters, digits, '.', '_' and '-', got {name!r}")
    place = folder / name
    if place.exists():
        raise ConfigError(f"{place} exists: choose another --name")
    config = RunConfig(**check_settings(dict(options), COMMAND_LINE))
    kind = format_of(log)
    if kind.opener is None or kind.has_columns:
        raise SourceError(f"{log} is {kind.called}: a case is made from a log")
    data = b"".join(read_tlog(log)) if kind is TLOG else _on_board(log)
    kept = data
    whole = len(data) < MOST_BYTES and config.from_s is None and config.to_s is None
    if kind is TLOG and not whole:
        kept = _trimmed(data, config)
    if len(kept) >= MOST_BYTES:
        raise ConfigError(
            f"{log}: {len(kept)} bytes that yawid reads, but a case has less than {MOST_BYTES}: "
            "choose a stretch by --from and --to"
        )
    # A file's name may hold bytes that are not text.
    called = log.name.encode("utf-8", "backslashreplace").decode()
    origin = f"{called}, sha256 {hashlib.sha256(data).hexdigest()}"
    origin += "" if kept is data else ", trimmed by yawid regress --new"
    return _written(place, f"log{kind.suffix}", kept, origin, options)


def _on_board(log: Path) -> bytes:
    """Return a dataflash log or ULog as it is, uncut.

    Raises:
        ConfigError: it has 1 MB or more.
        SourceError: it cannot be read.
    """
    try:
        size = log.stat().st_size
        if size >= MOST_BYTES:
            raise ConfigError(f"{log}: {size} bytes, but a case has less than {MOST_BYTES}")
        return log.read_bytes()
    except OSError as error:
        raise SourceError(f"cannot read {log}: {error.strerror}") from error


def _written(place: Path, name: str, log: bytes, origin: str, options: Mapping[str, Any]) -> Case:
    """Write the case and replay it once to set its floor; remove everything where that fails."""
    content = {
        "origin": origin,
        "licence": "not stated: whose log is it, and who may have it?",
        "sha256": hashlib.sha256(log).hexdigest(),
        "floor": 0,
        "options": dict(options),
    }
    with os_errors_as_sink_error(place):
        place.mkdir(parents=True)
    try:
        (place / name).write_bytes(log)
        (place / "case.toml").write_text(tomli_w.dumps(content), encoding="utf-8")
        content["floor"] = int(FLOOR_SHARE * Case.read(place).replay().updates)
        (place / "case.toml").write_text(tomli_w.dumps(content), encoding="utf-8")
    except BaseException as error:
        shutil.rmtree(place, ignore_errors=True)  # this function made the folder itself
        if isinstance(error, OSError):
            raise SinkError(f"cannot write {place}: {error.strerror}") from error
        raise
    return Case.read(place)


def _trimmed(data: bytes, config: RunConfig) -> bytes:
    """Return the records that yawid reads from the stretch asked for, and all of ``FACTS``.

    A record without a time has that of the one before it, the first ones that of the first time.
    """
    heard = []
    pieces = (data[at : at + CHUNK] for at in range(0, len(data), CHUNK))
    for _, found in in_memory(pieces, WANTED).read():
        for name, block in () if found is None else found.messages.items():
            times = np.full(len(block), np.nan)
            if name in SOURCES:
                times = boot_us(block.fields) / 1e6
            heard.append(np.column_stack([block.order, times, np.full(len(block), name in FACTS)]))
    rows = np.concatenate([np.zeros((0, 3)), *heard])
    order, times, is_fact = rows[np.argsort(rows[:, 0])].T
    last = np.maximum.accumulate(np.where(np.isnan(times), -1, np.arange(len(times))))
    first = times[np.isfinite(times)][:1]
    boot_s = np.where(last >= 0, times[last], first[0] if len(first) else 0.0)
    low = -np.inf if config.from_s is None else config.from_s - LEAD_S
    high = np.inf if config.to_s is None else config.to_s + LEAD_S
    kept = (boot_s >= low) & (boot_s <= high) | (is_fact > 0.0)
    return b"".join(record_at(data, at) for at in order[kept].astype(np.int64).tolist())
