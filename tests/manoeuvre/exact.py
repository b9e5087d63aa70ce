"""Manoeuvres of linear aircraft whose truth is known: scipy's matrix exponential simulates them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from flights.records import states as moved
from numpy.typing import NDArray

from yawid.manoeuvre.fit import Fit, fits_of
from yawid.manoeuvre.responses import Record

Floats = NDArray[np.float64]


def states(A: Any, B: Any, u: Floats, sample_time_s: float) -> Floats:
    """The states (n, len(A)) at each instant, at rest first; u (n, 1) is held"""
    return moved(np.array(A), np.ravel(B), u.ravel(), 1.0 / sample_time_s)


def yaw_channel(
    u: Floats,
    sample_time_s: float,
    *,
    wn: float = 2.0,
    zeta: float = 0.1,
    K: float = 0.3,
    T_s: float = 0.8,
) -> Floats:
    """Yaw rate (n,) of a rudder (n,) by eq. 23"""
    A, B = [[0.0, 1.0], [-wn * wn, -2.0 * zeta * wn]], [[0.0], [1.0]]
    x = states(A, B, u[:, None], sample_time_s)
    return np.asarray(K * wn * wn * (x[:, 0] + T_s * x[:, 1]))


def doublets(
    wn: float, sample_time_s: float, periods: float = 6.0, *, swings: int = 2, gap: float = 1.5
) -> Floats:
    """A rudder (n,): doublets of a third of a period each way, ``gap`` periods apart, then rest"""
    t = np.arange(round(periods * 2.0 * np.pi / wn / sample_time_s)) * sample_time_s
    phase = t * wn / (2.0 * np.pi) - 0.3
    within = np.where(phase < swings * gap, phase % gap, gap)
    sides = [(phase < 0.0) | (within >= 2.0 / 3.0), within < 1.0 / 3.0]
    return np.select(sides, [0.0, 0.2], -0.2)


def record(
    u: Floats, y: Floats, sample_time_s: float, *, noise: float = 0.0, seed: int = 1
) -> Record:
    """A record whose yaw rate has white noise, as a part of its peak"""
    wide = u if u.ndim == 2 else u[:, None]
    rng = np.random.default_rng(seed)
    return Record.of(sample_time_s, wide, y + noise * np.abs(y).max() * rng.standard_normal(len(y)))


def lateral(u: Floats, sample_time_s: float) -> tuple[Floats, Floats, Floats]:
    """Yaw rate and roll (n,) of a rudder with a roll loop near the Dutch roll; its wn and zeta

    sideslip, roll, p, r, and an aileron whose servo lags by .1 s.
    """
    A = np.array(
        [
            [-0.25, 0.06, 0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0],
            [-13.0, 0.0, -1.4, 0.7, 10.0],
            [3.6, 0.0, 0.0, -0.4, 0.0],
            [0.0, -5.0, -1.5, 0.0, -10.0],
        ]
    )
    x = states(A, [[0.0], [0.0], [-0.3], [0.3], [0.0]], u[:, None], sample_time_s)
    poles, vectors = np.linalg.eig(A)
    residues = vectors[3] * np.linalg.solve(vectors, np.array([0, 0, -0.3, 0.3, 0], complex))
    energy = np.where(poles.imag > 0.0, np.abs(residues) ** 2 / -poles.real, 0.0)
    p = poles[np.argmax(energy)]
    return x[:, 3], x[:, 1], np.array([abs(p), -p.real / abs(p)])


@cache
def fits_with_roll() -> tuple[list[Fit], Floats]:
    """The fits of such a flight with a little noise, and its wn and zeta"""
    u = doublets(2.0, 0.05, periods=12.0)
    r, roll, truth = lateral(u, 0.05)
    rng = np.random.default_rng(4)
    y, roll = (x + 1e-3 * np.abs(x).max() * rng.standard_normal(len(x)) for x in (r, roll))
    return fits_of(Record.of(0.05, u[:, None], y, roll)), truth
