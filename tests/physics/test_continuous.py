"""The continuous transfer function against arithmetic by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import residue

from yawid.physics.continuous import Transfer, pole_of

NUM, YAW, LAG_S = [29.08, 34.20], [1.0, 13.148, 111.17], 0.14
"""The yaw channel of the simulated flights, in front of a servo of 0.14 s."""
S = 1j * np.array([0.5, 3.0, 10.0, 25.0])


def model(count: int = 1) -> Transfer:
    """Return equal models; the lag is in the third column."""
    r, p, _ = residue(NUM, np.polymul(YAW, [LAG_S, 1.0]))
    order = np.argsort(-p.imag + 1e3 * (p.imag == 0.0))
    return Transfer(*(np.tile(each[order].astype(complex), (count, 1)) for each in (p, r)))


def true(s, speed: float = 1.0, yaw=YAW):
    """Return G(s) at a higher airspeed: the aircraft's part is faster, the servo is not."""
    aircraft = np.polyval(NUM, s / speed) / np.polyval(yaw, s / speed)
    return speed * aircraft / (LAG_S * s + 1.0)


def test_poles_and_residues_have_the_response_of_the_polynomials() -> None:
    assert model().at(S)[0] == pytest.approx(true(S), rel=1e-9)
    assert model().dutch_roll[0] == pytest.approx(-6.574 + 1j * np.sqrt(111.17 - 6.574**2))
    assert pole_of(np.sqrt(111.17), np.array(6.574 / np.sqrt(111.17))) == pytest.approx(
        model().dutch_roll[0]
    )


def test_a_higher_airspeed_makes_the_aircraft_faster_and_not_its_servo() -> None:
    found = model(2).faster(1.3, np.array([2, -1])).at(S)

    assert found[0] == pytest.approx(true(S, 1.3), rel=1e-9)
    # Without a lag everything scales: G becomes 1.3 G(s / 1.3).
    assert found[1] == pytest.approx(1.3 * true(S / 1.3), rel=1e-9)
    assert model().faster(1.3).at(S)[0] == pytest.approx(found[1], rel=1e-12)


def test_an_airspeed_that_is_hardly_higher_changes_hardly_anything() -> None:
    near = model().faster(1.0 + 1e-9, np.array([2])).at(S)[0]

    assert near == pytest.approx(true(S), rel=1e-8)
    assert model().faster(1.0, np.array([2])).at(S)[0] == pytest.approx(true(S), rel=1e-12)


def test_a_moved_pair_leaves_zeros_and_lags() -> None:
    moved = model().with_pair(np.array([9.0 * np.exp(2.0j)]))

    assert moved.at(S)[0] == pytest.approx(true(S, yaw=[1.0, -18.0 * np.cos(2.0), 81.0]), rel=1e-9)


def test_models_with_fewer_poles_stand_next_to_others_with_their_own_response() -> None:
    pair = model().poles[:, :2]
    alone = Transfer(pair, np.ones((1, 2), complex))
    both = Transfer.joined([alone, model()])

    assert both.poles.shape == (2, 3)
    assert both.at(S)[0] == pytest.approx(1.0 / (S - pair[0, 0]) + 1.0 / (S - pair[0, 1]))
    assert both.at(S)[1] == pytest.approx(true(S), rel=1e-9)
    again = both.faster(1.3, np.array([-1, 2])).with_pair(both.dutch_roll)
    assert again.poles.shape == (2, 3)
    assert np.isfinite(again.at(S)).all()
