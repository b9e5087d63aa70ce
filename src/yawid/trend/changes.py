"""Changes in a vehicle's numbers over its flights: steps and slopes, found among many vehicles.

Pure statistics, on arrays. A number of a flight scatters by its own total sigma and by tau, what
flights of one vehicle differ by beyond it. A change is a profile over the flights: 0 before, 1
after, a straight line between (a step has no flight between). Every profile is fitted by weighted
least squares beside a constant, a flight FAR off counts as one just so far off in either, and the
t of the best is judged with the scatter of this vehicle and of the fleet together (Smyth 2004,
moderated t: where the vehicles scatter alike, each has the degrees of freedom of all).

P(the best of all profiles has |t| > c) is some ``looks(n)`` times that of a single one: looks is
from drawn histories without a change (tools/judge_trend.py looks). Of 60 000 more, drawn as the
tool draws them, p was below 1/6000, the limit of 60 histories, .8 times as often as it says; of
histories of 12 to 20 flights 1.5 times, and with 10 % of outliers instead of 5 twice as often.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.special import digamma, polygamma, stdtr

from yawid.blocks import Bools, Floats

LEAST_FLIGHTS: Final = 12
LEAST_SIDE: Final = 4
"""Flights before the middle of a change, and after it: fewer may be outliers."""
FAR: Final = 2.75
"""Sigmas off the best profile, beyond which a flight has no weight in it."""
MOST_DOF: Final = 300.0
"""That the fleet's scatter may lend to a vehicle's."""
_WITHIN_FAR: Final = 0.9497
"""Variance of a normal deviate that is not FAR off."""
_SHARE: Final = {True: 0.75, False: 0.25}
"""Of the false alarms, of slow changes, which wear makes and which are cheap to test, and quick."""
_LEAST_S2: Final = 1e-4
"""Of scatter: below, numbers were rounded."""
_ROUNDS: Final = 4
_MEDIAN_EFFICIENCY: Final = 0.37
"""Of a scatter by the median."""
_MEDIAN_CHI2: Final = 0.4549364231195724
"""Of a squared normal deviate."""


@dataclass(frozen=True, slots=True)
class Track:
    """One number of one vehicle in the order of its flights: value (n,) and total sigma (n,)."""

    value: Floats
    sigma: Floats


@dataclass(frozen=True, slots=True)
class Change:
    """The profile that fits a history best.

    first, last: flights (from 0) between which it happens, before that ``before``, after it
    ``after`` (units of the values); std of the difference; p: probability of as much without any
    change, of one history.
    """

    first: int
    last: int
    before: float
    after: float
    std: float
    t: float
    p: float

    @property
    def is_step(self) -> bool:
        """Whether it happens from one flight to the next."""
        return self.last == self.first + 1


@dataclass(frozen=True, slots=True)
class Fitted:
    """What a history says: its best change (None: too few flights) and how it scatters.

    kept (n,): flights with weight; std (n,): of a flight, sigma and tau together, this vehicle's;
    tau: scatter between flights beyond sigma; dof of std.
    """

    change: Change | None
    kept: Bools
    std: Floats
    tau: float
    dof: float


@lru_cache(maxsize=128)
def profiles(n: int) -> tuple[Floats, Floats, Bools]:
    """Return profiles (m, n) of changes over n flights, their first and last flight (m, 2).

    And whether each is slow (m,): it takes half of the history or more.
    """
    ends: set[tuple[int, int]] = set()
    length, finest = 1.0, max(1, n // 100)
    while length <= n - 1:
        span = round(length)
        is_slow = 2 * span >= n
        for first in range(0, n - span, max(finest, span // (12 if is_slow else 6))):
            middle = first + span / 2.0
            if LEAST_SIDE - 0.5 <= middle <= n - LEAST_SIDE - 0.5:
                ends.add((first, first + span))
        length = max(length + 1.0, (1.12 if is_slow else 1.3) * length)
    found: Floats = np.array([*sorted(ends), (0, n - 1)], dtype=float)
    shapes = np.clip((np.arange(n) - found[:, :1]) / (found[:, 1:] - found[:, :1]), 0.0, 1.0)
    return shapes, found, 2.0 * (found[:, 1] - found[:, 0]) >= n


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


def fit_tracks(tracks: Sequence[Track]) -> list[Fitted]:
    """Fit the histories of one number in all vehicles; each has at least one flight."""
    units = [_unit(track) for track in tracks]
    scaled = [Track(t.value / u, t.sigma / u) for t, u in zip(tracks, units, strict=True)]
    tau2 = _first_tau2(scaled)
    fits = [_fit(track, tau2, 1.0) for track in scaled]
    tau2 = _tau2(scaled, fits)
    rough = np.array([_rough_s2(*each, tau2) for each in zip(scaled, fits, strict=True)])
    dof = np.array([fit.dof for fit in fits])
    lent = _prior(rough, _MEDIAN_EFFICIENCY * dof)
    scales = np.sqrt(_moderated(rough, _MEDIAN_EFFICIENCY * dof, lent))
    pairs = [
        [_fit(t, tau2, float(s), slow=slow) for slow in (True, False)]
        for t, s in zip(scaled, scales, strict=True)
    ]
    fits = [max(pair, key=lambda fit: fit.g2) for pair in pairs]
    dof, s2 = np.array([fit.dof for fit in fits]), np.array([fit.s2 for fit in fits])
    lent = _prior(s2, dof)
    s2 = _moderated(s2, dof, lent)
    dof = lent[0] + np.maximum(dof, 0.0)
    return [_judged(*each, tau2) for each in zip(scaled, units, pairs, s2, dof, strict=True)]


@dataclass(slots=True)
class _Fit:
    """Weighted fit in units of the vehicle's level: the best profile, its residuals and scatter."""

    best: int | None
    fitted: Floats
    kept: Bools
    g2: float
    slope: float
    level: float
    den: float
    s2: float
    dof: float


