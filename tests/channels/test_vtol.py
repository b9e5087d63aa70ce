"""What is held because the aircraft does not fly as the model has it: hover, lift, steep angles."""

from __future__ import annotations

import numpy as np
import pytest
from flightlog import FlightLog, Samples, reasons_of, samples_of, summary_of
from places import SHARED_FLIGHTS as FLIGHTS
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held
from yawid.channels.stage import Channels
from yawid.config.run import RunConfig
from yawid.quantities.vehicles import ARDUPLANE_HOVER
from yawid.runs.job import open_log

FORWARD, HALFWAY_S, SECONDS = 5, 20.0, 40.0
ARDUPILOT, PX4, PLANE, TILT_ROTOR = 3, 12, 1, 21
IDLE, DRIVEN, SLOW = 1000, 1600, 1040
QUAD = {f"SERVO{n}_FUNCTION": 28 + n for n in range(5, 9)}


def flown(
    before: list[mavlink.MAVLink_message],
    after: list[mavlink.MAVLink_message],
    *,
    parameters: dict[str, float] | None = None,
    motors: tuple[int, int] = (IDLE, IDLE),
    banks: tuple[float, float] = (0.0, 0.0),
    kind: int = PLANE,
    autopilot: int = ARDUPILOT,
    mode: int = FORWARD,
) -> bytes:
    """Return a log in which something changes halfway: what is sent, motors, or the bank."""
    log = FlightLog()
    log.add(9.0, mavlink.MAVLink_heartbeat_message(kind, autopilot, 209, mode, 4, 3))
    for name, value in ({"SERVO4_FUNCTION": 21} | (parameters or {})).items():
        log.parameter(9.1, name, value)
    for message in before:
        log.add(9.2, message)
    for i in range(round(25 * SECONDS)):
        t = 10.0 + 0.04 * i
        half = int(0.04 * i >= HALFWAY_S)
        if 0.04 * i == HALFWAY_S:
            for message in after:
                log.add(t, message)
        log.attitude(t, 0.1 * np.sin(t), roll=banks[half])
        log.servos(t + 0.01, [1500, 1500, 1500, 1500 + i % 50, *[motors[half]] * 4])
    return log.data


def halves(data: bytes, cuts: tuple[int, ...] = ()) -> tuple[set[int], set[int]]:
    """Return why samples are held well before and well after the change."""
    found = samples_of(data, RunConfig(), cuts)
    t = found.boot_us / 1e6 - 10.0
    return tuple(set(found.held[rows].tolist()) for rows in (t < 19.0, t > 21.0))


def beat(mode: int, kind: int = PLANE, autopilot: int = ARDUPILOT) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 209, mode, 4, 3)


