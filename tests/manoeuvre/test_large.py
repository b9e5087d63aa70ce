"""Large motion: what of it is an input of its own, and what the answer is where it is.

The aircraft has sideslip and yaw rate, and a yaw damper that moves the rudder by -GAIN r up to its
limit. Its fin acts by stall tanh(beta / stall). Its truth is the eigenvalue of the matrix with the
damper within its limits, and a small sideslip.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from manoeuvre.exact import doublets, record
from numpy.typing import NDArray

from yawid.manoeuvre.answer import answer_of
from yawid.manoeuvre.fit import WORTH_BIC, best_alone, fits_of
from yawid.manoeuvre.large import small_motion
from yawid.manoeuvre.responses import Record

Floats = NDArray[np.float64]

TS, FINE_S, GAIN = 0.04, 0.01, 0.8
A, B = np.array([[-0.2, -1.0], [5.0, -0.4]]), np.array([0.0, 2.0])
CLOSED = A - GAIN * np.outer(B, [0.0, 1.0])
POLE = complex(np.linalg.eigvals(CLOSED)[0])
WN, ZETA = abs(POLE), -POLE.real / abs(POLE)


def damped(u: Floats, limit: float, stall: float = np.inf) -> Floats:
    """Sideslip and yaw rate (2, n) of a rudder that is held, by the trapezoidal rule at 10 ms"""

    def moved(x: Floats, now: float) -> Floats:
        fin = x[0] if stall == np.inf else stall * np.tanh(x[0] / stall)
        return A @ [fin, x[1]] + B * (now - np.clip(GAIN * x[1], -limit, limit))

    x, found = np.zeros(2), []
    for now in u.tolist():
        found.append(x)
        for _ in range(round(TS / FINE_S)):
            first = moved(x, now)
            x = x + 0.5 * FINE_S * (first + moved(x + FINE_S * first, now))
    return np.array(found).T


RUDDER = np.concatenate([part * doublets(WN, TS) for part in (0.3, 1.0, 2.0)])


def flown(share: float, *, noise: float = 0.003) -> Record:
    """A damper whose limit is ``share`` of what the largest yaw rate asks of it"""
    limit = share * GAIN * float(np.abs(damped(RUDDER, np.inf)[1]).max())
    return record(RUDDER, damped(RUDDER, limit)[1], TS, noise=noise)


def stalling(share: float) -> Record:
    """A fin that stalls at ``share`` of the largest sideslip without"""
    stall = share * float(np.abs(damped(RUDDER, np.inf)[0]).max())
    return record(RUDDER, damped(RUDDER, np.inf, stall)[1], TS, noise=0.003)


@pytest.mark.parametrize(
    ("of", "share"),
    [*((flown, share) for share in (0.15, 0.3, 0.5, 0.8)), (stalling, 0.7), (stalling, 1.2)],
)
def test_the_answer_of_large_motion_is_that_of_small_motion(
    of: Callable[[float], Record], share: float
) -> None:
    """A proportional fit has the zeta of a damper at its limits too low, of such a fin the wn."""
    which = 1 if of is flown else 0
    fits = fits_of(of(share))
    proportional, found = answer_of(fits), answer_of([*fits, *small_motion(fits)])
    misses = [
        [(known.value - true, known.std) for known, true in ((x.wn_rad_s, WN), (x.zeta, ZETA))]
        for x in (proportional, found)
    ]
    assert all(abs(miss) < 2.0 * std for miss, std in misses[1])
    low, std = misses[0][which]
    assert low < -2.0 * std
    assert abs(misses[1][which][0]) < 0.6 * abs(low)
    assert sum(w for name, w in found.weights.items() if "small" in name) > 0.9
    assert found.large_gain > WORTH_BIC


def test_the_response_is_that_of_small_motion() -> None:
    fits = fits_of(flown(0.5))
    found = answer_of([*fits, *small_motion(fits)])
    s = 1j * found.w[:, None, None]
    exact = np.linalg.solve(s * np.eye(2) - CLOSED, B[:, None])[:, 1, 0]
    np.testing.assert_allclose(np.abs(found.response[0]), np.abs(exact), rtol=0.06)


@pytest.mark.parametrize("seed", range(3))
def test_an_aircraft_in_proportion_has_no_large_motion(seed: int) -> None:
    u = doublets(WN, TS)
    fits = fits_of(record(u, damped(u, np.inf)[1], TS, noise=0.02, seed=seed))
    assert small_motion(fits) == small_motion([]) == []


def test_large_motion_has_none_of_the_gusts() -> None:
    quiet, rng = flown(np.inf, noise=0.0), np.random.default_rng(5)
    beta, _ = damped(RUDDER, np.inf)
    rough = Record(TS, quiet.u, quiet.y + rng.normal(0.0, 0.02, quiet.y.shape), quiet.runs)
    for each in (quiet, rough):
        best = best_alone(fits_of(each))
        r, swing = best.simulated()
        assert np.std(r - quiet.y[:, 0]) < 0.05 * np.std(quiet.y)
        assert np.std(swing + beta) < 0.15 * np.std(beta)
