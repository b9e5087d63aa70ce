"""The continuous transfer function against SciPy's zero-order hold and arithmetic by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete

from yawid.config.estimator import ArmaxOrders
from yawid.physics.continuous import transfer

NUM, YAW, LAG_S = [29.08, 34.20], [1.0, 13.148, 111.17], 0.14
"""The yaw channel of the simulated flights, in front of a servo of 0.14 s."""
S = 1j * np.array([0.5, 3.0, 10.0, 25.0])


def model(nk: int = 1, *, sample_time_s: float = 0.05):
    den = np.polymul(YAW, [LAG_S, 1.0])
    b, a, _ = cont2discrete((NUM, den), sample_time_s)
    theta = np.r_[a[1:], b.ravel()[1:], 0.3, 0.1, 0.0]
    orders = ArmaxOrders(na=3, nb=(3,), nc=2, nk=(nk,))
    return transfer(theta[None], orders, sample_time_s, held=True)


def true(s, speed: float = 1.0, yaw=YAW):
    """Return G(s) at a higher airspeed: the aircraft's part is faster, the servo is not."""
    aircraft = np.polyval(NUM, s / speed) / np.polyval(yaw, s / speed)
    return speed * aircraft / (LAG_S * s + 1.0)


def test_the_hold_is_undone_exactly() -> None:
    G = model()

    assert G.at(S)[0] == pytest.approx(true(S), rel=1e-9)
    assert G.dutch_roll[0] == pytest.approx(-6.574 + 1j * np.sqrt(111.17 - 6.574**2), rel=1e-9)


def test_a_dead_time_is_an_exact_delay() -> None:
    assert model(nk=3).at(S)[0] == pytest.approx(true(S) * np.exp(-S * 0.1), rel=1e-9)


def test_a_higher_airspeed_makes_the_aircraft_faster_and_not_its_servo() -> None:
    G = model()
    lag = np.array([np.argmin(np.abs(G.poles[0] + 1.0 / LAG_S))])

    assert G.faster(1.3, lag).at(S)[0] == pytest.approx(true(S, 1.3), rel=1e-9)
    # Without a lag everything scales: G becomes 1.3 G(s / 1.3).
    assert G.faster(1.3).at(S)[0] == pytest.approx(1.3 * true(S / 1.3), rel=1e-9)


def test_a_moved_pair_leaves_zeros_and_lags() -> None:
    moved = model().with_pair(np.array([9.0 * np.exp(2.0j)]))

    assert moved.at(S)[0] == pytest.approx(true(S, yaw=[1.0, -18.0 * np.cos(2.0), 81.0]), rel=1e-9)


def test_more_coefficients_of_b_than_of_a_are_refused() -> None:
    with pytest.raises(ValueError, match="nb must be 1 to na"):
        transfer(np.zeros((1, 6)), ArmaxOrders(na=2, nb=(3,), nc=0, nk=(1,)), 0.05, held=True)


def test_a_pole_that_alternates_leaves_its_response_to_the_others() -> None:
    # Times (z + 0.2) 1.3 / (z + 0.3) / 1.2, which is 1 at DC and no motion of an aircraft.
    b, a, _ = cont2discrete((NUM, YAW), 0.05)
    theta = np.r_[np.polymul(a, [1.0, 0.3])[1:], np.polymul(b.ravel()[1:], [1.3 / 1.2, 0.26 / 1.2])]
    orders = ArmaxOrders(na=3, nb=(3,), nc=0, nk=(1,))
    G = transfer(theta[None], orders, 0.05, held=True)

    s = 1j * np.array([1.0, 5.0, 10.0])
    z = np.exp(0.05 * s)
    true = np.polyval(NUM, s) / np.polyval(YAW, s) * (z + 0.2) * 1.3 / (z + 0.3) / 1.2
    assert G.at(s)[0] == pytest.approx(true, rel=0.04)
    assert np.count_nonzero(G.residues) == 2
