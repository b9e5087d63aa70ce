"""When a record's rows were: seconds, Unix time or dates to microseconds since its start."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

import numpy as np

from yawid.blocks import Floats, Ints

UNIX_S: Final = 1e9
"""Seconds since 1970 in the year 2001: no boot lasts as long, no record is older."""
LATEST_S: Final = 4.2e9
"""... and in 2103."""
NO_DATE: Final = np.iinfo(np.int64).min
FIRST_YEAR, LAST_YEAR = 1970, 2199
NO_TIME: Final = "is no time: seconds, Unix time or ISO 8601 with a date is needed"
"""What is said of a text that is none."""
_ISO_UTC: Final = re.compile(
    r"((?:19[789]|20\d|21\d)\d-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?)"
    r"(?:[Zz]|\+00:?00| UTC)?",
    re.ASCII,
)


def dates_ns_of(texts: Sequence[str]) -> Ints:
    """Return the Unix time in ns (n,) of ISO 8601 texts, ``NO_DATE`` where one is empty.

    A time without a zone is UTC.

    Raises:
        ValueError: a text is no such date; it is the error's text.
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
    """Tell whether times in s (n,), at least one being known, count from 1970."""
    known = t_s[np.isfinite(t_s)]
    return bool(known.min() >= UNIX_S and known.max() < LATEST_S)


def offsets_us(t_us: Ints, unix_ns: Ints) -> Ints:
    """Return Unix minus boot time in us (n,) where dates (n,) are known, held to the next one.

    0 where none is known at all: then nobody knows the date.
    """
    known = np.flatnonzero(unix_ns != NO_DATE)
    if not len(known):
        return np.zeros(len(t_us), np.int64)
    found = np.floor_divide(unix_ns[known] + 500, 1000) - t_us[known]
    newest = np.maximum(np.searchsorted(known, np.arange(len(t_us)), side="right") - 1, 0)
    held: Ints = found[newest]
    return held
