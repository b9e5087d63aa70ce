"""Data sets written row by row, without logs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from yawid.dataset.files import DataSet

MADE_BY = {"yawid_version": "0", "analysis_version": "1", "config_hash": "c"}
MAY, JUNE = 1_780_000_000_000_000, 1_782_000_000_000_000  # 2026-05-28, 2026-06-21


def entry(path: str, sha: str | None, *dates: int | None, **values: Any) -> Any:
    """Return a log's rows: a boot for each of ``dates``, which may be None."""
    log = {"path": path, "log_sha256": sha, "outcome": "ok" if sha else "crashed", **MADE_BY}
    keys = {"log_sha256": sha, "sysid": 1, "vehicle": "sysid:1", "usable": True, **MADE_BY}
    flights = [{**keys, "boot": i, "date": date, **values} for i, date in enumerate(dates, 1)]
    return {"logs": [log], "flights": flights}


def merge(folder: Path, entries: Iterable[Any]) -> None:
    """Put logs with all their rows into a data set, as a fleet does."""
    with DataSet(folder) as data:
        for each in entries:
            data.add(each)
