"""The roll law in the aileron, and the airframe closed with it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from lateral.flown import DERIVATIVES, ROLL, P, R, flown
from linear_flights import airframe

from yawid.lateral.fit_airframe import fit_airframe
from yawid.lateral.model import AT, NAMES, Law
from yawid.lateral.record import Record
from yawid.lateral.roll_law import roll_law, yaw_rate_closed

HOLD = (0.6, 0.2)
HELD: dict[str, Any] = {"amplitude": 0.3, "aileron": 0.2, "hold": HOLD, "lag_s": 0.1}


def closed(lag_s: float, roll_lag_s: float) -> tuple[float, float]:
    """Return wn and zeta under HOLD: the aileron and the roll angle heard are two more states."""
    A, controls = airframe(DERIVATIVES)
    whole = np.zeros((6, 6))
    whole[:4, :4], whole[:4, 4], whole[4, 4] = A, controls[:, 0], -1.0 / lag_s
    whole[4, 5], whole[4, P] = -HOLD[0] / lag_s, -HOLD[1] / lag_s
    whole[5, ROLL], whole[5, 5] = 1.0 / roll_lag_s, -1.0 / roll_lag_s
    poles, vectors = np.linalg.eig(whole)
    response = vectors[R] * np.linalg.solve(vectors, np.append(controls[:, 1], [0.0, 0.0]))
    energy = np.where(poles.imag > 0.0, np.abs(response) ** 2 / np.abs(poles.real), 0.0)
    pair = poles[np.argmax(energy)]
    return float(abs(pair)), float(-pair.real / abs(pair))


@pytest.mark.parametrize(("roll_lag_s", "within"), [(0.0, 0.05), (0.1, 0.1)])
def test_the_law_is_found_although_the_aileron_is_moved_as_well(roll_lag_s: float, within: float):
    """And so is the lag of the roll angle that the hold hears."""
    law = roll_law(Record(flown(3, roll_lag_s=roll_lag_s, **HELD)))

    assert law.roll_lag_s == roll_lag_s
    assert (law.roll_gain, law.rate_gain) == pytest.approx(HOLD, rel=within)


def test_an_aileron_that_rests_has_a_law_without_gains_and_one_that_moves_by_itself_has_none():
    resting = roll_law(Record(flown(3, aileron=0.0)))

    assert (resting.roll_gain, resting.rate_gain) == (0.0, 0.0)
    assert roll_law(Record(flown(3, aileron=0.2))) is None


@pytest.mark.parametrize(
    ("roll_lag_s", "apart"), [pytest.param(1e-3, 0.03, marks=pytest.mark.long), (0.1, 0.025)]
)
def test_closed_with_the_law_the_airframe_is_the_aircraft_as_flown(roll_lag_s: float, apart: float):
    """Without its roll hold its damping is another."""
    found = fit_airframe([flown(3, roll_lag_s=roll_lag_s, **HELD)], servo_lag_s=0.1)

    (wn, zeta), (own_wn, own_zeta) = (
        closed(0.1, roll_lag_s), (found.as_flown.wn_rad_s, found.as_flown.zeta),
    )  # fmt: skip
    assert abs(own_wn.value - wn) < min(2.0 * own_wn.std, 0.02 * wn)
    assert abs(own_zeta.value - zeta) < min(2.0 * own_zeta.std, 0.02)
    assert abs(found.zeta.value - zeta) > apart


def test_under_the_law_the_airframe_yaws_as_measured_by_the_rudder_alone():
    """The airframe is known from a flight whose aileron moved; in this one it only follows."""
    found = fit_airframe([flown(amplitude=0.3, lag_s=0.1)], servo_lag_s=0.1)
    theta, known = np.zeros(len(NAMES)), dict(found.derivatives)
    known |= {"alpha": found.alpha_rad, "servo_lag": found.servo_lag_s, "delay": found.delay_s}
    theta[AT["log_Y_beta"]] = np.log(-known.pop("Y_beta").value)
    theta[[AT[name] for name in known]] = [each.value for each in known.values()]
    motion = flown(amplitude=0.3, aileron=0.0, hold=HOLD, lag_s=0.1, roll_lag_s=0.1)

    yaw_rate = yaw_rate_closed(theta, Record(motion), Law(*HOLD, 0.1))

    assert np.std(yaw_rate - motion.r) < 0.02 * np.std(motion.r)
