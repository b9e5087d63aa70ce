"""The rudder mix: the least sideslip in rolls, of a known plant and in JSBSim's flights."""

from __future__ import annotations

import numpy as np
import pytest
from flights.flight import trimmed
from flights.plan import STEP_S, FlightPlan
from flights.truth import LATERAL, lateral
from scipy.signal import StateSpace, lsim

from yawid.lateral.mix import ROLLS_S, rudder_mixes
from yawid.lateral.model import NAMES

V = 40.0
KNOWN = {
    "log_Y_beta": np.log(0.2), "Y_delta_r": 0.02, "L_beta": -4.0, "L_p": -5.0, "L_r": 1.5,
    "L_delta_a": 8.0, "L_delta_r": 0.4, "N_beta": 5.0, "N_p": -0.3, "N_r": -0.6,
    "N_delta_a": -0.2, "N_delta_r": 1.2, "alpha": 0.06,
}  # fmt: skip


def theta_of(known: dict[str, float]) -> np.ndarray:
    return np.array([[known.get(name, 0.0) for name in NAMES]])


def sideslip(mix: float, length_s: float) -> float:
    """Return the sum of squares of the sideslip in a roll, by SciPy."""
    k = KNOWN
    A = [
        [-0.2, 0.06, -1.0, 9.80665 / V * np.cos(0.06)],
        [k["L_beta"], k["L_p"], k["L_r"], 0.0],
        [k["N_beta"], k["N_p"], k["N_r"], 0.0],
        [0.0, 1.0, np.tan(0.06), 0.0],
    ]
    b = np.array([[0.0, k["L_delta_a"], k["N_delta_a"], 0.0],
                  [k["Y_delta_r"], k["L_delta_r"], k["N_delta_r"], 0.0]])  # fmt: skip
    t = np.arange(0.0, 2.0 * length_s, 0.01)
    plant = StateSpace(A, (b[0] + mix * b[1])[:, None], [[1.0, 0.0, 0.0, 0.0]], [[0.0]])
    _, beta, _ = lsim(plant, np.where(t < length_s, 1.0, -1.0), t)
    return float(np.sum(beta**2))


def test_each_mix_has_the_least_sideslip_of_its_roll() -> None:
    (mixes,) = rudder_mixes(theta_of(KNOWN), V)

    for mix, length_s in zip(mixes, ROLLS_S, strict=True):
        least = sideslip(mix, length_s)
        assert least < 0.5 * sideslip(0.0, length_s)
        assert least < min(sideslip(mix - 0.05, length_s), sideslip(mix + 0.05, length_s))
    unknown = rudder_mixes(theta_of(KNOWN | {"N_delta_a": np.nan}), V)
    assert np.isnan(unknown).all()


@pytest.mark.parametrize(
    ("aircraft", "feet", "knots"), [("t6texan2", 5000.0, 150.0), ("c172p", 3000.0, 80.0)]
)
def test_jsbsims_sideslip_in_rolls_is_least_with_it(aircraft: str, feet: float, knots: float):
    plan = FlightPlan(aircraft=aircraft, altitude_ft=feet, heading_deg=0.0, speed_kt=knots)
    fdm = trimmed(plan)
    A, aileron, rudder = lateral(fdm)
    B, P, R = (LATERAL.index(name) for name in ("Beta", "P", "R"))
    known = {
        "log_Y_beta": np.log(-A[B, B]), "alpha": A[B, P], "L_beta": A[P, B], "L_p": A[P, P],
        "L_r": A[P, R], "N_beta": A[R, B], "N_p": A[R, P], "N_r": A[R, R],
        "L_delta_a": aileron[P], "N_delta_a": aileron[R], "L_delta_r": -rudder[P],
        "N_delta_r": -rudder[R], "Y_delta_r": -rudder[B],
    }  # fmt: skip
    mix = float(rudder_mixes(theta_of(known), fdm["velocities/vt-fps"] * 0.3048).mean())

    def rolled(gain: float, amplitude: float) -> np.ndarray:
        """Return the sideslip (n,) in rad of a roll of 1 s to each side."""
        fdm, found = trimmed(plan), []
        trims = fdm["fcs/aileron-cmd-norm"], fdm["fcs/rudder-cmd-norm"]
        for k in range(round(2.0 / STEP_S)):
            u = amplitude if k * STEP_S < 1.0 else -amplitude
            # JSBSim's rudder command is positive nose left.
            fdm["fcs/aileron-cmd-norm"] = trims[0] + u
            fdm["fcs/rudder-cmd-norm"] = trims[1] - gain * u
            fdm.run()
            found.append(fdm["aero/beta-rad"])
        return np.array(found)

    rest = rolled(0.0, 0.0)
    own = -aileron[R] / -rudder[R]
    slip = [rolled(gain, 0.08) - rest for gain in (mix, 0.0, own)]
    left = [float(np.sqrt(np.mean(each**2))) for each in slip]
    assert left[0] < 0.85 * left[1]
    assert left[0] < 0.5 * left[2]
