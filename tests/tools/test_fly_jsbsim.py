"""The flown test aircraft: true to its truth file, its frames genuine, its bytes repeatable."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import fly_jsbsim
import numpy as np
import pytest
from flights import truth as jsbsim_truth
from flights.flight import Flight, Hands, trimmed
from flights.plan import KNOT, FlightPlan, Link, Servo, excitation
from flights.surgery import Record, join, messages
from flights.telemetry import telemetry
from hypothesis import given
from hypothesis import strategies as st

SHORT = FlightPlan(seconds=12.0)


def fly(plan: FlightPlan, link: Link) -> Iterator[Record]:
    return telemetry(link, Flight(plan, link=link))


def test_a_positive_command_turns_the_nose_right_from_its_own_millisecond_on() -> None:
    still, moved = (Flight(SHORT, Hands(np.r_[np.zeros(100), np.full(10, x)])) for x in (0.0, 0.2))
    yaw_rates = []
    for ms in (100, 101):
        still.advance_to(ms)
        moved.advance_to(ms)
        yaw_rates.append(moved["velocities/r-rad_sec"] - still["velocities/r-rad_sec"])

    assert yaw_rates[0] == 0.0
    assert yaw_rates[1] > 0.0


def test_a_servo_message_says_what_the_rudder_is_told_at_its_stamp() -> None:
    plan = replace(SHORT, rudder=Servo(1050, 1480, 1950, reverse=True))
    told = excitation(plan)
    trim = -trimmed(plan)["fcs/rudder-cmd-norm"]

    servo = list(messages(fly(plan, Link(boot_s=0.0)), "SERVO_OUTPUT_RAW"))

    expected = [plan.rudder.pulse(trim + told[m.time_usec // 1000]) for m in servo]
    assert [m.servo4_raw for m in servo] == expected
    assert len(set(expected)) == 3


def test_the_attitude_is_the_flight_s_within_the_sensor_noise() -> None:
    clean = Link(rate_noise=0.0, angle_noise=0.0, boot_s=0.0)
    plan = replace(SHORT, heading_deg=180.0)
    flight = Flight(plan, link=clean)
    sent = list(messages(fly(plan, clean), "ATTITUDE"))

    for message in sent[::50]:
        flight.advance_to(message.time_boot_ms)
        assert message.yawspeed == np.float32(flight["velocities/r-rad_sec"])
        assert message.roll == np.float32(flight["attitude/phi-rad"])
    assert {m.yaw > 0 for m in sent} == {True, False}  # wrapped within +-pi
    noisy = messages(fly(plan, replace(clean, rate_noise=0.01)), "ATTITUDE")
    noise = [a.yawspeed - b.yawspeed for a, b in zip(noisy, sent, strict=True)]
    assert np.std(noise) == pytest.approx(0.01, rel=0.1)


def test_the_autopilot_hears_the_noise_that_attitude_tells_unless_asked_for_the_true_signals() -> (
    None
):
    plan = replace(SHORT, manoeuvre="none", roll_gain=0.0, roll_rate_gain=0.5)
    strokes = {}
    for feedback in (False, True):
        flight = Flight(replace(plan, true_feedback=feedback), link=Link(rate_noise=0.02))
        pulses, heard = [], []
        for ms in range(1, 4001):
            heard.append(flight.sensed(3))
            flight.advance_to(ms)
            pulses.append(flight.aileron_us)
        aileron = np.array([plan.aileron.unit(pulse) for pulse in pulses])
        expected = -0.5 * (np.array(heard) - np.mean(heard))
        assert np.max(np.abs(aileron - aileron.mean() - expected)) < 0.004  # whole us of 400
        strokes[feedback] = aileron.std()

    assert strokes[False] == pytest.approx(0.5 * 0.02, rel=0.15)
    assert strokes[True] < 0.001


@given(
    unit=st.floats(-1.0, 1.0),
    ends=st.tuples(st.integers(800, 1400), st.integers(1401, 1600), st.integers(1601, 2200)),
    reverse=st.booleans(),
)
def test_a_pulse_stands_for_its_unit_to_half_a_microsecond(
    unit: float, ends: tuple[int, int, int], reverse: bool
) -> None:
    servo = Servo(*ends, reverse=reverse)
    smaller_side = min(ends[1] - ends[0], ends[2] - ends[1])

    assert ends[0] <= servo.pulse(unit) <= ends[2]
    assert abs(servo.unit(servo.pulse(unit)) - unit) <= 0.5 / smaller_side + 1e-12
    assert servo.pulse(5.0) == (ends[0] if reverse else ends[2])


def test_the_command_writes_a_tlog_and_its_truth(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    log, truth = tmp_path / "log.tlog", tmp_path / "log.truth.json"

    asked = ["--aircraft", "T37", "--speed-kt", "200"]
    code = fly_jsbsim.main([*asked, "--seconds", "12", "--out", str(log)])

    frames = list(fly(replace(SHORT, aircraft="T37", speed_kt=200.0), Link()))
    assert code == 0
    assert log.read_bytes() == join(frames)
    found = json.loads(truth.read_text(encoding="utf-8"))
    assert found["command"].startswith("python tools/fly_jsbsim.py --aircraft T37 --speed-kt 200")
    assert found["airspeed_m_s"] < KNOT * found["speed_kt"] == KNOT * 200.0
    at_trim = jsbsim_truth.linear_dutch_rolls(replace(SHORT, aircraft="T37", speed_kt=200.0))
    assert found["dutch_roll"]["wn_rad_s"] < at_trim["dutch_roll"]["wn_rad_s"]
    assert 0.0 < found["dutch_roll"]["wn_std"] < 0.01 * found["dutch_roll"]["wn_rad_s"]
    assert capfd.readouterr() == ("", f"fly_jsbsim: {len(frames)} frames\n")


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ("--speed-kt nan", "speed_kt"), ("--seconds 0", "seconds"), ("--manoeuvre loop", "loop"),
        ("--attitude-hz 201", "attitude_hz"), ("--rate-noise -1", "rate_noise"),
    ],
)  # fmt: skip
def test_a_setting_outside_its_limits_is_refused_in_one_line_that_names_it(
    asked: str, named: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert fly_jsbsim.main([*asked.split(), "--out", str(tmp_path / "log.tlog")]) == 2

    [line] = capfd.readouterr().err.splitlines()
    assert named in line
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("aircraft", "speed_kt", "altitude_ft"), [("c172p", 100.0, 3000.0), ("T37", 200.0, 10000.0)]
)
def test_the_linearised_dutch_roll_is_what_decays_after_a_rudder_pulse(
    aircraft: str, speed_kt: float, altitude_ft: float
) -> None:
    plan = FlightPlan(aircraft=aircraft, speed_kt=speed_kt, altitude_ft=altitude_ft)

    lines = jsbsim_truth.truth_lines(plan, np.array([[10.0, speed_kt, altitude_ft]]))
    found = jsbsim_truth.modes_at(lines, np.array([speed_kt]))

    linear, seen = found["dutch_roll"], jsbsim_truth.pulse_dutch_roll(plan)
    assert seen["wn_rad_s"] == pytest.approx(linear["wn_rad_s"], rel=0.005)
    assert seen["zeta"] == pytest.approx(linear["zeta"], abs=0.005)
    assert abs(seen["zeta"] - found["dutch_roll_open_loop"]["zeta"]) > 0.03
    assert linear["wn_std"] == pytest.approx(abs(seen["wn_rad_s"] - linear["wn_rad_s"]))
    at_trim = jsbsim_truth.linear_dutch_rolls(plan)
    assert at_trim["dutch_roll"]["wn_rad_s"] == linear["wn_rad_s"]


def test_the_sigma_of_a_truth_has_the_airspeeds_flown_and_the_pulse_in_it() -> None:
    plan = FlightPlan(aircraft="T37", speed_kt=200.0, altitude_ft=5000.0)
    wavy = np.array([[10.0 + i, 190.0 + 4.0 * (-1) ** i, 5000.0] for i in range(20)])

    lines = jsbsim_truth.truth_lines(plan, wavy)

    line, found = (of["dutch_roll"] for of in (lines, jsbsim_truth.modes_at(lines, wavy[:, 1])))
    ends = [jsbsim_truth.linear_dutch_rolls(replace(plan, speed_kt=v)) for v in (186.0, 194.0)]
    slow, fast = (end["dutch_roll"]["wn_rad_s"] for end in ends)
    assert slow < found["wn_rad_s"] < fast
    spread = 0.5 * (fast - slow)
    assert found["wn_std"] == pytest.approx(np.hypot(spread, line["pulse"][0]), rel=0.01)
    at_194, _ = jsbsim_truth.at_airspeeds(line, np.array([194.0]))
    assert at_194[0] == pytest.approx(fast, rel=1e-3)
