"""The drawn aircraft of the releases are what they say, and a held rudder moves them exactly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flights.records import drawn_airframe, states


@pytest.mark.parametrize("rolls", [False, True])
@pytest.mark.parametrize(("wn", "zeta"), [(0.5, 0.02), (6.0, 0.15)])
def test_a_drawn_aircraft_has_the_dutch_roll_asked_for(wn: float, zeta: float, rolls: bool) -> None:
    A, B = drawn_airframe(np.random.default_rng(5), wn, zeta, 0.2, rolls=rolls)

    asked = wn * complex(-zeta, math.sqrt(1.0 - zeta**2))
    poles = np.linalg.eigvals(A)
    assert np.min(np.abs(poles - asked)) < 1e-9 * wn
    assert sum(pole.imag > 1e-6 for pole in poles) == 1
    assert bool(B[1]) == rolls


def test_a_held_rudder_is_simulated_exactly() -> None:
    rudder = np.array([0.0, 1.0, 1.0, -2.0, 0.0, 0.0])

    x = states(np.array([[-3.0]]), np.array([2.0]), rudder, 4.0)[:, 0]

    # x' = -3 x + 2 u: in .25 s with u held, x goes from x to e x + (1 - e) 2 u / 3
    e = math.exp(-0.75)
    expected = [0.0]
    for u in rudder[:-1]:
        expected.append(e * expected[-1] + (1.0 - e) * 2.0 * u / 3.0)
    np.testing.assert_allclose(x, expected, rtol=1e-13)
