"""Finds the profile that fits a history best, for many histories of one length at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from yawid.blocks import Bools, Floats
from yawid.trend.days import FAR, Days, alike, local_median

LEAST_DAYS: Final = 12
"""Least number of days in which a change is looked for."""
LEAST_SIDE: Final = 4
"""Least number of days before the middle of a change, and after it: fewer may be outliers."""
WITHIN_FAR: Final = 0.9497
"""Variance of a standard normal deviate, given that it is less than FAR sigmas off."""
_ROUNDS: Final = 4
"""How often a fit is repeated with the weights that the last one gives."""
_AT_ONCE: Final = 256
"""Number of histories fitted at once, for which all profiles need some 100 MB."""


@dataclass(frozen=True, slots=True)
class Fit:
    """A history's best profile by least squares, each day weighted by 1 / (sigma² + tau²)."""

    best: int | None
    """Row of the profile in :func:`profiles`; None if there are too few days."""
    fitted: Floats
    """The fitted value of each day (d,)."""
    s2: float
    """Variance of the days about the fit, as a multiple of sigma² + tau²; NaN without ``dof``."""
    dof: float
    """Degrees of freedom of ``s2``; 0 or less if there are too few days."""
    g2: float = 0.0
    """By how much the profile reduces the weighted sum of squares."""
    slope: float = 0.0
    """The value after the change less that before it."""
    level: float = 0.0
    """The value before the change."""
    den: float = 1.0
    """The inverse variance of ``slope`` if ``s2`` were 1."""
    swing: float = 0.0
    """By how much a season of amplitude 1 could move ``slope``; 0 if a season is fitted."""