def _unit(track: Track) -> float:
    level = abs(float(np.median(track.value)))
    return max(level, float(np.median(track.sigma)), 1e-12)


def _first_tau2(tracks: Sequence[Track]) -> float:
    """Return tau² from differences of neighbours, which no slow change moves."""
    pairs = [(np.diff(t.value) ** 2, t.sigma[1:] ** 2 + t.sigma[:-1] ** 2) for t in tracks]
    d2 = np.concatenate([pair[0] for pair in pairs])
    s2 = np.concatenate([pair[1] for pair in pairs])
    return solve_tau2(d2 / 2.0, s2 / 2.0)


def _tau2(tracks: Sequence[Track], fits: Sequence[_Fit]) -> float:
    """Return tau² of the fleet, robust against flights far off."""
    many = [(t, f) for t, f in zip(tracks, fits, strict=True) if f.dof > 0]
    r2 = [(t.value - f.fitted) ** 2 * len(t.value) / f.dof for t, f in many]
    s2 = [t.sigma**2 for t, _ in many]
    return solve_tau2(np.concatenate(r2), np.concatenate(s2)) if many else 0.0


def solve_tau2(r2: Floats, s2: Floats) -> float:
    """Return tau² at which half of r² / (s² + tau²) is below the median of chi²; at least 0."""
    if not len(r2) or np.median(r2 / np.maximum(s2, 1e-300)) <= _MEDIAN_CHI2:
        return 0.0
    low, high = 0.0, float(np.median(r2)) / _MEDIAN_CHI2
    for _ in range(40):
        middle = (low + high) / 2.0
        if np.median(r2 / np.maximum(s2 + middle, 1e-18)) > _MEDIAN_CHI2:
            low = middle
        else:
            high = middle
    return high


def _variance(track: Track, tau2: float) -> Floats:
    return np.maximum(track.sigma**2 + tau2, 1e-12)


def _rough_s2(track: Track, fit: _Fit, tau2: float) -> float:
    """Return by how much a vehicle's residuals exceed their sigmas, squared, by their median."""
    if fit.dof <= 0:
        return np.nan
    r2 = (track.value - fit.fitted) ** 2 / _variance(track, tau2)
    return float(np.median(r2)) / _MEDIAN_CHI2 * len(r2) / fit.dof


def _moderated(s2: Floats, dof: Floats, lent: tuple[float, float]) -> Floats:
    """Return each vehicle's variance with what the fleet lends; 1 where nothing is known."""
    d = np.where(np.isfinite(s2) & (dof > 0), dof, 0.0)
    total = lent[0] + d
    own = np.where(d > 0, s2, 0.0) * d
    return np.where(total > 0, (lent[0] * lent[1] + own) / np.maximum(total, 1e-9), 1.0)


