"""The times of a record's rows: seconds, Unix time or dates as microseconds since its start."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

import numpy as np

from yawid.blocks import Floats, Ints

UNIX_S: Final = 1e9
"""The least number of seconds that counts as Unix time (2001): no boot lasts as long."""
LATEST_S: Final = 4.2e9
"""The greatest number of seconds that counts as Unix time (2103)."""
NO_DATE: Final = np.iinfo(np.int64).min
"""The Unix time in ns that stands for an unknown date."""
FIRST_YEAR, LAST_YEAR = 1970, 2199
NO_TIME: Final = "is not a time: seconds, Unix time or ISO 8601 with a date is needed"
"""The end of the error about a text that is not a time."""
_ISO_UTC: Final = re.compile(
    r"((?:19[789]|20\d|21\d)\d-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?)"
    r"(?:[Zz]|\+00:?00| UTC)?",
    re.ASCII,
)


def dates_ns_of(texts: Sequence[str]) -> Ints:
    """Return the Unix time in ns (n,) of ISO 8601 texts, ``NO_DATE`` where one is empty.

    A time without a zone is UTC.

    Raises:
        ValueError: a text is no such date; the error's text is this text.
    """
    plain = [_ISO_UTC.fullmatch(text) if text else None for text in texts]
    try:
        if all(found or not text for found, text in zip(plain, texts, strict=True)):
            whole = [found.group(1) if found else "NaT" for found in plain]
            return np.array(whole, "datetime64[ns]").astype(np.int64)
    except ValueError:
        pass
    return np.array([_one_ns(text) for text in texts], np.int64)


def _one_ns(text: str) -> int:
    if not text:
        return int(NO_DATE)
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(text) from None
    if len(text) < len("2024-01-01T00:00") or not FIRST_YEAR <= when.year <= LAST_YEAR:
        raise ValueError(text)
    when = when.replace(tzinfo=UTC) if when.tzinfo is None else when
    whole = round(when.replace(microsecond=0).timestamp())
    return whole * 10**9 + when.microsecond * 1000


def is_unix(t_s: Floats) -> bool:
    """Return whether times in s (n,), of which at least one is known, count from 1970."""
    known = t_s[np.isfinite(t_s)]
    return bool(known.min() >= UNIX_S and known.max() < LATEST_S)


def offsets_us(t_us: Ints, unix_ns: Ints) -> Ints:
    """Return Unix minus boot time in us (n,) from known dates (n,), each held to the next one.

    It is 0 if all dates are unknown.
    """
    known = np.flatnonzero(unix_ns != NO_DATE)
    if not len(known):
        return np.zeros(len(t_us), np.int64)
    found = np.floor_divide(unix_ns[known] + 500, 1000) - t_us[known]
    newest = np.maximum(np.searchsorted(known, np.arange(len(t_us)), side="right") - 1, 0)
    held: Ints = found[newest]
    return held
