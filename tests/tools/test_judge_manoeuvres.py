"""What is found in whole flights is held to the truth of the manoeuvre it overlaps, and counted."""

from typing import Any

import pytest
from checks import judge
from hand_flights import estimate, manoeuvre, plain_summary, verdict

from yawid.answers.model_parts import Fit
from yawid.answers.run_summary import (
    DutchRoll,
    Flight,
    Manoeuvre,
    RunSummary,
    Value,
)

TRUTH: dict[str, Any] = {
    "manoeuvres": [
        {
            "n": n,
            "kind": "3211",
            "from_s": 100.0 * n,
            "to_s": 100.0 * n + 30.0,
            "airspeed_m_s": 30.0 + 10.0 * n,
            "dutch_roll": {"wn_rad_s": 1.5 + 0.5 * n, "zeta": 0.25},
            "with_roll_loop": {"wn_rad_s": 1.5 + 0.5 * n, "zeta": 0.25, "K": 1.0},
            "airframe": {"wn_rad_s": 1.6 + 0.5 * n, "zeta": 0.2, "K": 1.0},
        }
        for n in (1, 2)
    ],
    "kappa_rad_m": {"with_roll_loop": {"mean": 0.05}, "airframe": {"mean": 0.052}},
    "legs": [
        {"kind": "idle", "from_s": 30.0, "to_s": 98.0},
        {"kind": "manoeuvre", "from_s": 98.0, "to_s": 140.0},
        {"kind": "turn", "from_s": 140.0, "to_s": 198.0},
        {"kind": "manoeuvre", "from_s": 198.0, "to_s": 240.0},
    ],
}


def found(first_s: float, wn: float, zeta: float, *reasons: str, **told: Any) -> Manoeuvre:
    """A manoeuvre with its answer, without sigmas."""
    answer = estimate("ct", DutchRoll(wn_rad_s=wn, zeta=zeta), None, physics=None, fit=Fit())
    of = {"from_s": first_s, "to_s": first_s + 38.0, "duration_s": 38.0, "altitude_m": 900.0}
    own = {"estimates": {"ct": answer}, "verdict": verdict(*reasons)}
    return manoeuvre(told.pop("n", 1), speed=45.0, **of | own | told)


def summary(*manoeuvres: Manoeuvre, flight: Flight | None = None) -> RunSummary:
    return plain_summary(manoeuvres=list(manoeuvres), flight=flight)


def rows_of(*manoeuvres: Manoeuvre) -> list[judge.Row]:
    kinds = ("manoeuvre", "missed")
    return [row for row in judge.compared(summary(*manoeuvres), TRUTH) if row["kind"] in kinds]


@pytest.mark.parametrize(
    ("manoeuvre", "off_pct"),
    [
        (found(99.0, 2.04, 0.26), 2.0),
        (found(99.0, 2.50, 0.25, "poor_fit"), 25.0),
        (found(99.0, 2.04, 0.21, inputs=["rudder", "aileron"]), -2.857),
    ],
    ids=["usable", "refused", "aileron as an input"],
)
def test_a_manoeuvre_is_held_to_its_own_truth(manoeuvre: Manoeuvre, off_pct: float) -> None:
    own, missed = rows_of(manoeuvre)

    assert own["of"] == 1
    assert own["usable"] is not any(manoeuvre.verdict.fatal)
    assert own["wn_error_pct"] == pytest.approx(off_pct, abs=1e-3)
    assert (missed["kind"], missed["of"]) == ("missed", 2)


def test_what_is_found_elsewhere_has_no_truth_and_both_are_missed() -> None:
    elsewhere, *missed = rows_of(found(150.0, 2.0, 0.25))

    assert (elsewhere["of"], elsewhere["wn_error_pct"], elsewhere["leg"]) == (None, None, "turn")
    assert [row["of"] for row in missed] == [1, 2]


def test_the_flight_is_held_to_the_truth_at_its_airspeed_and_in_its_sigmas() -> None:
    flight = Flight(
        airspeed_m_s=45.0, loop="with_roll_loop", used=[1, 2], disagree=[3], verdict=verdict(),
        dutch_roll=DutchRoll(wn_rad_s=2.295, wn_std=0.03, zeta=0.26, zeta_std=0.02),
        kappa_rad_m=Value(0.0505, 0.001),
    )  # fmt: skip
    pair = (found(100.0 * n, 2.0, 0.25, n=n, airspeed_m_s=30.0 + 10.0 * n) for n in (1, 2))

    told = judge.compared(summary(*pair, flight=flight), TRUTH)[-1]

    assert told["wn_error_pct"] == pytest.approx(2.0)  # of 2.25: 2.0 at 40 m/s, 2.5 at 50
    assert (told["kappa"], told["kappa_true"], told["disagree"]) == (0.0505, 0.05, 1)