@lru_cache(maxsize=128)
def profiles(n: int) -> tuple[Floats, Floats, Bools]:
    """Return the profiles (m, n) of changes over n days, and the first and last day of each (m, 2).

    The third array (m,) says which are slow: a slow change takes half of the history or more.
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
    found = np.array([*sorted(ends), (0, n - 1)], dtype=float)
    shapes = np.clip((np.arange(n) - found[:, :1]) / (found[:, 1:] - found[:, :1]), 0.0, 1.0)
    return shapes, found, 2.0 * (found[:, 1] - found[:, 0]) >= n


def variance(sigma: Floats, tau2: Floats | float) -> Floats:
    """Return the whole variance of numbers: sigma² + tau², at least 1e-12."""
    return np.maximum(sigma**2 + tau2, 1e-12)


def fit_best(
    days: Sequence[Days], tau2: Floats, scale: Floats, *, slow: bool | None = None
) -> list[Fit]:
    """Fit the best profile of each history: of the slow ones, the quick ones, or (None) of all.

    ``tau2`` (histories,) is tau²; ``scale`` (histories,) is the scatter of each history as a
    multiple of what its sigmas and tau explain.
    """
    found: dict[int, Fit] = {}
    for rows in alike(range(len(days)), lambda i: days[i].steady.shape):
        for begin in range(0, len(rows), _AT_ONCE):
            some = rows[begin : begin + _AT_ONCE]
            stack = _Stack([days[i] for i in some], tau2[some], scale[some])
            found |= zip(some, stack.fit(slow), strict=True)
    return [found[i] for i in range(len(days))]


class _Stack:
    """A stack of r histories of d days each, with q steady columns (:attr:`Days.steady`)."""

    def __init__(self, days: Sequence[Days], tau2: Floats, scale: Floats) -> None:
        self.value = np.array([each.value for each in days])
        self.steady = np.array([each.steady for each in days])
        self.has_season = days[0].shows_season
        self.turn = np.exp(2j * np.pi * np.array([each.year for each in days]))
        self.weight = 1.0 / variance(np.array([each.sigma for each in days]), tau2[:, None])
        self.far = FAR * np.maximum(scale, 1e-6)[:, None]
        self.n = self.value.shape[1]

    def fit(self, slow: bool | None) -> list[Fit]:
        """Return the fit of each history; days far off their fit get no weight."""
        median = np.median(self.value, axis=1, keepdims=True)
        steady = np.broadcast_to(median, self.value.shape)
        for _ in range(_ROUNDS):
            steady = self._steadily(self.value, self.weight * self._near(steady))
        fitted = local_median(self.value) if self.n >= LEAST_DAYS else median
        kept = self._near(fitted)
        for _ in range(_ROUNDS):
            found = self._best(kept, slow)
            kept = self._near(found["fitted"])
        fitted, best = found.pop("fitted"), found.pop("best", None)
        if best is not None:
            found["g2"] = np.maximum(0.0, self._loss(steady) - self._loss(fitted))
        return [
            Fit(
                None if best is None else int(best[i]),
                fitted[i],
                **{name: float(numbers[i]) for name, numbers in found.items()},
            )
            for i in range(len(fitted))
        ]

    def _near(self, fitted: Floats) -> Bools:
        """Return which days (r, d) have weight: all of a history if half of them are far off."""
        near: Bools = np.abs(self.value - fitted) * np.sqrt(self.weight) <= self.far
        near |= 2 * near.sum(axis=1, keepdims=True) <= self.n
        return near

    def _loss(self, fitted: Floats) -> Floats:
        """Return the weighted sums of squares (r,); a day counts at most as one just FAR off."""
        squares = self.weight * (self.value - fitted) ** 2
        loss: Floats = np.minimum(squares, self.far**2).sum(axis=1)
        return loss

    def _steadily(self, y: Floats, w: Floats) -> Floats:
        """Return y (r, d) as fitted by the steady columns with the weights w (r, d)."""
        if self.steady.shape[2] == 1:
            mean = (w * y).sum(axis=1, keepdims=True) / w.sum(axis=1, keepdims=True)
            return np.broadcast_to(mean, y.shape)
        across = np.swapaxes(self.steady, 1, 2)
        normal = np.linalg.pinv(across @ (w[:, :, None] * self.steady))
        return (self.steady @ (normal @ (across @ (w * y)[:, :, None])))[:, :, 0]

    def _best(self, kept: Bools, slow: bool | None) -> dict[str, Floats]:
        y, w = self.value, self.weight * kept
        root = np.sqrt(w)
        basis = np.linalg.qr(root[:, :, None] * self.steady)[0]
        rest = root * y - _along(basis, root * y)
        rss, count = (rest**2).sum(axis=1), kept.sum(axis=1)
        if self.n < LEAST_DAYS:
            dof = count - 1.0
            s2 = rss / np.maximum(dof, 1e-9) / WITHIN_FAR
            s2 = np.where(dof > 0, s2, np.nan)
            return {"fitted": self._steadily(y, w), "s2": s2, "dof": dof}
        a, _, is_slow = profiles(self.n)
        shares = a @ (root[:, :, None] * basis)  # (r, m, q): the steady part of each profile
        den = w @ (a**2).T - (shares**2).sum(axis=2)
        num = (root * rest) @ a.T
        is_some = den > 1e-9 * w.sum(axis=1, keepdims=True)
        g2 = np.where(is_some, num**2 / np.maximum(den, 1e-30), 0.0)
        if slow is not None:
            g2 = np.where(is_slow == slow, g2, -1.0)
        k = np.argmax(g2, axis=1)
        rows = np.arange(len(k))
        den, best = den[rows, k], np.maximum(g2[rows, k], 0.0)
        slope = num[rows, k] / np.maximum(den, 1e-30)
        steady = self._steadily(y - slope[:, None] * a[k], w)
        # Parameters: where the change begins and ends, its size, and the steady columns.
        dof = count - 3.0 - self.steady.shape[2]
        s2 = np.where(dof > 0, (rss - best) / np.maximum(dof, 1e-9) / WITHIN_FAR, np.nan)
        apart = a[k] * root - _along(basis, a[k] * root)
        swing = np.abs((apart * root * self.turn).sum(axis=1)) / np.maximum(den, 1e-30)
        return {
            "best": k, "fitted": steady + slope[:, None] * a[k], "s2": s2, "dof": dof,
            "slope": slope, "level": steady.mean(axis=1), "den": den,
            "swing": 0.0 * swing if self.has_season else swing,
        }  # fmt: skip


def _along(basis: Floats, x: Floats) -> Floats:
    """Return the projection of x (r, d) on an orthonormal basis (r, d, q)."""
    return (basis @ (np.swapaxes(basis, 1, 2) @ x[:, :, None]))[:, :, 0]
