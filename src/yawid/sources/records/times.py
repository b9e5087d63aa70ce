"""The times of a record's rows: seconds, Unix time or dates as microseconds since its start."""

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