def _local(y: Floats) -> Floats:
    """Return the median of each flight's neighbourhood of nine."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(y, 4, mode="reflect"), 9)
    local: Floats = np.median(around, axis=1)
    return local


def _fit(track: Track, tau2: float, scale: float, *, slow: bool | None = None) -> _Fit:
    """Fit the best profile, of those that are slow, of the others, or (None) of all."""
    y, n = track.value, len(track.value)
    w = 1.0 / _variance(track, tau2)
    far = FAR * max(scale, 1e-6)
    fitted = _local(y) if n >= LEAST_FLIGHTS else np.full(n, np.median(y))
    constant = np.full(n, np.median(y))
    for _ in range(_ROUNDS):
        kept = _near(y, constant, w, far)
        constant = np.full(n, np.average(y, weights=w * kept))
    loss0 = _loss(y, constant, w, far)
    kept = _near(y, fitted, w, far)
    for _ in range(_ROUNDS):
        result = _best(y, w * kept, kept, slow)
        again = _near(y, result.fitted, w, far)
        if np.array_equal(again, kept):
            break
        kept = again
    result.g2 = max(0.0, loss0 - _loss(y, result.fitted, w, far))
    return result


def _near(y: Floats, fitted: Floats, w: Floats, far: float) -> Bools:
    """Return the flights that have weight: all, where half of them were far off."""
    near: Bools = np.abs(y - fitted) * np.sqrt(w) <= far
    return near if near.sum() > len(y) // 2 else np.ones(len(y), bool)


def _loss(y: Floats, fitted: Floats, w: Floats, far: float) -> float:
    """Return the sum of squares in sigmas, of each flight at most what one far off has."""
    return float(np.minimum(w * (y - fitted) ** 2, far**2).sum())


def _best(y: Floats, w: Floats, kept: Bools, slow: bool | None) -> _Fit:
    n, count = len(y), int(kept.sum())
    total = w.sum()
    mean = float(w @ y / total)
    rest = y - mean
    rss = float(w @ rest**2)
    if n < LEAST_FLIGHTS:
        dof = count - 1.0
        s2 = rss / dof / _WITHIN_FAR if dof > 0 else np.nan
        return _Fit(None, np.full(n, mean), kept, 0.0, 0.0, mean, total, s2, dof)
    a, _, is_slow = profiles(n)
    centre = a @ w / total
    den = a**2 @ w - centre**2 * total
    num = a @ (w * rest)
    g2 = np.where(den > 1e-9 * total, num**2 / np.maximum(den, 1e-30), 0.0)
    if slow is not None:
        g2 = np.where(is_slow == slow, g2, -1.0)
    k = int(np.argmax(g2))
    slope = float(num[k] / den[k])
    level = mean - slope * float(centre[k])
    dof = count - 4.0  # two levels, and where the change begins and ends
    s2 = (rss - float(g2[k])) / dof / _WITHIN_FAR if dof > 0 else np.nan
    return _Fit(k, level + slope * a[k], kept, float(g2[k]), slope, level, float(den[k]), s2, dof)


def _prior(s2: Floats, dof: Floats) -> tuple[float, float]:
    """Return degrees of freedom and variance that the fleet lends to a vehicle (Smyth 2004)."""
    known = (dof >= 3) & (s2 > 0)
    if known.sum() < 3:
        return 0.0, 1.0
    d = dof[known] / 2.0
    e = np.log(s2[known]) - digamma(d) + np.log(d)
    spread = float(np.var(e, ddof=1) - np.mean(polygamma(1, d)))
    if spread <= polygamma(1, MOST_DOF / 2.0):
        d0 = MOST_DOF
    else:
        x = 0.5 + 1.0 / spread  # Newton on trigamma(x) = spread
        for _ in range(20):
            tri = polygamma(1, x)
            x += tri * (1.0 - tri / spread) / polygamma(2, x)
        d0 = 2.0 * float(x)
    return d0, float(np.exp(np.mean(e) + digamma(d0 / 2.0) - np.log(d0 / 2.0)))


def _judged(
    track: Track, unit: float, pair: Sequence[_Fit], s2: float, dof: float, tau2: float
) -> Fitted:
    # Sigmas have parts in common: flights may agree better, but no level is known better than that.
    std = unit * np.sqrt(max(s2, 1.0) * _variance(track, tau2))
    s2 = max(s2, _LEAST_S2)
    changes = [_change(len(std), unit, fit, s2, dof) for fit in pair]
    known = [(c, fit) for c, fit in zip(changes, pair, strict=True) if c is not None]
    tau = unit * float(np.sqrt(tau2))
    if not known:
        return Fitted(None, pair[0].kept, std, tau, dof)
    change, fit = min(known, key=lambda each: (each[0].p, -abs(each[0].t)))
    return Fitted(change, fit.kept, std, tau, dof)


def _change(n: int, unit: float, fit: _Fit, s2: float, dof: float) -> Change | None:
    if fit.best is None or not fit.dof > 0 or not s2 > 0:
        return None
    _, ends, is_slow = profiles(n)
    first, last = ends[fit.best]
    t = float(np.sign(fit.slope) * np.sqrt(fit.g2 / s2))
    slow = bool(is_slow[fit.best])
    p = min(1.0, looks(n, slow=slow) / _SHARE[slow] * two_sided(t, dof))
    std = unit * float(np.sqrt(s2 / fit.den))
    before, after = unit * fit.level, unit * (fit.level + fit.slope)
    return Change(int(first), int(last), before, after, std, t, p)


def two_sided(t: float, dof: float) -> float:
    """Return the probability of a larger |t| by chance."""
    return float(2.0 * stdtr(dof, -abs(t)))
