"""Large motion: what of it is an input of its own, and what the answer is where it is.

The aircraft has sideslip and yaw rate, and a yaw damper that moves the rudder by -GAIN r up to its
limit. Its truth is the eigenvalue of the matrix with the damper within its limits.
"""

from __future__ import annotations

import numpy as np
import pytest
from manoeuvre.exact import doublets, record
from numpy.typing import NDArray

from yawid.manoeuvre.answer import answer_of
from yawid.manoeuvre.fit import best_alone, fits_of
from yawid.manoeuvre.large import simulated_rate, small_motion
from yawid.physics.responses import Record

Floats = NDArray[np.float64]

TS, FINE_S, GAIN = 0.04, 0.01, 0.8
A, B = np.array([[-0.2, -1.0], [5.0, -0.4]]), np.array([0.0, 2.0])
CLOSED = A - GAIN * np.outer(B, [0.0, 1.0])
POLE = complex(np.linalg.eigvals(CLOSED)[0])
WN, ZETA = abs(POLE), -POLE.real / abs(POLE)


def damped(u: Floats, limit: float) -> Floats:
    """The yaw rate (n,) of a rudder that is held, by the trapezoidal rule at 10 ms"""
    x, found = np.zeros(2), []
    for now in u.tolist():
        found.append(x[1])
        for _ in range(round(TS / FINE_S)):
            first = A @ x + B * (now - np.clip(GAIN * x[1], -limit, limit))
            there = x + FINE_S * first
            second = A @ there + B * (now - np.clip(GAIN * there[1], -limit, limit))
            x = x + 0.5 * FINE_S * (first + second)
    return np.array(found)


def flown(share: float, *, noise: float = 0.003) -> Record:
    """A damper whose limit is ``share`` of what the largest yaw rate asks of it"""
    u = np.concatenate([part * doublets(WN, TS) for part in (0.3, 1.0, 2.0)])
    limit = share * GAIN * float(np.abs(damped(u, np.inf)).max())
    return record(u, damped(u, limit), TS, noise=noise)


@pytest.mark.parametrize("share", [0.15, 0.3, 0.5, 0.8])
def test_the_answer_of_a_damper_at_its_limits_is_that_of_small_motion(share: float) -> None:
    fits = fits_of(flown(share))
    proportional, found = answer_of(fits), answer_of([*fits, *small_motion(fits)])
    assert proportional is not None
    assert found is not None
    (wn, wn_std), (zeta, zeta_std) = found.wn_rad_s, found.zeta
    assert abs(wn - WN) < 2.0 * wn_std
    assert abs(zeta - ZETA) < 2.0 * zeta_std
    assert abs(zeta - ZETA) < 0.6 * abs(proportional.zeta.value - ZETA)
    assert proportional.zeta.value < ZETA - 2.0 * proportional.zeta.std
    assert sum(w for name, w in found.weights.items() if "small" in name) > 0.9


def test_the_response_is_that_of_small_motion() -> None:
    fits = fits_of(flown(0.5))
    found = answer_of([*fits, *small_motion(fits)])
    assert found is not None
    s = 1j * found.w[:, None, None]
    exact = np.linalg.solve(s * np.eye(2) - CLOSED, B[:, None])[:, 1, 0]
    np.testing.assert_allclose(np.abs(found.response[0]), np.abs(exact), rtol=0.06)


@pytest.mark.parametrize("seed", range(3))
def test_an_aircraft_in_proportion_has_no_large_motion(seed: int) -> None:
    u = doublets(WN, TS)
    fits = fits_of(record(u, damped(u, np.inf), TS, noise=0.02, seed=seed))
    assert small_motion(fits) == []


def test_large_motion_has_none_of_the_gusts() -> None:
    quiet, rng = flown(np.inf, noise=0.0), np.random.default_rng(5)
    rough = Record(TS, quiet.u, quiet.y + rng.normal(0.0, 0.02, quiet.y.shape), quiet.runs)
    for each in (quiet, rough):
        best = best_alone(fits_of(each))
        assert best is not None
        off = simulated_rate(best) - quiet.y[:, 0]
        assert np.std(off) < 0.05 * np.std(quiet.y)


def test_no_fit_has_no_small_motion() -> None:
    assert small_motion([]) == []
