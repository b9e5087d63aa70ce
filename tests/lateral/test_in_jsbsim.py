"""The rudder mix and turns: of a known plant, and in JSBSim's flights."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks.judge import replayed
from flights.flight import Flight, Hands, trimmed
from flights.moved import PLACES, pulses
from flights.plan import STEP_S, FlightPlan, Link, excitation, plan_at
from flights.surgery import join
from flights.telemetry import telemetry
from flights.truth import LATERAL, lateral, linear_dutch_rolls
from scipy.signal import StateSpace, lsim

from yawid.config.run import RunConfig
from yawid.lateral.fit_airframe import fit_airframe
from yawid.lateral.mix import ROLLS_S, rudder_mixes
from yawid.lateral.model import NAMES
from yawid.manoeuvre import bare_answer

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


@pytest.mark.long
@pytest.mark.parametrize("name", ["T37", "737"])
def test_a_turn_moves_wn_by_less_than_3_percent(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Over the airspeed, which a turn with the nose held changes by up to 9 %; gates may refuse."""
    fits = []

    def kept(*of: Any, **how: Any) -> Any:
        fits.append(fit_airframe(*of, **how))
        return fits[-1]

    monkeypatch.setattr(bare_answer, "fit_airframe", kept)
    plan = plan_at(next(each for each in PLACES if each[0] == name), seconds=45.0)
    wn = linear_dutch_rolls(plan)["dutch_roll"]["wn_rad_s"]
    plan = replace(plan, step_s=0.3 * math.tau / wn)
    rudder, link, log = excitation(plan), Link(25.0, 25.0, seed=5), tmp_path / "log.tlog"
    rolled_in = np.minimum(0.001 * np.arange(len(rudder)) / 3.0, 1.0)
    airspeeds = []
    for bank_deg in (0.0, 30.0, 45.0):
        aileron = pulses(np.random.default_rng(5), plan.seconds, 0.08, 0.4)
        hands = Hands(rudder, aileron, math.radians(bank_deg) * rolled_in)
        log.write_bytes(join(telemetry(link, Flight(plan, hands, link))))
        [found] = replayed(log, RunConfig(lateral="auto")).manoeuvres
        airspeeds.append(found.airspeed_m_s)

    kappas = [fit.wn_rad_s.value / speed for fit, speed in zip(fits, airspeeds, strict=True)]
    assert [each / kappas[0] for each in kappas[1:]] == pytest.approx([1.0, 1.0], abs=0.03)
