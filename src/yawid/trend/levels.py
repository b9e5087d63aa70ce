"""Where a vehicle's number stands, how it leans, what is far off, and how vehicles compare."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from yawid.blocks import Bools, Floats
from yawid.trend.changes import FAR, Fitted, Track, solve_tau2, two_sided

LEAST_COMPARED: Final = 5
"""Vehicles, below which none is compared with the others."""
LEAST_SLOPE: Final = 3
"""Flights that a straight line needs, one more than it has numbers."""
_ROUNDS: Final = 6


@dataclass(frozen=True, slots=True)
class Level:
    """A number as it stands at the end of a history.

    value, std: after the last change; z (n,): every flight's distance from the level or profile,
    in its own std (sigma and tau); kept (n,): those that have weight; tau: scatter of this
    vehicle's flights beyond their sigmas, None of fewer than five; fitted (n,).
    """

    value: float
    std: float
    z: Floats
    kept: Bools
    tau: float | None
    fitted: Floats


def level_of(track: Track, fitted: Fitted, profile: Floats | None) -> Level:
    """Return the level of a history, about a profile (n,) of 0 to 1 where it has changed."""
    n = len(track.value)
    columns = [np.ones(n)] if profile is None else [1.0 - profile, profile]
    design = np.column_stack(columns)
    start = np.median(track.value) if profile is None else None
    kept = fitted.kept if start is None else np.abs(track.value - start) <= FAR * fitted.std
    for _ in range(_ROUNDS):
        if 2 * kept.sum() <= n:
            kept = np.ones(n, bool)
        theta, cov = weighted_fit(design, track.value, fitted.std, kept)
        z = (track.value - design @ theta) / fitted.std
        kept = np.abs(z) <= FAR
    dof = n - design.shape[1]
    r2 = (z * fitted.std) ** 2 * n / max(dof, 1)
    tau = float(np.sqrt(solve_tau2(r2, track.sigma**2))) if n >= 5 else None
    return Level(float(theta[-1]), float(np.sqrt(cov[-1, -1])), z, kept, tau, design @ theta)


def slope_of(x: Floats, track: Track, std: Floats, kept: Bools) -> tuple[float, float] | None:
    """Return the slope of a straight line over x (n,) and its sigma; None of too few flights."""
    if kept.sum() < LEAST_SLOPE or not np.ptp(x[kept]) > 0.0:
        return None
    about: Floats = x - x[kept].mean()
    design = np.column_stack([np.ones(len(x)), about])
    theta, cov = weighted_fit(design, track.value, std, kept)
    return float(theta[1]), float(np.sqrt(cov[1, 1]))


def weighted_fit(design: Floats, value: Floats, std: Floats, kept: Bools) -> tuple[Floats, Floats]:
    """Return parameters (p,) and covariance (p, p) of least squares weighted by 1 / std²."""
    weighted: Floats = design[kept] / std[kept, None]
    cov = np.asarray(np.linalg.pinv(weighted.T @ weighted), dtype=np.float64)
    return cov @ weighted.T @ (value[kept] / std[kept]), cov


@dataclass(frozen=True, slots=True)
class Compared:
    """A vehicle among others: their median, by how many sigmas it is off, p of as much."""

    median: float
    z: float
    p: float


def compare(value: Floats, std: Floats) -> list[Compared | None]:
    """Compare vehicles by their levels (v,) and sigmas (v,), each with the scatter between all."""
    n = len(value)
    if n < LEAST_COMPARED:
        return [None] * n
    median = float(np.median(value))
    tau2 = solve_tau2((value - median) ** 2 * n / (n - 1), std**2)
    z = (value - median) / np.sqrt(np.maximum(std**2 + tau2, 1e-300))
    return [Compared(median, float(each), two_sided(each, n - 1.0)) for each in z]
