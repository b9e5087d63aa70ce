"""The corpora: true, repeatable, and a quiet log's rudder has nothing of its own."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench.frame import log_rows
from checks.judge import judged
from flights import quiet
from flights import truth as jsbsim_truth
from flights.flight import Flight, Hands
from flights.fly import fly
from flights.plan import FlightPlan, Link, excitation
from flights.surgery import join, messages, split
from flights.telemetry import telemetry
from made_logs import columns

SHORT = FlightPlan(aircraft="T37", speed_kt=200.0, altitude_ft=5000.0, seconds=12.0)
STILL = ("turns", "gusts", "drift")
COPIES = ("mixed", "coordinated", "damper")


def flown_log(hands: Hands, severity: int, plan: FlightPlan = SHORT, hz: float = 10.0) -> bytes:
    """The log of a flight; what takes longer, its truth, is not asked for."""
    link = Link(attitude_hz=hz, servo_hz=hz)
    return join(telemetry(link, Flight(plan, hands, link, severity)))


def made_of(group: str) -> Any:
    return quiet.unexcited(quiet.KINDS.index(group))


@pytest.fixture(scope="module")
def flown() -> dict[str, Any]:
    """One log of each kind that JSBSim flies, short and without its truth."""
    with pytest.MonkeyPatch.context() as patch:
        unknown = {"dutch_roll": None, "dutch_roll_open_loop": None}
        patch.setattr("flights.fly.truth_lines", lambda *_: unknown)
        place = "T37", 5000.0, 200.0  # quickly trimmed
        return {
            group: quiet.quiet(group, np.random.default_rng([13, 1, number]), [place], [25.0])
            for number, group in enumerate(quiet.KINDS)
            if group in (*STILL, *COPIES, "passenger")
        }


def test_the_truth_is_that_of_the_airspeed_flown_not_of_the_one_trimmed_for() -> None:
    slowed = Hands(bank=np.full(12_001, 0.9))  # steep: the nose held, it slows down
    made = fly(SHORT, Link(attitude_hz=10.0, servo_hz=10.0), slowed)

    speeds = columns(made.log, "VFR_HUD", "airspeed")[20:, 0]  # four a second, after the lead-in
    told = made.truth

    assert told["airspeed_m_s"] == pytest.approx(speeds.mean(), rel=1e-3)
    trimmed = jsbsim_truth.linear_dutch_rolls(SHORT)["dutch_roll"]["wn_rad_s"]
    share = told["airspeed_m_s"] / (SHORT.speed_kt * 0.514444)
    assert abs(share - 1.0) > 0.005
    assert told["dutch_roll"]["wn_rad_s"] / trimmed == pytest.approx(share, abs=0.01)


def test_the_same_number_gives_the_same_bytes_and_another_number_others() -> None:
    first, again, calm = (flown_log(Hands(), severity) for severity in (3, 3, 0))

    assert first == again != calm
    assert made_of("parked").log == made_of("parked").log
    assert made_of("parked").log != quiet.unexcited(11 + len(quiet.KINDS)).log


@pytest.mark.parametrize("group", STILL)
def test_a_rudder_without_a_cause_rests_or_drifts_by_2_percent(
    group: str, flown: dict[str, Any]
) -> None:
    rudder = columns(flown[group].log, "SERVO_OUTPUT_RAW", "servo4_raw")

    assert np.ptp(rudder) <= (0.04 * 400 if group == "drift" else 0.0)


@pytest.mark.parametrize("group", COPIES)
def test_a_copied_rudder_moves_and_has_nothing_of_its_own(
    group: str, flown: dict[str, Any]
) -> None:
    moved, own = rudder_and_its_own_part(flown[group].log, damped=group == "damper")

    assert moved > 0.04 * 400
    assert own < 0.2


def rudder_and_its_own_part(log: bytes, *, damped: bool) -> tuple[float, float]:
    """The rudder's stroke in us, and the share of its deviation that its cause leaves.

    The cause is the aileron, or the yaw rate, by lags of up to 0.5 s or to the tail of the washout.
    """
    servos = columns(log, "SERVO_OUTPUT_RAW", "time_usec", "servo1_raw", "servo4_raw")
    rates = columns(log, "ATTITUDE", "time_boot_ms", "yawspeed")
    t, aileron, rudder = servos[:, 0] / 1e6, servos[:, 1], servos[:, 2]
    cause = np.interp(t, rates[:, 0] / 1e3, rates[:, 1]) if damped else aileron
    lags = np.concatenate([np.arange(-0.2, 0.6, 0.1), np.arange(0.6, 12.0, 0.6) if damped else []])
    phi = np.column_stack([np.interp(t - lag, t, cause) for lag in lags] + [t, np.ones(len(t))])
    left = rudder - phi @ np.linalg.lstsq(phi, rudder, rcond=None)[0]
    return float(np.ptp(rudder)), float(left.std() / rudder.std())


def test_a_passengers_controls_move_and_its_outputs_do_not(flown: dict[str, Any]) -> None:
    log = flown["passenger"].log
    outputs = [
        columns(log, name, *fields)
        for name, fields in (
            ("SERVO_OUTPUT_RAW", ("servo1_raw", "servo3_raw", "servo4_raw")),
            ("ACTUATOR_OUTPUT_STATUS", ("active",)),
        )
    ]
    yaw = [m.controls[2] for m in messages(split(log), "ACTUATOR_CONTROL_TARGET")]

    assert np.ptp(yaw) > 0.02
    assert sum(len(found) for found in outputs) == len(yaw)
    assert all(np.ptp(found, axis=0).max() == 0.0 for found in outputs if len(found))


def test_made_logs_are_judged_into_rows_beside_their_truth(
    tmp_path: Path, flown: dict[str, Any]
) -> None:
    plan = FlightPlan(aircraft="T37", speed_kt=200.0, altitude_ft=5000.0, seconds=40.0, step_s=0.64)
    made = fly(plan, Link(20.0, 20.0), Hands(excitation(plan)), group="calm")
    logs = {"excited_003": lambda: made, "unexcited_003": lambda: flown["mixed"]}

    flight, mixed = (log_rows(judged, tmp_path, 3, *each)[-1] for each in logs.items())

    assert (flight["log"], flight["number"]) == ("excited", 3)
    assert flight["usable"]
    assert abs(flight["wn_error_pct"]) < 5.0
    assert flight["wn_true"] == pytest.approx(made.truth["dutch_roll"]["wn_rad_s"], rel=1e-2)
    assert mixed["group"] == "mixed"
    assert not mixed["usable"]
    assert (tmp_path / "excited_003.tlog").read_bytes() == made.log