def state(vtol: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_extended_sys_state_message(vtol, 0)


def test_the_hover_modes_are_those_whose_names_begin_with_q():
    names = mavutil.mode_mapping_bynumber(PLANE)
    hover = {number for number, name in names.items() if name.startswith("Q")}
    assert set(ARDUPLANE_HOVER) == hover


@pytest.mark.parametrize("mode", ARDUPLANE_HOVER)
def test_samples_of_a_hover_mode_are_held(mode: int):
    assert halves(flown([], [beat(mode)])) == ({0}, {Held.HOVER})


def test_a_multirotors_mode_of_the_same_number_is_no_hover_of_a_plane():
    data = flown([], [beat(17, kind=2)], kind=2)
    assert halves(data) == ({0}, {0})


@pytest.mark.parametrize(("told", "held"), [(1, True), (2, True), (3, True), (4, False)])
@pytest.mark.parametrize(("autopilot", "kind"), [(PX4, TILT_ROTOR), (ARDUPILOT, PLANE)])
def test_a_vtol_that_says_it_does_not_fly_on_wings_is_held(autopilot, kind, told, held):
    parameters = {"CA_SV_CS0_TYPE": 4, "PWM_MAIN_FUNC4": 201}
    data = flown(
        [state(4)], [state(told)], parameters=parameters, kind=kind, autopilot=autopilot, mode=0
    )
    assert halves(data) == ({0}, {Held.HOVER if held else 0})


def test_a_px4_vtol_that_does_not_say_how_it_flies_is_held():
    parameters = {"CA_SV_CS0_TYPE": 4, "PWM_MAIN_FUNC4": 201}
    data = flown([], [state(4)], parameters=parameters, kind=TILT_ROTOR, autopilot=PX4, mode=0)
    assert halves(data) == ({Held.HOVER}, {0})


def test_where_every_sample_is_held_the_verdict_says_why():
    data = flown([beat(19)], [beat(18)], parameters=QUAD, motors=(DRIVEN, DRIVEN))
    reasons = {r["id"]: r["text"] for r in reasons_of(summary_of(data))}

    assert reasons["not_excited"] == "every sample is held: hover, lift motors"
    half = {r["id"]: r["text"] for r in reasons_of(summary_of(flown([], [beat(19)])))}
    assert "every sample" not in half.get("not_excited", "")


@pytest.mark.parametrize(
    ("parameters", "motors", "held"),
    [
        (QUAD, DRIVEN, True),
        (QUAD, SLOW, False),  # a few per cent: armed and idle
        (QUAD | {"Q_M_PWM_MIN": 1100, "Q_M_PWM_MAX": 1900}, 1130, False),
        (QUAD | {"Q_M_PWM_MIN": 1100, "Q_M_PWM_MAX": 1900}, 1150, True),
        (QUAD | {"Q_THR_MIN_PWM": 1200}, 1220, False),
        (QUAD | {"Q_TILT_MASK": 0b1111}, DRIVEN, False),  # they pull in forward flight
        (QUAD | {"Q_TILT_MASK": 0b0011}, DRIVEN, True),
        (QUAD | {"Q_TAILSIT_MOTMX": 0b1111}, DRIVEN, False),
        ({}, DRIVEN, False),
        (QUAD, 65535, False),
    ],
)
def test_samples_are_held_while_lift_motors_are_driven(parameters, motors, held):
    data = flown([], [], parameters=parameters, motors=(IDLE, motors))
    assert halves(data) == ({0}, {Held.LIFT_MOTORS if held else 0})


@pytest.mark.parametrize(("bank_deg", "held"), [(59.0, False), (61.0, True), (-61.0, True)])
def test_samples_of_a_steep_bank_are_held(bank_deg: float, held: bool):
    data = flown([], [], banks=(0.0, np.deg2rad(bank_deg)))
    assert halves(data) == ({0}, {Held.STEEP if held else 0})


def test_samples_of_a_steep_climb_are_held():
    log = FlightLog()
    log.heartbeat(9.0)
    for i in range(1000):
        t = 10.0 + 0.04 * i
        pitch = np.deg2rad(70.0) if i > 500 else 0.2
        log.add(t, mavlink.MAVLink_attitude_message(round(1000 * t), 0, pitch, 0, 0, 0, 0.1))
        log.servos(t + 0.01, [1500, 1500, 1500, 1500 + i % 50])
    assert halves(log.data) == ({0}, {Held.STEEP})


def test_what_is_held_does_not_depend_on_the_cut():
    telling = [
        mavlink.MAVLink_param_value_message(f"SERVO{n}_FUNCTION".encode(), 28 + n, 9, 1, 0)
        for n in range(5, 9)
    ]
    data = flown([], [*telling, beat(19)], motors=(DRIVEN, DRIVEN))
    whole = samples_of(data)
    cut = samples_of(data, cuts=range(0, len(data), 1511))

    assert {0, Held.HOVER | Held.LIFT_MOTORS} <= set(whole.held)
    np.testing.assert_array_equal(cut.held, whole.held)
    np.testing.assert_array_equal(cut.u, whole.u)


@pytest.mark.skipif(not FLIGHTS.is_dir(), reason="the recorded flights are not here")
def test_a_real_tilt_rotor_is_learned_from_on_its_wings_alone():
    channels = Channels(RunConfig(rudder="servo:1"))
    blocks = []
    for _, frames in open_log(FLIGHTS / "vtol_quadplane.tlog").read():
        blocks += [] if frames is None else channels.feed_frames(frames)
    found = Samples(channels, blocks + channels.finish())
    hovering = np.isin(found.mode, ARDUPLANE_HOVER)

    assert hovering.any()
    assert (found.held[hovering & (found.held < Held.HOVER)] != 0).all()
    # Motors 1 and 2 tilt and pull in forward flight; the others start before a hover mode does.
    assert (found.held[~hovering] & Held.LIFT_MOTORS).any()
    assert (found.held[~hovering] == 0).sum() > 100
