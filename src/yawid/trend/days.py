"""Flights to days flown: what a vehicle says on one day is one number.

Flights of one day share more than their own sigmas say: the air, the load, the battery, the pilot.
So no day counts for more than one number, however many flights it has: the mean of its flights,
weighted by their sigmas and by ``within``, what flights of one day differ by beyond them. What days
differ by beyond that is tau, as it is found between days.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from yawid.blocks import Bools, Floats, Ints

HOUR_US: Final = 3_600_000_000
DAY_US: Final = 24 * HOUR_US
NIGHT_US: Final = 6 * HOUR_US
"""Without a flight, after which a day has ended. Dates are UTC: midnight may be an afternoon."""
LONGEST_US: Final = 18 * HOUR_US
"""Of a day, where no night ends it."""
YEAR_US: Final = 365.25 * DAY_US
LEAST_YEARS: Final = 2.0
LEAST_QUARTERS: Final = 3
LEAST_SEASON_DAYS: Final = 24
"""Years between the first day and the last, quarters of the year flown, and days, that show a
season; it has two numbers of its own."""
FAR: Final = 2.75
"""Sigmas off, beyond which a flight or a day has no weight."""
MEDIAN_CHI2: Final = 0.4549364231195724
"""Of a squared normal deviate."""
_AROUND: Final = 4
"""Flights on each side, to whose median a flight is compared."""


@dataclass(frozen=True)
class Track:
    """One number of one vehicle in the order of its flights: value (n,) and total sigma (n,).

    date_us (n,): when they were flown; without it each had a day of its own, one after the other.
    """

    value: Floats
    sigma: Floats
    date_us: Ints | None = None

    @cached_property
    def dates(self) -> Ints:
        """Return when each was flown (n,), in us."""
        if self.date_us is None:
            return np.arange(len(self.value), dtype=np.int64) * DAY_US
        return self.date_us

    @cached_property
    def day(self) -> Ints:
        """Return the day (n,) of each flight, from 0."""
        return days_of(self.dates)


@dataclass(frozen=True)
class Days:
    """A track's days: value (d,), sigma (d,) of their flights and ``within``.

    day (n,): each flight's; year (d,): when, in years since 1970.
    """

    value: Floats
    sigma: Floats
    day: Ints
    year: Floats

    def mean(self, x: Floats) -> Floats:
        """Return the mean (d,) over each day's flights of x (n,)."""
        return np.bincount(self.day, x) / np.bincount(self.day)

    @cached_property
    def first(self) -> Ints:
        """Return each day's first flight (d,)."""
        return np.searchsorted(self.day, np.arange(len(self.value)))

    @cached_property
    def last(self) -> Ints:
        """Return each day's last flight (d,)."""
        return np.searchsorted(self.day, np.arange(len(self.value)), side="right") - 1

    @cached_property
    def steady(self) -> Floats:
        """Return what is fitted where nothing changes (d, 1 or 3): a constant, and a season.

        The season is there where the days show one.
        """
        ones = np.ones(len(self.year))
        if not self.shows_season:
            return ones[:, None]
        turn = 2.0 * np.pi * self.year
        return np.column_stack([ones, np.cos(turn), np.sin(turn)])

    @cached_property
    def shows_season(self) -> bool:
        """Whether two years are there, flown in most of their quarters."""
        if len(self.year) < LEAST_SEASON_DAYS:
            return False
        quarters = np.unique(np.floor(4.0 * self.year).astype(int) % 4)
        return bool(np.ptp(self.year) >= LEAST_YEARS and len(quarters) >= LEAST_QUARTERS)


def days_of(date_us: Ints) -> Ints:
    """Return the day (n,), from 0, of flights in the order of their dates (n,)."""
    day = np.zeros(len(date_us), dtype=np.int64)
    begin = date_us[0] if len(date_us) else 0
    for i in range(1, len(date_us)):
        is_new = date_us[i] - date_us[i - 1] > NIGHT_US or date_us[i] - begin > LONGEST_US
        begin = date_us[i] if is_new else begin
        day[i] = day[i - 1] + is_new
    return day


def within_tau2(tracks: Sequence[Track]) -> float:
    """Return tau² between the flights of one day, of all tracks; 0 where no day has two."""
    r2, s2 = [np.zeros(0)], [np.zeros(0)]
    for track in tracks:
        same = np.diff(track.day) == 0
        r2.append(np.diff(track.value)[same] ** 2)
        s2.append((track.sigma[1:] ** 2 + track.sigma[:-1] ** 2)[same])
    return solve_tau2(np.concatenate(r2) / 2.0, np.concatenate(s2) / 2.0)


def by_day(track: Track, within2: float) -> Days:
    """Return the days of a track, without the flights that are far off where a day has others."""
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
    """Return which flights (n,) are near the median of those around them."""
    off = np.abs(track.value - local_median(track.value))
    scale2 = track.sigma**2 + solve_tau2(off**2, track.sigma**2)
    near: Bools = off <= FAR * np.sqrt(scale2)
    return near


def local_median(y: Floats) -> Floats:
    """Return the median of each one's neighbourhood of nine, in y (n,) or its rows (r, n)."""
    local: Floats
    if y.shape[-1] <= 2 * _AROUND:
        local = np.broadcast_to(np.median(y, axis=-1, keepdims=True), y.shape)
        return local
    padded = np.pad(y, [(0, 0)] * (y.ndim - 1) + [(_AROUND, _AROUND)], mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1, axis=-1)
    local = np.median(around, axis=-1)
    return local


def solve_tau2(r2: Floats, s2: Floats) -> float:
    """Return tau² at which half of r² / (s² + tau²) is below the median of chi²; at least 0.

    r² / (s² + tau²) is below it where tau² is above r² / median - s².
    """
    return max(0.0, float(np.median(r2 / MEDIAN_CHI2 - s2))) if len(r2) else 0.0
