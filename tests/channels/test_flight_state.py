"""When samples are held: on the ground, in hover, by lift motors, at steep angles."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flightlog import beat, every, fly, hud, reasons_of, samples_of, summary_of, told
from printed import printed
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held
from yawid.channels.flight_state import SlowFlight, TakeOff
from yawid.cli.main import main
from yawid.quantities.vehicles import ARDUPILOT, ARDUPLANE_HOVER, PX4

NAN = float("nan")
FORWARD, HALFWAY_S, SECONDS = 5, 10.0, 20.0
PLANE, COPTER, TILT_ROTOR = 1, 2, 21
IDLE, DRIVEN, SLOW = 1000, 1600, 1040
QUAD = {f"SERVO{n}_FUNCTION": 28.0 + n for n in range(5, 9)}
RUDDER = {"SERVO4_FUNCTION": 21.0}
PX4S = {"CA_SV_CS0_TYPE": 4.0, "PWM_MAIN_FUNC4": 201.0}


def plane(mode: int, kind: int = PLANE, autopilot: int = ARDUPILOT) -> mavlink.MAVLink_message:
    return beat(kind, autopilot, 209, mode)


def state(vtol: int, landed: int = 0) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_extended_sys_state_message(vtol, landed)


def steep(t: float) -> mavlink.MAVLink_message:
    pitch = math.radians(70.0) if t > HALFWAY_S else 0.2
    return mavlink.MAVLink_attitude_message(round(1000 * (10 + t)), 0, pitch, 0, 0, 0, 0.1)


def flown(
    parameters: dict[str, float] = RUDDER,
    first: Any = None,
    then: Any = None,
    motors: tuple[int, int] = (IDLE, IDLE),
    bank_deg: float = 0.0,
    more: Any = (),
    **options: Any,
) -> bytes:
    """Return a log in which something changes halfway: what is sent, motors, or the bank."""
    told_first = [(0.0, told(name, value)) for name, value in parameters.items()]
    events = [(0.0, first)] * (first is not None) + [(HALFWAY_S, then)] * (then is not None)
    return fly(
        lambda t: 0.1 * np.sin(t),
        lambda t: [1500, 1500, 1500, 1500 + round(25 * t) % 50, *[motors[t >= HALFWAY_S]] * 4],
        SECONDS,
        roll=lambda t: math.radians(bank_deg) * (t >= HALFWAY_S),
        more=[*told_first, *events, *more],
        **({"attitude_s": 0.04, "servo_s": 0.04, "vehicle": plane(FORWARD)} | options),
    ).data


def halves(data: bytes) -> list[set[int]]:
    """Return why samples are held well before and well after the change."""
    found = samples_of(data)
    t = found.boot_us / 1e6 - 10.0
    return [set(found.held[rows].tolist()) for rows in (t < 9.0, t > 11.0)]


def vtol(reported: int) -> list[dict[str, Any]]:
    return [
        {"parameters": parameters, "first": state(4), "then": state(reported), "vehicle": of}
        for parameters, of in ((PX4S, plane(0, TILT_ROTOR, PX4)), (RUDDER, plane(0)))
    ]


MINIMUM = {"Q_M_PWM_MIN": 1100.0, "Q_M_PWM_MAX": 1900.0}
LIFTING = [({}, DRIVEN), (MINIMUM, 1150), ({"Q_TILT_MASK": 3.0}, DRIVEN)]
IDLING = [
    ({}, SLOW),  # a few per cent: armed and idle
    (MINIMUM, 1130),
    ({"Q_THR_MIN_PWM": 1200.0}, 1220),
    ({"Q_TILT_MASK": 15.0}, DRIVEN),
    ({"Q_TAILSIT_MOTMX": 15.0}, DRIVEN),
    ({}, 65535),
]


def driven(more: dict[str, float], us: int) -> dict[str, Any]:
    return {"parameters": RUDDER | QUAD | more, "motors": (IDLE, us)}


CASES: dict[str, tuple[list[dict[str, Any]], Held]] = {
    "each hover mode": ([{"then": plane(mode)} for mode in ARDUPLANE_HOVER], Held.HOVER),
    "a multirotor's mode": (
        [{"then": plane(17, COPTER), "vehicle": plane(FORWARD, COPTER)}],
        Held.NONE,
    ),
    "a VTOL that does not fly on wings": ([*vtol(1), *vtol(2), *vtol(3)], Held.HOVER),
    "a VTOL on its wings": (vtol(4), Held.NONE),
    "lift motors driven": ([driven(*each) for each in LIFTING], Held.LIFT_MOTORS),
    "motors idle, off, or that also pull": ([driven(*each) for each in IDLING], Held.NONE),
    "motors that nothing names": ([{"motors": (IDLE, DRIVEN)}], Held.NONE),
    "a steep bank": ([{"bank_deg": 61.0}, {"bank_deg": -61.0}], Held.STEEP),
    "a bank": ([{"bank_deg": 59.0}], Held.NONE),
    "a steep climb": (
        [{"attitude_s": 99.0, "more": every(0.04, SECONDS, steep)}],
        Held.STEEP,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_samples_are_held_while_it_does_not_fly_as_the_model_has_it(name: str):
    logs, held = CASES[name]
    for log in logs:
        assert halves(flown(**log)) == [{0}, {held.value}]


def test_a_px4_vtol_that_does_not_say_how_it_flies_is_held():
    data = flown(PX4S, then=state(4), vehicle=plane(0, TILT_ROTOR, PX4))
    assert halves(data) == [{Held.HOVER}, {0}]


def test_the_hover_modes_are_those_whose_names_begin_with_q():
    names = mavutil.mode_mapping_bynumber(PLANE)
    assert {*ARDUPLANE_HOVER} == {n for n, name in names.items() if name.startswith("Q")}


def test_where_every_sample_is_held_the_verdict_says_why():
    all_held, half = (
        {each["id"]: each["text"] for each in reasons_of(summary_of(data))}
        for data in (
            flown(RUDDER | QUAD, plane(19), plane(18), motors=(DRIVEN, DRIVEN)),
            flown(then=plane(19)),
        )
    )
    assert all_held["not_excited"] == "every sample is held: hover, lift motors"
    assert "every sample" not in half.get("not_excited", "")


UNDEFINED, LANDED, IN_AIR, TAKING_OFF = range(4)


@pytest.mark.parametrize(
    ("autopilot", "base_mode", "air", "over_ground", "landed", "on_ground"),
    [
        (ARDUPILOT, 128, 20.0, 20.0, None, False),
        (ARDUPILOT, 128, 1.0, 1.0, None, True),
        (ARDUPILOT, 0, 63.0, 0.0, None, True),  # VFR_HUD at boot
        (ARDUPILOT, 128, 18.0, 2.0, None, False),  # into the wind
        (ARDUPILOT, 128, 1.0, 20.0, None, False),  # a blocked pitot tube
        (PX4, 0, NAN, NAN, None, False),  # unknown
        (PX4, 0, NAN, 0.0, None, False),  # into the wind, or parked
        (PX4, 0, 0.0, NAN, None, False),
        (PX4, 0, 0.0, NAN, LANDED, True),
        (PX4, 0, 0.0, NAN, IN_AIR, False),
        (PX4, 0, 0.0, NAN, TAKING_OFF, False),
        (PX4, 0, 0.0, NAN, UNDEFINED, False),
        (PX4, 0, 20.0, 20.0, LANDED, False),  # a disarmed autopilot that is carried
        (PX4, 0, 63.0, 0.0, LANDED, True),
        (PX4, 0, 0.0, 0.0, IN_AIR, True),  # as before it was asked
    ],
)
def test_on_the_ground_by_both_speeds_arming_and_what_the_autopilot_says(
    autopilot, base_mode, air, over_ground, landed, on_ground
):
    first = [] if landed is None else [(0.0, state(0, landed))]
    more = [(0.0, hud(air, over_ground, 432.5)), (0.0, beat(1, autopilot, base_mode)), *first]
    outputs = {ARDUPILOT: RUDDER, PX4: PX4S}[autopilot]
    found = samples_of(flown(outputs, more=more, vehicle=beat(1, autopilot, base_mode)))

    assert set(found.held) == {int(Held.ON_GROUND) if on_ground else 0}
    assert set(found.altitude) == {432.5}
    assert not (found.noted.any() and on_ground)


CLIMB = np.concatenate([np.full(20, 300.0), np.linspace(300.0, 340.0, 41), np.full(20, 340.0)])
GROUND = np.repeat([1.0, 0.0], [10, 40])
LEVEL, ALTITUDE = np.full(50, 0.02), np.full(50, 50.0)


def slow_flight(altitude: np.ndarray, speed: float) -> np.ndarray:
    speeds = np.full(len(altitude), speed)
    return SlowFlight().shows(altitude, speeds, np.full(len(altitude), np.nan))


def test_a_slow_aircraft_flies_from_15_m_above_its_lowest_place_on():
    np.testing.assert_array_equal(slow_flight(CLIMB, 3.0), CLIMB >= 315.0)
    for speed in (0.5, 12.0):  # what stands, and what is fast
        assert not slow_flight(CLIMB, speed).any()
    after_a_fast_flight = SlowFlight()
    after_a_fast_flight.shows(CLIMB[:1], np.array([12.0]), np.array([12.0]))
    assert not after_a_fast_flight.shows(CLIMB, np.full(81, 3.0), np.full(81, 3.0)).any()
    leap = np.concatenate([np.zeros(9), np.full(30, 690.0)])
    assert not slow_flight(leap, 3.0).any()


def test_a_take_off_roll_ends_with_5_degrees_or_5_m():
    climbs = ALTITUDE + np.maximum(np.arange(50) - 29, 0)  # 5 m at row 34
    banks = np.where(np.arange(50) == 40, LEVEL + np.radians(5.1), LEVEL)  # and level again
    unknown = np.full(50, np.nan)

    for ground, roll, altitude, rolls in (
        (GROUND, LEVEL, climbs, np.arange(50) < 34),
        (GROUND, banks, ALTITUDE, np.arange(50) < 40),
        (GROUND * 0.0, LEVEL, ALTITUDE, np.zeros(50)),
        (GROUND, unknown, ALTITUDE, GROUND),
        (GROUND, LEVEL, unknown, GROUND),
        (unknown, LEVEL, ALTITUDE, unknown),
    ):
        np.testing.assert_array_equal(TakeOff().rolls(ground, roll, altitude), rolls)


def test_the_samples_of_a_roll_are_held_until_it_has_climbed():
    def at(t: float) -> mavlink.MAVLink_message:
        speed, climb = min(max(4.0 * (t - 2.0), 0.0), 30.0), max(4.0 * (t - 12.0), 0.0)
        return hud(speed, speed, 100.0 + climb)

    found = samples_of(flown(more=every(0.2, SECONDS, at)))
    grounded = found.held & Held.ON_GROUND.value != 0
    assert grounded[(found.boot_us > 11e6) & (found.boot_us < 23e6)].all()
    assert not grounded[found.boot_us > 24e6].any()


def slow_record(folder: Path, altitude: str) -> Path:
    """Write a flight at 3 m/s whose rudder moves by 80 % of half its travel."""
    t = np.arange(0.0, 60.0, 0.05)
    rudder = 0.4 * np.sign(np.sin(1.1 * t)) * (t > 20)
    kernel = np.exp(-0.5 * t[:200]) * np.sin(2.0 * t[:200])
    rate = 0.05 * np.convolve(rudder, kernel)[: len(t)]
    height = 100.0 + 2.0 * np.minimum(t, 15.0)
    columns = [t, rudder, rate, np.full(len(t), 3.0), *([height] if altitude else [])]
    header, path = f"t,rudder [half-travel],r [rad/s],airspeed [m/s]{altitude}", folder / "a.csv"
    np.savetxt(path, np.column_stack(columns), "%.6f", ",", header=header, comments="")
    return path


@pytest.mark.parametrize(
    ("altitude", "options", "taken"),
    [("", [], False), ("", ["--airborne", "all"], True), (",altitude [m]", [], True)],
)
def test_a_slow_record_is_held_as_on_the_ground_unless_it_climbs_or_is_said_to_fly(
    altitude: str, options: list[str], taken: bool, tmp_path: Path, capsys
):
    log = str(slow_record(tmp_path, altitude))
    main(["replay", log, "--json", "--out", str(tmp_path), "--manoeuvres", "off", *options])
    reasons = {
        each["id"]: each["text"] for each in reasons_of(printed("replay", capsys.readouterr().out))
    }

    assert ("not_excited" not in reasons) == taken
    for text in ("every sample is held: on ground", "--airborne all"):
        assert taken or text in reasons["not_excited"]
