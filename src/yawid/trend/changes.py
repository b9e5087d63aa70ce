"""Finds changes in a vehicle's numbers over the days it flew, among many vehicles.

This file is pure statistics on arrays. All flights of one day are one number (trend/days.py). The
numbers of a vehicle scatter by their own sigma and by tau, the scatter between days that sigma does
not explain. A change is a profile over the days: 0 before it, 1 after it, and a straight line
between (a step has no day between). Each profile is fitted by weighted least squares together with
a constant and, if two years of days show one, a season. A day more than FAR sigmas off counts as
one that is exactly FAR off, with the profile and without it. The t of the best profile is judged
with the scatter of this vehicle and of the fleet together (Smyth 2004, moderated t: if the vehicles
scatter alike, each has the degrees of freedom of all).

The probability that the best of all profiles has |t| > c is about ``looks(n)`` times that of a
single profile. ``looks`` was fitted to drawn histories without a change
(tools/checks/judge_trend.py). In 60 000 further histories, drawn by the same tool, p was below
1/6000 (the limit for 60 histories) 0.8 times as often as it should be; in histories of 12 to 20
days 1.5 times as often; and with 10 % outliers instead of 5 %, twice as often.

A history may be tested after every day flown. ``nights(n)`` raises p so that all these tests
together, however many follow, raise a false alarm no more often than p says; no state is kept for
this. With less than two years of flights, a change is tested by what is left of it after a season
of amplitude SEASON has explained as much of it as it can.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.trend.best_profile import LEAST_DAYS, Fit, fit_best, profiles, variance
from yawid.trend.days import (
    MEDIAN_CHI2,
    Days,
    Track,
    by_day,
    neighbours_tau2,
    solve_tau2,
    within_tau2,
)
from yawid.trend.moderated import moderated, prior, two_sided

SEASON: Final = 0.04
"""Amplitude of a season as a fraction of the number: cold air is some 8 % denser than the mean, and
zeta is proportional to the square root of the density."""
NIGHTS: Final = 4.0
"""Factor of :func:`nights`, found by drawing histories (tools/checks/judge_trend.py rates)."""
_SHARE: Final = {True: 0.75, False: 0.25}
"""Shares of the false alarms that slow changes (True) and quick ones (False) may cause. Wear is
slow, and slow changes cost few looks."""
_LEAST_S2: Final = 1e-4
"""Least ``s2`` with which a change is judged: numbers that scatter less were rounded."""
_MEDIAN_EFFICIENCY: Final = 0.37
"""Degrees of freedom of a variance found by the median, as a fraction of those of the mean."""


@dataclass(frozen=True, slots=True)
class Change:
    """The profile that fits a history best, in the units of its values."""

    first: int
    """The last day (from 0) with the value ``before``."""
    last: int
    """The first day (from 0) with the value ``after``."""
    before: float
    after: float
    std: float
    """Standard deviation of the difference ``after - before``."""
    t: float
    """Signed square root of :attr:`Fit.g2` / s2: how clear the change is, in sigmas."""
    p: float
    """Probability that a history with no more than a season shows as much in any of its tests."""
    p_if_no_season: float
    """Probability that a history without change or season shows as much in any of its tests."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """A history's best change, and how its days and flights scatter, in the units of its values."""

    change: Change | None
    """The best change; None if there are too few days."""
    days: Days
    day_std: Floats
    """Standard deviation of each day's number (d,), from sigma and the scatter between days."""
    std: Floats
    """Standard deviation of each flight's number (n,), from sigma and this vehicle's scatter."""
    tau: float
    """Scatter between flights that their sigmas do not explain, of the whole fleet."""
    s2: float
    """The vehicle's variance as a multiple of sigma² + tau²."""
    dof: float
    """Degrees of freedom of ``s2``, with those that the fleet lends."""


def profile(n: int, change: Change) -> Floats:
    """Return the profile (n,) of a change over n days: 0 before it, 1 after it."""
    return np.clip((np.arange(n) - change.first) / (change.last - change.first), 0.0, 1.0)


def looks(n: int, *, slow: bool) -> float:
    """Return how many independent profiles the slow or quick ones of n days are worth.

    Slow profiles resemble each other. Quick ones differ every few days, and some of them fit a few
    outliers in a row.
    """
    return 2.5 if slow else 25.0 * float(np.log(n / 8.0))


def nights(n: int) -> float:
    """Return how many independent tests the tests after each of n days are worth.

    Tests on neighbouring days see nearly the same data: new information grows as the logarithm of
    n. The square keeps the sum over all future days finite.
    """
    return NIGHTS * (1.0 + float(np.log(n / LEAST_DAYS))) ** 2


def fit_fleets(fleets: Sequence[Sequence[Track]]) -> list[list[Fitted]]:
    """Fit several fleets or numbers, each by itself: one call is quicker than many.

    A fleet has the histories of one number in all vehicles; each needs at least one flight.
    """
    parts = [_Fleet(tracks) for tracks in fleets]
    for part, fits in zip(parts, _fits(parts), strict=True):
        part.see_scatter(fits)
    both = [_fits(parts, slow=slow) for slow in (True, False)]
    return [part.judged(slow, quick) for part, slow, quick in zip(parts, *both, strict=True)]


