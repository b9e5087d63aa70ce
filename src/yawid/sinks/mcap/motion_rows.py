"""The lateral motion as protobuf messages, and back: one message for each one received."""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Final

import numpy as np

from yawid.blocks import Array, Ints, MotionBlock, StampedRows
from yawid.sinks.mcap.protobuf_rows import RowLayout
from yawid.sinks.mcap.schemas import MOTION, MOTION_TABLE, TOPICS, descriptor

LARGEST: Final = 1e16
"""The largest value in a row: a time in us is 1e12 after twelve days."""
_FIELDS: Final = {
    topic: tuple(name for name, _ in fields[1:])
    for topic, fields in zip(MOTION, MOTION_TABLE.values(), strict=True)
}
"""The columns of a topic's values, after ``boot_time``."""


@lru_cache
def _layout(topic: str) -> RowLayout:
    return RowLayout(descriptor(TOPICS[topic]), {})


def motion_messages(block: MotionBlock) -> Iterator[tuple[str, Ints, Array]]:
    """Yield topic, log times in ns (n,) and messages (n,) of each kind of row in the block."""
    parts = zip(MOTION, (block.attitude, block.commands, block.acceleration), strict=True)
    for topic, part in parts:
        if len(part):
            rows = _layout(topic).rows(len(part))
            rows["boot_time"] = part.t_us / 1e6
            for name, column in zip(_FIELDS[topic], part.values.T, strict=True):
                rows[name] = np.where(np.isnan(column), np.nan, column)
            yield topic, part.unix_ns, rows


def motion_from(messages: Mapping[str, tuple[list[int], list[bytes]]]) -> MotionBlock:
    """Return what :func:`motion_messages` wrote, from log times and messages by topic.

    Raises:
        ValueError: a message has another size, or holds a value that no run writes.
    """
    return MotionBlock(*(_stamped(topic, *messages[topic]) for topic in MOTION))


def _stamped(topic: str, log_ns: list[int], data: list[bytes]) -> StampedRows:
    layout = _layout(topic)
    if any(len(each) != layout.size for each in data):
        raise ValueError(f"messages of different sizes in {topic}")
    rows = np.frombuffer(b"".join(data), layout.dtype)
    values = np.column_stack([rows[name] for name in _FIELDS[topic]])
    times = rows["boot_time"]
    if not (np.abs(times) < LARGEST / 1e6).all() or (np.abs(values) >= LARGEST).any():
        raise ValueError(f"a value in {topic} is impossible")
    t_us = np.rint(times * 1e6).astype(np.int64)
    return StampedRows(t_us, np.array(log_ns, np.int64), values)
