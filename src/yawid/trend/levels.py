"""The level of a vehicle's number, its slope, its outliers, and how vehicles compare."""

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from yawid.answers.part import Part, says
from yawid.answers.run_summary import Value
from yawid.blocks import Bools, Floats
from yawid.trend.best_profile import WITHIN_FAR
from yawid.trend.changes import Change, Fitted, profile
from yawid.trend.days import FAR, YEAR_US, Track, date, solve_tau2

A_YEAR: Final = 40.0
"""A year, counted from 1970, whose calendar turns a fraction of a year into a date."""
LEAST_SLOPE: Final = 3
"""Least number of days for a straight line: one more than it has parameters."""
_ROUNDS: Final = 6
"""How often a fit is repeated without the days that are far off it."""


class Yearly(Part, frozen=True, kw_only=True):
    """A season: the amplitude by which a number swings, and the day of the year of its peak."""

    amplitude: Annotated[Value, says("by how much it swings the number either way")]
    peak: Annotated[str, says("month and day at which the number is highest")]


@dataclass(frozen=True, slots=True)
class Level:
    """A number at the end of a history, and how its n flights lie about the fit."""

    value: float
    """The number after the last change."""
    std: float
    """Its standard deviation."""
    z: Floats
    """Each flight's distance from the level or profile (n,), in its own std (sigma and tau)."""
    kept: Bools
    """Which flights (n,) are not far off."""
    tau: float | None
    """Scatter of this vehicle's flights beyond their sigmas; None for fewer than five flights."""
    fitted: Floats
    """The level or profile at each flight (n,)."""
    season: Yearly | None
    """The season; None if the days do not suffice to fit one."""
    excess: float
    """Variance of the days about the fit as a multiple of the assumed one, at least 1."""


def level_of(track: Track, fitted: Fitted, change: Change | None) -> Level:
    """Return the level of a history with this change, None without one."""
    days, std = fitted.days, fitted.day_std
    n, design = len(track.value), days.steady
    if change is not None:
        design = np.column_stack([design, profile(len(std), change) - 1.0])
    kept = np.abs(days.value - np.median(days.value)) <= FAR * std
    for _ in range(_ROUNDS):
        if 2 * kept.sum() <= len(std):
            kept = np.ones(len(std), bool)
        theta, cov = weighted_fit(design, days.value, std, kept)
        kept = np.abs(days.value - design @ theta) <= FAR * std
    line = (design @ theta)[days.day]
    z = (track.value - line) / fitted.std
    dof = max(n - design.shape[1], 1)
    r2 = (track.value - line) ** 2 * n / dof
    tau = float(np.sqrt(solve_tau2(r2, track.sigma**2))) if n >= 5 else None
    season = _season(theta[1:3], cov[1:3, 1:3]) if days.shows_season else None
    apart = ((days.value - design @ theta) / std)[kept]
    excess = float(apart @ apart) / max(len(apart) - design.shape[1], 1) / WITHIN_FAR
    value, error = float(theta[0]), float(np.sqrt(cov[0, 0]))
    return Level(value, error, z, np.abs(z) <= FAR, tau, line, season, max(1.0, excess))


def _season(theta: Floats, cov: Floats) -> Yearly:
    """Return the season given the coefficients (2,) of cosine and sine, and their covariance."""
    amplitude = Value(float(np.hypot(*theta)), float(np.sqrt(np.trace(cov) / 2.0)))
    peak = float(np.arctan2(theta[1], theta[0]) / (2.0 * np.pi)) % 1.0
    return Yearly(amplitude=amplitude, peak=date(round((A_YEAR + peak) * YEAR_US))[5:10])


def slope_of(x: Floats, fitted: Fitted, kept: Bools) -> Value | None:
    """Return the slope of a straight line over x (n,) with its sigma; None for too few days.

    ``kept`` (n,) are the flights that have weight; a day has weight if most of its flights have.
    """
    days = fitted.days
    kept = days.mean(kept.astype(float)) > 0.5
    x = days.mean(x)
    if kept.sum() < LEAST_SLOPE or not np.ptp(x[kept]) > 0.0:
        return None
    design = np.column_stack([days.steady, x - x[kept].mean()])
    theta, cov = weighted_fit(design, days.value, fitted.day_std, kept)
    return Value(float(theta[-1]), float(np.sqrt(cov[-1, -1])))


def weighted_fit(design: Floats, value: Floats, std: Floats, kept: Bools) -> tuple[Floats, Floats]:
    """Return the parameters (p,) and their covariance (p, p) by least squares weighted by 1 / std².

    ``design`` is (d, p); ``value``, ``std`` and ``kept`` are (d,).
    """
    weighted: Floats = design[kept] / std[kept, None]
    cov = np.asarray(np.linalg.pinv(weighted.T @ weighted), dtype=np.float64)
    return cov @ weighted.T @ (value[kept] / std[kept]), cov


def compare(value: Floats, std: Floats) -> tuple[float, Floats]:
    """Return the median of the levels (v,) of vehicles, and how far each is off it in sigmas (v,).

    ``std`` (v,) are the levels' sigmas; to them comes the scatter between the vehicles.
    """
    n, median = len(value), float(np.median(value))
    tau2 = solve_tau2((value - median) ** 2 * n / (n - 1), std**2)
    return median, (value - median) / np.sqrt(np.maximum(std**2 + tau2, 1e-300))
