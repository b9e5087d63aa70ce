from __future__ import annotations

import numpy as np
import pytest

from yawid.errors import ConfigError
from yawid.plant.excitation import Excitation
from yawid.plant.simulate import PLANTS, REFERENCE, simulate_plant
from yawid.plant.yaw import YawPlant

PULSES = Excitation(kind="3211", amplitude=1e-4, start_s=1.0)
BOTH = ("rigid-body", "lateral")


@pytest.mark.parametrize("name", PLANTS)
def test_right_rudder_turns_the_nose_right(name):
    flown = simulate_plant(name, Excitation(kind="step", amplitude=0.05), duration_s=1.2)
    assert (flown.u == 0.05).all()
    assert (flown.y[1:] > 0.0).all()
    assert (np.diff(flown.yaw) > 0.0).all()
    assert flown.roll[-1] > 0.0 or name == "yaw"


@pytest.mark.parametrize(("amplitude", "least", "most"), [(1e-4, 0.0, 1e-3), (0.3, 0.02, 1.0)])
def test_a_small_rudder_flies_the_rigid_body_as_eq_21_says_and_a_large_one_does_not(
    amplitude, least, most
):
    moves = Excitation(kind="3211", amplitude=amplitude, start_s=1.0)
    body, linear = (simulate_plant(name, moves, duration_s=20.0) for name in BOTH)
    for field in ("y", "yaw", "roll"):
        one, other = getattr(body, field), getattr(linear, field)
        assert least < np.abs(one - other).max() / np.abs(other).max() < most


def test_yaw_rate_over_rudder_has_the_sign_and_theta_of_eq_23():
    flown = simulate_plant("yaw", PULSES, duration_s=30.0)
    theta = YawPlant.from_coefficients(REFERENCE).theta(0.05)
    phi = np.column_stack([-flown.y[1:-1], -flown.y[:-2], flown.u[1:-1], flown.u[:-2]])
    np.testing.assert_allclose(phi @ theta, flown.y[2:], atol=1e-15)


def test_noise_is_white_of_its_size_and_comes_back_with_its_seed():
    quiet = simulate_plant("yaw", PULSES)
    noisy, again, other = (simulate_plant("yaw", PULSES, noise_std=0.01, seed=s) for s in (1, 1, 2))
    noise = noisy.y - quiet.y
    assert np.std(noise) == pytest.approx(0.01, rel=0.08)
    np.testing.assert_array_equal(noisy.y, again.y)
    assert (noisy.y != other.y).any()
    np.testing.assert_array_equal(noisy.yaw, quiet.yaw)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"name": "kite"}, "plant must be one of yaw"),
        ({"sample_time_s": 0.0}, "sample time"),
        ({"duration_s": np.inf}, "duration"),
        ({"noise_std": -1.0}, "noise_std"),
        ({"name": "rigid-body", "excitation": Excitation(kind="step", amplitude=3.0)}, "forward"),
    ],
)
def test_what_cannot_be_flown_is_refused(settings, text):
    with pytest.raises(ConfigError, match=text):
        simulate_plant(**({"name": "yaw", "excitation": PULSES} | settings))
