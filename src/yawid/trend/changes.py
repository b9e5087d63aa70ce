"""Changes in a vehicle's numbers over the days it flew, found among many vehicles.

Pure statistics, on arrays. What a vehicle says on one day is one number (trend/days.py). It
scatters by its own sigma and by tau, what days of one vehicle differ by beyond it. A change is a
profile over the days: 0 before, 1 after, a straight line between (a step has no day between).
Every profile is fitted by weighted least squares next to a constant, and, where two years show it,
a season. A day FAR off counts as one just so far off in either, and the t of the best is judged
with the scatter of this vehicle and of the fleet together (Smyth 2004, moderated t: where the
vehicles scatter alike, each has the degrees of freedom of all).

P(the best of all profiles has |t| > c) is some ``looks(n)`` times that of a single one: looks is
from drawn histories without a change (tools/checks/judge_trend.py). Of 60 000 more, drawn as the
tool draws them, p was below 1/6000, the limit of 60 histories, .8 times as often as it says; of
histories of 12 to 20 days 1.5 times, and with 10 % of outliers instead of 5 twice as often.

A history is looked at after every day flown, by whoever looks: ``nights(n)`` is by how much p grows
so that all looks together, however many follow, err no more often than p says. Nothing is kept for
it. And where fewer than two years are there, a change is only as clear as what is left of it when a
season of SEASON has made as much of it as it can.
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
    solve_tau2,
    within_tau2,
)
from yawid.trend.moderated import moderated, prior, two_sided

SEASON: Final = 0.04
"""Of a number, by which a year may swing it either way: cold air is some 8 % denser than the mean,
and zeta goes with the root of it."""
NIGHTS: Final = 4.0
"""A look's part of all looks, by draws (tools/checks/judge_trend.py nights)."""
_SHARE: Final = {True: 0.75, False: 0.25}
"""Of the false alarms, of slow changes, which wear makes and which are cheap to test, and quick."""
_LEAST_S2: Final = 1e-4
"""Of scatter: below, numbers were rounded."""
_MEDIAN_EFFICIENCY: Final = 0.37
"""Of a scatter by the median."""


@dataclass(frozen=True, slots=True)
class Change:
    """The profile that fits a history best.

    first, last: days (from 0) between which it happens, before that ``before``, after it
    ``after`` (units of the values); std of the difference; p: probability of as much without any
    change, of one history in all its looks; p_if_no_season: that, if no season could swing it.
    """

    first: int
    last: int
    before: float
    after: float
    std: float
    t: float
    p: float
    p_if_no_season: float

    @property
    def is_step(self) -> bool:
        """Whether it happens from one day to the next."""
        return self.last == self.first + 1


@dataclass(frozen=True, slots=True)
class Fitted:
    """What a history says: its best change (None: too few days) and how it scatters.

    days, and of each (d,) the std of its number, tau in it; std (n,): of a flight, sigma and what
    flights scatter by beyond it, this vehicle's; tau: that scatter; s2: by how much the variances
    exceed that of sigma and tau; its dof.
    """

    change: Change | None
    days: Days
    day_std: Floats
    std: Floats
    tau: float
    s2: float
    dof: float


def profile(n: int, change: Change) -> Floats:
    """Return the profile (n,) of a change: 0 before it, 1 after."""
    found: Floats = np.clip((np.arange(n) - change.first) / (change.last - change.first), 0.0, 1.0)
    return found


def looks(n: int, *, slow: bool) -> float:
    """Return by how many profiles' worth a history of n flights is looked at, slow or quick.

    Slow profiles are much alike. Of quick ones every few flights have their own, and some of them
    fit a few outliers in a row.
    """
    return 2.5 if slow else 25.0 * float(np.log(n / 8.0))


def nights(n: int) -> float:
    """Return by how many single looks' worth a history is looked at, after each of its n days.

    Neighbouring looks see nearly the same: what is new goes with the logarithm of n. The square
    makes the sum over all days to come finite.
    """
    return NIGHTS * (1.0 + float(np.log(n / LEAST_DAYS))) ** 2


def fit_tracks(tracks: Sequence[Track]) -> list[Fitted]:
    """Fit the histories of one number in all vehicles; each has at least one flight."""
    return fit_fleets([tracks])[0]


def fit_fleets(fleets: Sequence[Sequence[Track]]) -> list[list[Fitted]]:
    """Fit several fleets or numbers, each by itself; all at once is quicker."""
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
    """One number in all vehicles, each in units of its own level."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        self.units = [_unit(track) for track in tracks]
        self.tracks = [
            Track(t.value / u, t.sigma / u, t.dates)
            for t, u in zip(tracks, self.units, strict=True)
        ]
        self.within2 = within_tau2(self.tracks)
        self.days = [by_day(track, self.within2) for track in self.tracks]
        self.tau2 = _first_tau2(self.days)
        self.scale: Floats = np.ones(len(tracks))

    def see_scatter(self, fits: Sequence[Fit]) -> None:
        """Find tau, and by how much each vehicle scatters more than its sigmas and tau."""
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
        # No vehicle's scatter is known better than that of all together.
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
    """Return the variance of numbers of a sigma, tau and s2.

    Sigmas have parts in common: flights may agree better, but none is known better than that.
    """
    found: Floats = np.maximum(s2 * variance(sigma, tau2), sigma**2)
    return found


def _unit(track: Track) -> float:
    level = abs(float(np.median(track.value)))
    return max(level, float(np.median(track.sigma)), 1e-12)


def _first_tau2(days: Sequence[Days]) -> float:
    """Return tau² from differences of neighbours, which no slow change moves."""
    pairs = [(np.diff(d.value) ** 2, d.sigma[1:] ** 2 + d.sigma[:-1] ** 2) for d in days]
    d2 = np.concatenate([np.zeros(0), *(pair[0] for pair in pairs)])
    s2 = np.concatenate([np.zeros(0), *(pair[1] for pair in pairs)])
    return solve_tau2(d2 / 2.0, s2 / 2.0)


def _tau2(days: Sequence[Days], fits: Sequence[Fit]) -> float:
    """Return tau² of the fleet, robust against days far off."""
    many = [(d, f) for d, f in zip(days, fits, strict=True) if f.dof > 0]
    r2 = [(d.value - f.fitted) ** 2 * len(d.value) / f.dof for d, f in many]
    s2 = [d.sigma**2 for d, _ in many]
    return solve_tau2(np.concatenate(r2), np.concatenate(s2)) if many else 0.0


def _rough_s2(days: Days, fit: Fit, tau2: float) -> float:
    """Return by how much a vehicle's residuals exceed their sigmas, squared, by their median."""
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
