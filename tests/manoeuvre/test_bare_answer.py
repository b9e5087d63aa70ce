"""A flight's bare airframe from those of its manoeuvres: which of them, and by which laws."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import hand_flights
import numpy as np
import pytest
from lateral.flown import flown
from msgspec.structs import replace as msgspec_replace

from yawid.answers.reasons import Reason
from yawid.answers.run_summary import DutchRoll
from yawid.lateral.airframe import Airframe, Known
from yawid.lateral.motion import Motion
from yawid.manoeuvre import bare_answer
from yawid.manoeuvre.bare_answer import Fitted, against_flown, bare_of, fitted, lateral_of

MOTION, MOTION_OF_20_S = flown(seconds=2.0), flown(seconds=20.0)
NAMES = (
    "Y_beta", "L_beta", "L_p", "L_r", "L_delta_a", "L_delta_r",
    "N_beta", "N_p", "N_r", "N_delta_a", "N_delta_r", "Y_delta_r",
)  # fmt: skip


def airframe(v: float = 50.0, wn: float = 2.4, std: float = 0.02, **changed: Any) -> Airframe:
    given: dict[str, Any] = {
        "wn_rad_s": Known(wn, std), "zeta": Known(0.2, 0.01), "roll_s": Known(0.25, 0.02),
        "spiral_s": Known(40.0, 10.0), "derivatives": dict.fromkeys(NAMES, Known(1.0, 0.1)),
        "servo_lag_s": Known(0.1, 0.01), "delay_s": Known(0.0, 0.01),
        "rudder_mix": Known(0.3, 0.05), "gust_std_rad": 0.01,
        "rho1": 0.1, "airspeed_m_s": v,
        "alpha_rad": Known(0.05, 0.01), "correlations": np.eye(14), "from_prior": (),
    }  # fmt: skip
    return Airframe(**(given | changed))


def found(n: int, of: Airframe | None, motion: Motion | str = MOTION) -> Fitted:
    return Fitted(n, motion, of, "" if of is not None else str(motion))


def test_airframes_of_other_airspeeds_are_brought_to_the_middle_one_by_their_laws():
    """At 40, 50 and 60 m/s with wn = 0.05 V, N_beta = 2 V^2, N_r = -0.01 V, roll = 10 / V."""
    each = [
        found(n, airframe(
            v, 0.05 * v, 0.001 * v, roll_s=Known(10.0 / v, 1.0 / v),
            derivatives=dict.fromkeys(NAMES, Known(1.0, 0.1)) | {
                "N_beta": Known(2.0 * v**2, 0.1 * v**2), "N_r": Known(-0.01 * v, 0.001 * v)},
        ))
        for n, v in enumerate((40.0, 50.0, 60.0), start=1)
    ]  # fmt: skip

    bare = bare_of(each, None)

    linear = 0.008 * 2.5  # what a linear model is worth, whatever the number of manoeuvres
    std = math.sqrt((0.05**2 + 2.0 * linear**2) / 3.0)
    assert (bare.used, bare.airspeed_m_s) == ([1, 2, 3], 50.0)
    assert (bare.dutch_roll.wn_rad_s, bare.dutch_roll.wn_std) == pytest.approx((2.5, std))
    assert bare.roll_mode.time_constant_s == pytest.approx(0.2)
    assert bare.derivatives["N_beta"].value == pytest.approx(5000.0)
    assert bare.derivatives["N_r"].value == pytest.approx(-0.5)


UNSETTLED, GATES = {"not_settled": 1.0}, {"coloured": 0.67, "too_slow": 0.51}
STOPPED = airframe(wn=9.0, failed={"coloured": 0.5})


@pytest.mark.parametrize(
    ("airframes", "used", "wn", "said"),
    [
        # The mean is 2.4, and sigma .08 as their half difference. Half of the variance of a linear
        # model, 0.8 % of wn, is common to both and added.
        pytest.param(
            [airframe(wn=2.32, std=0.03), airframe(wn=2.48, std=0.03)], [1, 2],
            (2.4, math.hypot(0.08, 0.008 * 2.4 * math.sqrt(0.5))), "",
            id="a scatter beyond their sigmas makes sigma larger",
        ),
        pytest.param(
            [STOPPED, airframe(), None], [2], (2.4, 0.02), "", id="those that pass are used"
        ),
        # It was that of the fewest gates: a hand-flown log's was an unusable manoeuvre's.
        pytest.param(
            [airframe(std=100.0, failed=UNSETTLED), airframe(std=0.5, failed=GATES), None],
            [2], None, "attitude and servo outputs come at 0.51 of the rate",
            id="where none passes the cause is that of the best known",
        ),
        pytest.param(
            [STOPPED], [1], None, "the innovations predict 0.50 of those 40 ms later (limit 0.35)",
            id="a gate has its words",
        ),
    ],
)  # fmt: skip
def test_several_airframes_are_pooled_of_those_that_pass(
    airframes: list[Airframe | None], used: list[int], wn: tuple[float, float] | None, said: str
):
    each = [found(n, of, MOTION if of else "no attitude") for n, of in enumerate(airframes, 1)]
    bare = bare_of(each, None)

    assert (bare.used, bare.verdict.usable) == (used, wn is not None)
    if wn is None:
        assert (bare.dutch_roll, bare.derivatives) == (None, None)
        assert bare.verdict.reasons[0].text.startswith(said)
        assert bare.verdict.next
    else:
        assert (bare.dutch_roll.wn_rad_s, bare.dutch_roll.wn_std) == pytest.approx(wn)


@pytest.mark.parametrize(("damper", "refused"), [(0.0, False), (0.5, True)])
def test_a_rudder_that_feeds_the_yaw_rate_back_is_refused_without_any_parameter(
    damper: float, refused: bool
):
    motion = flown(3, seconds=20.0, amplitude=0.3, damper=damper)

    told = lateral_of(fitted(1, motion, 0.0, hand_flights.manoeuvre(1, 2.4, loop="airframe")))

    said = " ".join(reason.text for reason in told.verdict.reasons)
    assert ("is feedback of the yaw rate (limit 0.1)" in said) == refused
    assert told.verdict.usable != refused


@pytest.mark.parametrize(
    ("wn", "zeta", "loop", "usable", "known"),
    [(2.50, 0.2, "airframe", True, True), (2.51, 0.2, "airframe", True, False),
     (2.46, 0.3, "airframe", True, False), (2.51, 0.2, "airframe", False, True),
     (2.70, 0.4, "with_roll_loop", True, True), (2.72, 0.4, "with_roll_loop", True, False),
     (2.66, 0.3, "with_roll_loop", True, False), (2.4, 0.2, "with_roll_loop", True, False)],
)  # fmt: skip
def test_as_it_was_flown_the_airframe_must_be_within_one_and_a_half_times_both_sigmas(
    wn: float, zeta: float, loop: str, usable: bool, known: bool
):
    """2.4 +- .03 / .2 by itself, against +- .04 / .01; 2.6 +- .03 / .4 with its roll law."""
    roll = DutchRoll(wn_rad_s=wn, wn_std=0.04, zeta=zeta, zeta_std=0.01)
    flown = hand_flights.manoeuvre(1, wn, loop=loop, inputs=["rudder"])
    verdict = msgspec_replace(flown.verdict, usable=usable)
    its = {verdict.method: msgspec_replace(flown.estimates[verdict.method], dutch_roll=roll)}
    flown = msgspec_replace(flown, estimates=its, verdict=verdict)
    closed = Known(2.6, 0.03), Known(0.4, 0.01)

    told = lateral_of(against_flown(found(1, airframe(std=0.03, as_flown=closed)), flown))

    assert told.verdict.usable == known


@pytest.mark.parametrize(
    ("reason", "known"),
    [("not_excited", False), ("mode_not_driven", False), ("not_converged", True)],
)
def test_a_rudder_that_did_not_drive_the_yaw_shows_no_airframe(
    reason: str, known: bool, monkeypatch: pytest.MonkeyPatch
):
    """Rudder and aileron together often leave the yaw alone unresolved, and the airframe known."""
    said = Reason(reason, "for the test", weight="fatal")
    flown = hand_flights.manoeuvre(1, 2.4, loop="with_roll_loop", reason=said)

    monkeypatch.setattr(bare_answer, "fit_airframe", lambda motions, servo_lag_s: airframe())

    told = lateral_of(against_flown(fitted(1, MOTION_OF_20_S, None, flown), flown))

    assert told.verdict.usable == known
    if not known:
        assert told.verdict.reasons[0].text.endswith(f"the answer as flown is {reason}")


@pytest.mark.parametrize(
    ("gate", "together"), [("lag_unknown", True), ("rudder_copies_aileron", False)]
)
def test_manoeuvres_whose_lag_is_unknown_are_fitted_together(
    monkeypatch: pytest.MonkeyPatch, gate: str, together: bool
):
    """What speaks against the data itself is not mended by more of it."""
    asked: list[int] = []

    def fit(motions: list[Motion], *, servo_lag_s: float | None) -> Airframe:
        asked.append(len(motions))
        return airframe()

    monkeypatch.setattr(bare_answer, "fit_airframe", fit)
    failed = airframe(failed={gate: 1.0})

    bare = bare_of([found(1, failed), found(2, failed)], None)

    assert asked == ([2] if together else [])
    assert bare.verdict.usable == together


@pytest.mark.parametrize(
    ("motion", "said"),
    [(MOTION_OF_20_S, "the fit failed: nothing there"),
     ("the airspeed is not known", "the airspeed is not known")],
)  # fmt: skip
def test_a_fit_that_fails_and_a_motion_that_is_missing_are_causes_and_no_errors(
    monkeypatch: pytest.MonkeyPatch, motion: Motion | str, said: str
):
    """The answer as flown must not fail with it."""

    def fails(motions: list[Motion], *, servo_lag_s: float | None) -> Airframe:
        raise IndexError("nothing there")

    monkeypatch.setattr(bare_answer, "fit_airframe", fails)

    assert [
        each.text
        for each in lateral_of(
            fitted(1, motion, None, hand_flights.manoeuvre(1, 2.4))
        ).verdict.reasons
    ] == [said]


FOLLOWED = flown(4, seconds=20.0, hold=(1.0, 0.3), aileron=0.0)
TEN_HZ = flown(seconds=20.0, rate_hz=10.0)
SLOW = "attitude and servo outputs come at 10 Hz, and a mode of 7.2 rad/s needs 12 Hz"


@pytest.mark.parametrize(
    ("motion", "changed", "loop", "wn", "said"),
    [
        (MOTION_OF_20_S, {}, "with_roll_loop", 2.4, ""),
        (MOTION_OF_20_S, {"aileron_known": False}, "airframe", 2.4, "no aileron was found"),
        (MOTION_OF_20_S, {"commands_exact": False}, "airframe", 2.4, "the commands are known on"),
        (MOTION_OF_20_S, {"aileron": MOTION_OF_20_S.rudder}, "airframe", 2.4,
         "the aileron explains 1.000 of the rudder's variance (limit 0.98)"),
        (MOTION_OF_20_S, {"aileron": 0.0 * MOTION_OF_20_S.aileron}, "with_roll_loop", 2.4,
         "the aileron never moves, although the autopilot holds the roll"),
        (FOLLOWED, {}, "with_roll_loop", 2.4, "the aileron only follows the roll hold"),
        (MOTION_OF_20_S, {"aileron": 0.0 * MOTION_OF_20_S.aileron}, "airframe", 2.4, ""),
        (TEN_HZ, {}, "airframe", 7.2, SLOW),
        (TEN_HZ, {}, "airframe", 6.3, ""),  # less three sigmas it may be slow enough
    ],
)  # fmt: skip
def test_what_a_record_and_its_answer_as_flown_lack_refuses_the_airframe_without_a_fit(
    motion: Motion, changed: dict[str, Any], loop: str, wn: float, said: str,
    monkeypatch: pytest.MonkeyPatch,
):  # fmt: skip
    fits: list[Any] = []

    def fit(motions: list[Motion], **_: Any) -> Airframe:
        fits.extend(motions)
        return airframe()

    monkeypatch.setattr(bare_answer, "fit_airframe", fit)
    monkeypatch.setattr(bare_answer, "_fed_back", lambda motion, found: 0.0)
    flown = hand_flights.manoeuvre(1, wn, loop=loop)
    motion = replace(motion, **changed)

    refused = fitted(1, motion, None, flown)

    assert (refused.why.startswith(said), bool(fits)) == (True, not said)
    assert bool(refused.step) == bool(said)


def test_an_aileron_that_only_follows_needs_a_servos_lag_of_a_sample(
    monkeypatch: pytest.MonkeyPatch,
):
    """The lag takes the noise of the same sample out of the aileron."""
    monkeypatch.setattr(bare_answer, "fit_airframe", lambda motions, servo_lag_s: airframe())
    flown = hand_flights.manoeuvre(1, 2.4)

    known = [fitted(1, FOLLOWED, lag_s, flown).is_known for lag_s in (None, 0.0, 0.039, 0.041)]

    assert known == [False, False, False, True]
