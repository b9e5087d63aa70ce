"""What a row may hold: plain numbers, None in place of what is not finite, dates that are known."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from yawid.blocks import FIRST_DATE_US
from yawid.version import __version__

_SERIAL = re.compile(r"^BRD_SERIAL_NUM (-?\d+)(?:\.\d*)?$", re.MULTILINE)
Row = dict[str, Any]
"""A row of a table by its columns, or an object in the manifest."""
ReadRow = Mapping[str, Any]
"""One that is only read."""
Entry = Mapping[str, Sequence[ReadRow]]
"""All rows of one log, by table; ``logs`` has exactly one."""


def plain(value: Any) -> Any:
    """Return a value as a row may hold it: NumPy's scalars as Python's, NaN and infinity as None.

    Rows and lists are gone through.
    """
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list):
        return [plain(each) for each in value]
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def known_date(us: int | None) -> int | None:
    """Return us since 1970; None where it is a time since boot."""
    return us if us is not None and us >= FIRST_DATE_US else None


def serial_of(parameters: bytes) -> str | None:
    """Return a vehicle's own number by its BRD_SERIAL_NUM among a run's parameters.txt, or None."""
    found = _SERIAL.search(parameters.decode("utf-8", "replace"))
    return None if found is None or not int(found[1]) else f"serial:{int(found[1])}"


FAILED = "failed"
"""The outcome of a log that was not read for a reason that may pass: the next run tries again."""


def failed(outcome: str, text: str, reason: str | None = None) -> dict[str, list[Row]]:
    """Return the rows of a log that came to nothing, for a reason that is the outcome's name."""
    row = {"outcome": outcome, "reasons": [reason or outcome], "warnings": [], "text": text}
    return {"logs": [{**row, "yawid_version": __version__, "flights": 0, "manoeuvres": 0}]}
