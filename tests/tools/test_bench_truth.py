"""The bench of the truth: what it counts of an estimate, and when a criterion is not met."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from bench import frame
from bench.accuracy import tables
from bench.frame import Row
from checks import judge
from checks.judge import compared
from flights.linear import GRAVITY
from flights.plan import KNOT, FlightPlan, plan_at
from flights.truth import dutch_roll, with_roll_hold
from hand_flights import estimate, plain_summary, roll_of, verdict
from msgspec.structs import replace

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, DutchRoll, Flight, Manoeuvre, Response, Value

CONDITIONS: dict[str, Any] = {
    "aircraft": "c172p", "severity": 0, "air": "calm", "gyro": "clean", "rate_hz": 25,
    "manoeuvre": "3211",
}  # fmt: skip
TRUTH = {
    "flown": [[100.0, 80.0], [140.0, 80.0], [200.0, 100.0], [240.0, 100.0]],
    "lines": {
        "dutch_roll": {"mean_kt": 80.0, "line": {"at": [2.0, 0.2], "per_kt": [0.025, 0.0]},
                       "pulse": [0.04, 0.03]},
        "dutch_roll_open_loop": {"mean_kt": 80.0, "line": {"at": [1.85, 0.2], "per_kt": [0, 0]},
                                 "pulse": [0.03, 0.0]},
    },
}  # fmt: skip
"""wn is 2.0 at 80 kt and 2.5 at 100, zeta .2; without the roll loop wn is 1.85."""


def found(n: int, airspeed: float, wn: float, of: Verdict, els: float | None = None) -> Manoeuvre:
    """A manoeuvre whose answer has a total sigma of .05; RML of the stream had wn + .1, ELS els.

    Its bare airframe has 1.9.
    """
    answer = estimate("ct", roll_of(wn, 0.2, 0.05, 0.04, (0.03, 0.01)))
    stream = {
        method: estimate(
            method, None if x is None else DutchRoll(wn_rad_s=x, wn_std=0.03, zeta=0.2)
        )
        for method, x in (("rml", wn + 0.1), ("els", els))
    }
    bare = DutchRoll(wn_rad_s=1.9, wn_std=0.04, zeta=0.2, zeta_std=0.04)
    return Manoeuvre(
        n=n, from_s=100.0 * n, to_s=100.0 * n + 40.0, duration_s=40.0, loop="unknown",
        airspeed_m_s=airspeed, inputs=["rudder"], turn_removed=False,
        estimates={"ct": answer} | stream, verdict=replace(of, method="ct"),
        lateral=Bare(dutch_roll=bare, used=[n], verdict=of),
    )  # fmt: skip


@cache
def rows() -> list[Row]:
    """The rows of a flight with two answers, and of one whose answer is refused."""
    roll = DutchRoll(wn_rad_s=2.295, wn_std=0.03, wn_std_mean=0.015, zeta=0.2, zeta_std=0.04)
    answered = Flight(
        airspeed_m_s=45.0, dutch_roll=roll, used=[1, 2], disagree=[], verdict=verdict()
    )
    refused = Flight(used=[], disagree=[], verdict=verdict("poor_fit"))
    pair = [found(1, 40.0, 2.128, verdict()), found(2, 50.0, 2.5, verdict())]
    unfit = [found(1, 40.0, 3.0, verdict("poor_fit"), els=2.04)]
    summaries = (
        plain_summary(manoeuvres=manoeuvres, flight=flight)
        for manoeuvres, flight in ((pair, answered), (unfit, refused))
    )
    return [
        CONDITIONS | {"number": number} | row
        for number, summary in enumerate(summaries)
        for row in compared(summary, TRUTH)
    ]


def test_each_estimate_is_held_to_its_own_truth_by_both_sigmas() -> None:
    rml, els, answer, bare, *_, flight = [row for row in rows() if row["number"] == 0]

    errors_and_z = {
        "answer": (6.4, 0.128 / math.hypot(0.05, 0.04)),  # of the estimate, and of the truth
        "rml": (11.4, 0.228 / math.hypot(0.03, 0.04)),
        "bare": (100.0 * 0.05 / 1.85, 0.05 / math.hypot(0.04, 0.03)),
    }
    found = {"answer": answer, "rml": rml, "bare": bare}
    assert {name: (row["wn_error_pct"], row["wn_z"]) for name, row in found.items()} == {
        name: pytest.approx(of) for name, of in errors_and_z.items()
    }
    assert els["wn"] is els["wn_z"] is None
    assert flight["wn_true"] == pytest.approx(2.25)  # at 45 m/s, as 2.0 at 40 and 2.5 at 50 say
    assert flight["wn_true_sigma"] == pytest.approx(0.0407, abs=0.001)
    assert flight["wn_error_pct"] == pytest.approx(2.0)
    assert flight["wn_z"] == pytest.approx(0.045 / 0.05057, abs=0.01)
    assert flight["wn_z_mean"] == pytest.approx(0.045 / 0.04338, abs=0.01)


def test_a_model_with_the_aileron_is_held_to_the_truth_without_the_roll_loop() -> None:
    by_aileron = judge.true_at(TRUTH, 100.0, 140.0, ["rudder", "aileron"])

    assert by_aileron[0].tolist() == [1.85, 0.2]  # the hold is no part of such a model
    assert judge.true_at({"dutch_roll": None}, 150.0, 160.0, ["rudder"]) is None


def test_the_figures_of_two_answers_are_those_by_hand() -> None:
    lines = {text.split(" | ")[0]: text for text in next(tables(rows()))}

    # +6.4 % and 0 %, +2 and 0 sigma; the refused one does not count, but its ELS does: +2 %, .8
    assert lines["| answer, all"] == (
        "| answer, all | 2 | 67 | 3.20 | +3.20 | 4.53 | +0.0000 | 0.0000 "
        "| 1.41 0.00 | 100 100 | 0 |"
    )
    assert lines["| ELS, calm"] == (
        "| ELS, calm | 1 | 33 | 2.00 | +2.00 | 2.00 | +0.0000 | 0.0000 | 0.80 - | 100 0 | 0 |"
    )
    assert lines["| RML, calm"].startswith("| RML, calm | 3 | 100 | 11.40 | +23.47 |")
    assert lines["| flight; then its mean"].split(" | ")[8] == "0.89 0.00, 1.04 -"
    assert frame.cells(rows(), "bare")["answered %"] == "67"


def test_a_criterion_is_missed_by_more_than_its_own_error_over_the_flights() -> None:
    def missed(figure: str, limit: float, draws: int) -> int:
        limits = [({}, "wn", figure, limit), ({"aircraft": "T38"}, "wn", figure, limit)]
        return len([*frame.criteria(rows(), "manoeuvre", limits, {}, draws)])

    assert [missed("median", limit, 500) for limit in (3.1, 3.3)] == [1, 0]  # no T38 was flown
    assert [missed("answered %", limit, 1) for limit in (66.0, 67.0)] == [0, 1]
    assert missed("answered %", 67.0, 500) == 0  # one of the two flights has no answer
    # z of wn is 1.41, 1.3 is allowed; for fewer than 20 answers it is no criterion
    few, enough = ([*frame.criteria([], "manoeuvre", (), {"all": rows() * n})] for n in (9, 10))
    assert few == []
    assert [line.split(": ")[:3] for line in enough] == [["not met", "manoeuvre, wn, all", "z"]]


def answering(of: Response) -> Manoeuvre:
    """A manoeuvre whose answer has this response, a K of .308 and a yaw acceleration of 1."""
    made = found(1, 40.0, 2.0, verdict())
    own = replace(made.estimates["ct"], response=of, yaw_acceleration=Value(1.0, 0.1))
    return replace(made, estimates={"ct": own})


def test_a_gain_and_its_sigma_are_those_of_the_transfer_function() -> None:
    # 4 (s + .5) / (s^2 + .8 s + 4) has the residue 2 + .6j / (2 w) at -.4 + j w, w^2 = 3.84
    w = math.sqrt(3.84)
    covariance = np.zeros((6, 6))
    covariance[4, 4] = 0.01
    of = Response(
        poles=[[-0.4, w]], covariance=covariance.tolist(),
        residues={"aileron": [[1.0, 0.0]], "rudder": [[2.0, -0.1 * 4.0 / (2.0 * w)]]},
    )  # fmt: skip

    value, std = judge.numbers_shown(answering(of), 2.0)[list(judge.AT).index(1.0)]

    s = 2.0j
    G = 4.0 * (s + 0.5) / (s**2 + 0.8 * s + 4.0)
    slope = (G.conjugate() * (2.0 * s + 0.8) / (s**2 + 0.8 * s + 4.0)).real / abs(G)
    assert value == pytest.approx(abs(G))
    assert std == pytest.approx(0.1 * abs(slope), rel=1e-5)


@pytest.mark.parametrize("turn_removed", [False, True])
def test_an_answer_with_jsbsim_s_own_response_is_not_off(turn_removed: bool) -> None:
    truth = {"aircraft": "T37", "altitude_m": 1524.0, "flown": [[0.0, 150.0], [120.0, 200.0]]}
    A, b = with_roll_hold(plan_at(("T37", 5000.0, 200.0)))[1]
    turn = turn_removed * GRAVITY / (200.0 * KNOT)
    poles, modes = np.linalg.eig(A)  # two pairs
    seen = np.array([0.0, -turn, 0.0, 1.0]) @ modes
    both = np.stack([poles, seen * np.linalg.solve(modes, -b)])[:, poles.imag > 0.0]
    of, by = np.stack([both.real, both.imag], axis=2).tolist()
    covariance = (1e-6 * np.eye(8)).tolist()
    exact = answering(Response(poles=of, residues={"rudder": by}, covariance=covariance))
    wn = dutch_roll(A, b, 3)["wn_rad_s"]

    off = judge.response_errors(replace(exact, turn_removed=turn_removed), truth, wn)

    for name in judge.SHOWN[:3]:
        assert abs(off[f"{name}_error_pct"]) < 1e-6
    K, acceleration = (x / (1.0 + off[f"{name}_error_pct"] / 100.0)
                       for name, x in (("K", 0.308), ("yaw acceleration", 1.0)))  # fmt: skip
    assert off["K_z"] == pytest.approx((0.308 - K) / 0.006)
    # a step of the rudder makes the yaw acceleration of its column, to the left if b is positive
    assert acceleration == pytest.approx(-b[3], rel=0.06 if turn_removed else 0.05)
    assert 0.0 < K < acceleration


def test_the_truth_of_a_linear_aircraft_has_its_rudder_s_lag() -> None:
    A = np.array([[-0.1, 0.4, 0.0, -1.0], [0.0, 0.0, 1.0, 0.0], [-9.0, 0.0, -4.0, 1.0],
                  [6.0, 0.0, -0.1, -0.5]])  # fmt: skip
    own = {"airspeed_m_s": GRAVITY / 0.4, "servo_lag_s": 0.2, "L_delta_a": 8.0, "N_delta_a": 0.0}
    own |= {"Y_delta_r": 0.0, "L_delta_r": 0.5, "N_delta_r": 2.0}
    for i, row in {0: "Y", 2: "L", 3: "N"}.items():
        own |= {f"{row}_{name}": A[i, j] for j, name in ((0, "beta"), (2, "p"), (3, "r"))}
    hold = np.array([0.0, 0.3, 0.0, 0.0])
    plan = FlightPlan(own=tuple(own.items()), roll_gain=0.3, roll_rate_gain=0.0)

    bare, closed = with_roll_hold(plan)

    w = 2.7
    lag, s = 1.0 / (1.0 + 0.2j * w), 1j * w * np.eye(6)
    surface = lag * np.array([0.0, 0.0, 0.5, 2.0])
    held = A - lag * np.outer([0.0, 0.0, 8.0, 0.0], hold)
    for (found, rudder), of in ((bare, A), (closed, held)):
        exact = np.linalg.solve(s[:4, :4] - of, surface)
        assert np.linalg.solve(s - found, -rudder)[:4] == pytest.approx(exact)
