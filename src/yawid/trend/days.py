"""Combines the flights of each day flown into one number.

Flights of one day share errors that their sigmas do not contain: the air, the load, the battery,
the pilot. So each day counts as one number, however many flights it has: the mean of its flights,
weighted by 1 / (sigma² + within²). ``within`` is the scatter between flights of one day that their
sigmas do not explain. The scatter between days that is left over is tau.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Final, TypeVar

import numpy as np

from yawid.blocks import Bools, Floats, Ints

_Each = TypeVar("_Each")
HOUR_US: Final = 3_600_000_000
DAY_US: Final = 24 * HOUR_US
NIGHT_US: Final = 6 * HOUR_US
"""A longer time between two flights ends a day. Midnight in UTC does not: it may be in daylight."""
LONGEST_US: Final = 18 * HOUR_US
"""Longest day, from its first flight, if no night ends it."""
YEAR_US: Final = 365.25 * DAY_US
LEAST_YEARS: Final = 2.0
"""Least time in years between the first day and the last for a season to be fitted."""
LEAST_QUARTERS: Final = 3
"""Least number of quarters of the year with a flight for a season to be fitted."""
LEAST_SEASON_DAYS: Final = 24
"""Least number of days for a season to be fitted, which has two parameters."""
FAR: Final = 2.75
"""Distance in sigmas beyond which a flight or a day has no weight."""
MEDIAN_CHI2: Final = 0.4549364231195724
"""Median of a squared standard normal deviate."""
_AROUND: Final = 4
"""Number of flights on each side of one whose median it is compared with."""


@dataclass(frozen=True)
class Track:
    """One number of one vehicle in the order of its n flights: value (n,) and total sigma (n,).

    ``dates`` (n,) is the time of each flight in us since 1970.
    """

    value: Floats
    sigma: Floats
    dates: Ints

    @cached_property
    def day(self) -> Ints:
        """Return the number of each flight's day (n,), from 0."""
        return days_of(self.dates)


@dataclass(frozen=True)
class Days:
    """The d days of a track: each day's value (d,), and its sigma (d,), which contains ``within``.

    ``day`` (n,) is the number of each flight's day, ``year`` (d,) the day's date in years since
    1970.
    """

    value: Floats
    sigma: Floats
    day: Ints
    year: Floats

    def mean(self, x: Floats) -> Floats:
        """Return the mean (d,) of x (n,) over the flights of each day."""
        return np.bincount(self.day, x) / np.bincount(self.day)

    @cached_property
    def steady(self) -> Floats:
        """Return the columns (d, 1 or 3) of a fit without a change: a constant, and a season.

        The season is left out unless :attr:`shows_season`.
        """
        ones = np.ones(len(self.year))
        if not self.shows_season:
            return ones[:, None]
        turn = 2.0 * np.pi * self.year
        return np.column_stack([ones, np.cos(turn), np.sin(turn)])

    @cached_property
    def shows_season(self) -> bool:
        """Whether the days suffice to fit a season: two years, and most quarters of the year."""
        if len(self.year) < LEAST_SEASON_DAYS:
            return False
        quarters = np.unique(np.floor(4.0 * self.year).astype(int) % 4)
        return bool(np.ptp(self.year) >= LEAST_YEARS and len(quarters) >= LEAST_QUARTERS)


def date(us: int) -> str:
    """Return a time in us since 1970 as ISO 8601 in UTC."""
    return datetime.fromtimestamp(int(us) / 1e6, UTC).isoformat(timespec="seconds")


def alike(every: Iterable[_Each], key: Callable[[_Each], Hashable]) -> list[list[_Each]]:
    """Return what has the same key together, in the order of the first ones."""
    found: dict[Hashable, list[_Each]] = {}
    for each in every:
        found.setdefault(key(each), []).append(each)
    return list(found.values())


def days_of(date_us: Ints) -> Ints:
    """Return the number of each flight's day (n,), from 0; the dates (n,) in us are sorted."""
    day = np.zeros(len(date_us), dtype=np.int64)
    begin = date_us[0] if len(date_us) else 0
    for i in range(1, len(date_us)):
        is_new = date_us[i] - date_us[i - 1] > NIGHT_US or date_us[i] - begin > LONGEST_US
        begin = date_us[i] if is_new else begin
        day[i] = day[i - 1] + is_new
    return day


def within_tau2(tracks: Sequence[Track]) -> float:
    """Return ``within``² of all tracks: tau² between flights of one day; 0 if no day has two."""
    return neighbours_tau2((t.value, t.sigma, np.diff(t.day) == 0) for t in tracks)


def neighbours_tau2(parts: Iterable[tuple[Floats, Floats, Bools | slice]]) -> float:
    """Return tau² from the differences of neighbours, which slow changes hardly affect.

    Each part has values (n,), their sigmas (n,), and which of the n - 1 differences count.
    """
    pairs = [
        (np.diff(value)[counts] ** 2, (sigma[1:] ** 2 + sigma[:-1] ** 2)[counts])
        for value, sigma, counts in parts
    ]
    r2, s2 = (np.concatenate(each) for each in zip(*pairs, strict=True))
    return solve_tau2(r2 / 2.0, s2 / 2.0)


def by_day(track: Track, within2: float) -> Days:
    """Return the days of a track; flights far off have no weight unless all of their day are."""
    day, count = track.day, int(track.day[-1]) + 1
    w = 1.0 / np.maximum(track.sigma**2 + within2, 1e-12)
    if count < len(day):
        near = _near(track)
        some = np.bincount(day, near) > 0
        w = np.where(near | ~some[day], w, 0.0)
    total = np.bincount(day, w)
    value = np.bincount(day, w * track.value) / total
    year = np.bincount(day, track.dates / YEAR_US) / np.bincount(day)
    return Days(value, 1.0 / np.sqrt(total), day, year)


def _near(track: Track) -> Bools:
    """Return which flights (n,) are at most FAR sigmas off the median of their neighbours."""
    off = np.abs(track.value - local_median(track.value))
    scale2 = track.sigma**2 + solve_tau2(off**2, track.sigma**2)
    return off <= FAR * np.sqrt(scale2)


def local_median(y: Floats) -> Floats:
    """Return the running median of nine values of y (n,), or of each row of y (r, n).

    If a row has eight values or fewer, it is their median.
    """
    if y.shape[-1] <= 2 * _AROUND:
        return np.broadcast_to(np.median(y, axis=-1, keepdims=True), y.shape)
    padded = np.pad(y, [(0, 0)] * (y.ndim - 1) + [(_AROUND, _AROUND)], mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1, axis=-1)
    return np.median(around, axis=-1)


def solve_tau2(r2: Floats, s2: Floats) -> float:
    """Return the tau² at which half of r² / (s² + tau²) is below the median of chi²; at least 0.

    One of these ratios is below that median if tau² is above r² / median - s².
    """
    return max(0.0, float(np.median(r2 / MEDIAN_CHI2 - s2))) if len(r2) else 0.0