def _fits(parts: Sequence["_Fleet"], *, slow: bool | None = None) -> list[list[Fit]]:
    """Return the fits of every fleet's histories."""
    counts = [len(part.days) for part in parts]
    found = fit_best(
        [days for part in parts for days in part.days],
        np.repeat([part.tau2 for part in parts], counts),
        np.concatenate([np.zeros(0), *(part.scale for part in parts)]),
        slow=slow,
    )
    ends = np.cumsum([0, *counts])
    return [found[i:j] for i, j in pairwise(ends)]


class _Fleet:
    """One number in all vehicles, each divided by its own level."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        self.units = [_unit(track) for track in tracks]
        self.tracks = [
            Track(t.value / u, t.sigma / u, t.dates)
            for t, u in zip(tracks, self.units, strict=True)
        ]
        self.within2 = within_tau2(self.tracks)
        self.days = [by_day(track, self.within2) for track in self.tracks]
        self.tau2 = neighbours_tau2((d.value, d.sigma, slice(None)) for d in self.days)
        self.scale: Floats = np.ones(len(tracks))

    def see_scatter(self, fits: Sequence[Fit]) -> None:
        """Find tau, and each vehicle's scatter as a multiple of what its sigmas and tau explain."""
        self.tau2 = _tau2(self.days, fits)
        rough = np.array([_rough_s2(*each, self.tau2) for each in
                          zip(self.days, fits, strict=True)])  # fmt: skip
        dof = _MEDIAN_EFFICIENCY * np.array([fit.dof for fit in fits])
        self.scale = np.sqrt(moderated(rough, dof, prior(rough, dof)))

    def judged(self, slow: Sequence[Fit], quick: Sequence[Fit]) -> list[Fitted]:
        """Judge the best slow change of each vehicle and the best quick one."""
        pairs = list(zip(slow, quick, strict=True))
        fits = [max(pair, key=lambda fit: fit.g2) for pair in pairs]
        dof, s2 = np.array([fit.dof for fit in fits]), np.array([fit.s2 for fit in fits])
        lent = prior(s2, dof)
        s2 = moderated(s2, dof, lent)
        # No vehicle has more degrees of freedom than all vehicles have together.
        own = np.maximum(dof, 0.0)
        dof = np.minimum(lent[0] + own, own.sum())
        return [self._judged(i, pair, float(s2[i]), float(dof[i])) for i, pair in enumerate(pairs)]

    def _judged(self, i: int, pair: Sequence[Fit], s2: float, dof: float) -> Fitted:
        unit, days = self.units[i], self.days[i]
        day_std = unit * np.sqrt(scatter(days.sigma, self.tau2, s2))
        tau2 = self.within2 + self.tau2
        std = unit * np.sqrt(scatter(self.tracks[i].sigma, tau2, s2))
        change_s2 = max(s2, _LEAST_S2)
        known = [_change(len(day_std), unit, fit, change_s2, dof) for fit in pair]
        changes = [change for change in known if change is not None]
        change = min(changes, key=lambda each: (each.p, -abs(each.t))) if changes else None
        in_units = replace(days, value=unit * days.value, sigma=unit * days.sigma)
        return Fitted(change, in_units, day_std, std, unit * float(np.sqrt(tau2)), s2, dof)


def scatter(sigma: Floats, tau2: float, s2: float) -> Floats:
    """Return the variance of numbers: s2 (sigma² + tau²), but at least sigma².

    The sigmas of several flights share errors: flights may agree better than their sigmas say, but
    none of them is more accurate than its sigma.
    """
    return np.maximum(s2 * variance(sigma, tau2), sigma**2)


def _unit(track: Track) -> float:
    level = abs(float(np.median(track.value)))
    return max(level, float(np.median(track.sigma)), 1e-12)


def _tau2(days: Sequence[Days], fits: Sequence[Fit]) -> float:
    """Return tau² of the fleet from the days' residuals, robust against outliers."""
    many = [(d, f) for d, f in zip(days, fits, strict=True) if f.dof > 0]
    r2 = [(d.value - f.fitted) ** 2 * len(d.value) / f.dof for d, f in many]
    s2 = [d.sigma**2 for d, _ in many]
    return solve_tau2(np.concatenate(r2), np.concatenate(s2)) if many else 0.0


def _rough_s2(days: Days, fit: Fit, tau2: float) -> float:
    """Return a vehicle's variance as a multiple of sigma² + tau², from the residuals' median."""
    if fit.dof <= 0:
        return np.nan
    r2 = (days.value - fit.fitted) ** 2 / variance(days.sigma, tau2)
    return float(np.median(r2)) / MEDIAN_CHI2 * len(r2) / fit.dof


def _change(n: int, unit: float, fit: Fit, s2: float, dof: float) -> Change | None:
    if fit.best is None or not fit.dof > 0 or not s2 > 0:
        return None
    _, ends, is_slow = profiles(n)
    first, last = ends[fit.best]
    t = float(np.sign(fit.slope) * np.sqrt(fit.g2 / s2))
    of_a_season = SEASON * abs(fit.level) * fit.swing / max(abs(fit.slope), 1e-30)
    slow = bool(is_slow[fit.best])
    times = nights(n) * looks(n, slow=slow) / _SHARE[slow]
    p, p_if_no_season = (
        min(1.0, times * two_sided(each, dof)) for each in (t * max(0.0, 1.0 - of_a_season), t)
    )
    std = unit * float(np.sqrt(s2 / fit.den))
    before, after = unit * fit.level, unit * (fit.level + fit.slope)
    return Change(int(first), int(last), before, after, std, t, p, p_if_no_season)
