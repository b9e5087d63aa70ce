"""A ULog file as pyulog reads it: its topics as columns, those with damaged times left out."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats, Ints
from yawid.errors import SourceError
from yawid.sources.logs.as_mavlink import quiet, steady

UlogTopic = Mapping[str, NDArray[Any]]
_OLDEST_SAMPLE_US = 1_000_000  # no sample is published later than this


def parsed(path: Path, topics: Iterable[str]) -> Any:
    """Return pyulog's ULog of these topics.

    Raises:
        SourceError: pyulog is missing, or can read none of them.
    """
    try:
        from pyulog import ULog
    except ImportError as error:
        raise SourceError(
            f"{path} is a PX4 ULog: reading it needs pyulog (pip install 'yawid[ulog]')"
        ) from error
    said = io.StringIO()
    try:
        # pyulog reports of damage by printing to stdout, where our results go.
        with path.open("rb") as file, contextlib.redirect_stdout(said):
            log = ULog(file, list(topics))
    except Exception as error:  # whatever pyulog raises at a damaged byte
        raise SourceError(f"{path} cannot be read as a ULog ({error}): copy it again") from error
    if not log.data_list:
        raise SourceError(f"{path} is a ULog without any of the topics needed: nothing to read")
    return log


def topics_of(log: Any) -> dict[tuple[str, int], UlogTopic]:
    """Return the topics by name and instance, each column (n,) by its name."""
    found: dict[tuple[str, int], UlogTopic] = {}
    for topic in log.data_list:
        if "timestamp" not in topic.data:
            continue
        rows = steady(topic.data["timestamp"].astype(np.int64))
        columns = {name: column[rows] for name, column in topic.data.items()}
        found[topic.name, topic.multi_id] = columns
    return found


def published(topic: UlogTopic) -> Ints:
    """Return when the rows (n,) were published, in microseconds since boot."""
    return topic["timestamp"].astype(np.int64)


def sampled(topic: UlogTopic) -> Ints:
    """Return when the values (n,) were sampled, or where that is not reported published."""
    t_us = published(topic)
    sampled = topic.get("timestamp_sample", np.zeros(len(t_us))).astype(np.int64)
    return np.where((sampled > 0) & (np.abs(t_us - sampled) < _OLDEST_SAMPLE_US), sampled, t_us)


def array(topic: UlogTopic, name: str, size: int) -> Floats:
    """Return the columns name[0], name[1], ... as (n, size), NaN where the log has fewer."""
    values = np.full((len(topic["timestamp"]), size), np.nan)
    with quiet():
        for i in range(size):
            if f"{name}[{i}]" in topic:
                values[:, i] = topic[f"{name}[{i}]"]
    return values
