"""The values of a row: plain numbers, None in place of what is not finite, and known dates."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from yawid.blocks import FIRST_DATE_US
from yawid.version import __version__

_SERIAL = re.compile(r"^BRD_SERIAL_NUM (-?\d+)(?:\.\d*)?$", re.MULTILINE)
Row = dict[str, Any]
"""A row of a table by column name, or an object in the manifest."""
ReadRow = Mapping[str, Any]
"""A row that is only read."""
Entry = Mapping[str, Sequence[ReadRow]]
"""All rows of one log by table; ``logs`` has exactly one."""


def plain(value: Any) -> Any:
    """Return a value with Python's scalars throughout, and with NaN and infinity as None."""
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list):
        return [plain(each) for each in value]
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def known_date(us: int | None) -> int | None:
    """Return ``us`` if it is a time since 1970, and None if it is only a time since boot."""
    return us if us is not None and us >= FIRST_DATE_US else None


def serial_of(parameters: bytes) -> str | None:
    """Return the serial number, ``serial:N``, by BRD_SERIAL_NUM; None if it is 0 or missing."""
    found = _SERIAL.search(parameters.decode("utf-8", "replace"))
    return None if found is None or not int(found[1]) else f"serial:{int(found[1])}"


FAILED = "failed"
"""Outcome of a log that was not read for a reason that may pass: the next run tries it again."""
USAGE = "usage"
"""Outcome of a log that the options do not fit: it gets no row, the user changes the options."""


def failed(outcome: str, text: str, reason: str | None = None) -> dict[str, list[Row]]:
    """Return the rows of a log without an answer; ``reason`` is by default the outcome's name."""
    row = {"outcome": outcome, "reasons": [reason or outcome], "warnings": [], "text": text}
    return {"logs": [{**row, "yawid_version": __version__, "flights": 0, "manoeuvres": 0}]}
