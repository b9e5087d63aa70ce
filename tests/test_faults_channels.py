"""Faults of senders and channels in a good log, and what must come of each.

Each docstring tells the result expected, field by field; ``same`` and ``near`` see fault_injection.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fault_injection import (
    MIDDLE_S,
    assert_near,
    assert_refused,
    assert_right_or_refused,
    assert_same,
    changed,
    clean,
    dutch_roll,
    good,
    with_others,
)
from flights.surgery import Encoder, Record, after, join, message_id, sender
from pymavlink.dialects.v20 import ardupilotmega as mavlink


def test_other_senders_with_heartbeats_of_their_own():
    """theta, reasons: same; vehicle: 1/1; link.lost: 0. GCS, radio, ADS-B, gimbal."""

    def beat(kind: int, autopilot: int = 8) -> Any:
        return mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)

    others = [
        (50, beat(6), (255, 190)),
        (50, beat(6), (1, 190)),
        (50, beat(27), (1, 0)),
        (50, beat(18), (51, 68)),
        (50, beat(26), (1, 154)),
        (30, mavlink.MAVLink_radio_status_message(90, 91, 92, 40, 41, 3, 4), (51, 68)),
        (3, mavlink.MAVLink_attitude_message(90_000, 0, 0, 0, 0, 0, 3.0), (1, 154)),
    ]
    found = assert_same(with_others(others))

    assert (found["vehicle"]["sysid"], found["vehicle"]["compid"]) == (1, 1)
    assert found["link"]["lost"] == 0


def test_a_second_aircraft_on_the_link():
    """theta, reasons: same for the first; with --sysid 7 the second has no rudder to learn from."""
    second = [
        (50, mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3), (7, 1)),
        (5, mavlink.MAVLink_attitude_message(90_000, 0, 0, 0, 0, 0, 3.0), (7, 1)),
    ]
    log = with_others(second)

    assert assert_same(join(good()[:60]) + log[len(join(good()[:60])) :])["vehicle"]["sysid"] == 1
    assert_refused(log, "no_rudder", sysid=7)


def zero_servos(message: Any) -> None:
    if message.get_type() == "SERVO_OUTPUT_RAW":
        for n in range(1, 9):
            setattr(message, f"servo{n}_raw", 0)


def test_a_rudder_channel_that_is_always_zero():
    """verdict: not usable, not_excited; updates: 0."""
    found = assert_refused(changed(zero_servos), "not_excited")

    assert found.get("estimates", {}).get("els", {}).get("updates", 0) == 0


def test_channels_that_are_all_zero_beside_the_rudder():
    """theta, reasons: same."""

    def others(message: Any) -> None:
        rudder = getattr(message, "servo4_raw", 0)
        zero_servos(message)
        if message.get_type() == "SERVO_OUTPUT_RAW":
            message.servo4_raw = rudder

    assert_same(changed(others))


@pytest.mark.parametrize("seconds", [1.7, 20.0])
def test_the_first_seconds_of_a_boot_with_every_servo_at_zero(seconds: float):
    """theta: near; held: those samples, for want of a rudder; none of them is an update."""
    until_ms = round(1000 * (30.0 + seconds))
    boot_ms = [0]

    def silent(message: Any) -> None:
        boot_ms[0] = getattr(message, "time_boot_ms", boot_ms[0])
        if boot_ms[0] < until_ms:
            zero_servos(message)

    found = assert_near(changed(silent))

    held = [found["estimates"]["els"]["held"], clean()["estimates"]["els"]["held"]]
    assert held[0] - held[1] == pytest.approx(10 * seconds, abs=7)


def test_a_rudder_that_is_zero_for_a_while_in_flight():
    """theta: near; held: those samples."""

    def off(message: Any) -> None:
        if 90e6 < getattr(message, "time_usec", 0) < 95e6:
            zero_servos(message)

    found = assert_near(changed(off))

    held = [found["estimates"]["els"]["held"], clean()["estimates"]["els"]["held"]]
    assert held[0] - held[1] >= 50


def test_airspeed_that_only_repeats_the_ground_speed():
    """theta, reasons: same."""

    def repeat(message: Any) -> None:
        if message.get_type() == "VFR_HUD":
            message.airspeed = message.groundspeed

    assert_same(changed(repeat))


def on_the_ground(airspeed: float, *, armed: bool) -> list[Record]:
    """Return 25 s before take-off: the rudder is tried, the aircraft stands still."""
    encoder, records = Encoder(), []
    for i in range(1250):
        ms, stamp = 4000 + 20 * i, good()[0][0] - 26_000_000 + 20_000 * i
        pulse = 1500 + (200 if (i // 40) % 2 else -200)
        messages: list[Any] = [
            mavlink.MAVLink_attitude_message(ms, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
            mavlink.MAVLink_servo_output_raw_message(
                1000 * ms, 0, 1500, 1500, 1000, pulse, *[0] * 4
            ),
        ]
        if i % 50 == 0:
            mode = 128 if armed else 0
            messages.insert(0, mavlink.MAVLink_heartbeat_message(1, 3, mode, 0, 4, 3))
            messages.append(mavlink.MAVLink_vfr_hud_message(airspeed, 0.1, 0, 0, 0.0, 0.0))
        records += [(stamp, encoder.frame(message)) for message in messages]
    return records


@pytest.mark.parametrize(("airspeed", "armed"), [(63.0, False), (0.0, True), (0.0, False)])
def test_a_rudder_tried_on_the_ground_teaches_nothing(airspeed: float, armed: bool):
    """theta: near; held: the time on the ground, whatever airspeed VFR_HUD tells there."""
    found = assert_near(join([*on_the_ground(airspeed, armed=armed), *good()]))

    held = [found["estimates"]["els"]["held"], clean()["estimates"]["els"]["held"]]
    assert held[0] - held[1] > 200


def test_yaw_rates_that_no_aircraft_has():
    """theta: near; those samples are held. Spikes, infinity and NaN in ATTITUDE."""
    count = [0]

    def spike(message: Any) -> None:
        if message.get_type() == "ATTITUDE":
            count[0] += 1
            if count[0] % 101 == 0:
                message.yawspeed = [1e30, -1e6, np.inf, np.nan][count[0] // 101 % 4]

    found = assert_near(changed(spike))

    assert found["estimates"]["els"]["held"] > clean()["estimates"]["els"]["held"]


def test_a_yaw_sensor_that_freezes_halfway():
    """verdict: usable and near, or not usable; never usable and wrong."""
    frozen: list[float] = []

    def freeze(message: Any) -> None:
        if message.get_type() == "ATTITUDE":
            frozen.append(message.yawspeed)
            message.yawspeed = frozen[0]

    assert_right_or_refused(changed(freeze, start_s=MIDDLE_S))


def test_yaw_and_rudder_that_fall_silent_in_turns():
    """theta: near; link.gaps: two at least; nothing is filled in."""
    records = [
        r
        for r in good()
        if not (message_id(r[1]) == 30 and 40e6 < r[0] - good()[0][0] < 43e6)
        and not (message_id(r[1]) == 36 and 60e6 < r[0] - good()[0][0] < 72e6)
    ]
    found = assert_near(join(records))

    assert found["link"]["gaps"] >= 2
    assert found["estimates"]["els"]["updates"] < clean()["estimates"]["els"]["updates"] - 100


def test_a_log_cut_short_after_the_first_manoeuvre_is_refused_or_right():
    """verdict: usable and near the clean run by its own sigma, or not usable."""
    for share in (0.1, 0.2, 0.3, 0.5):
        assert_right_or_refused(join(good()[: int(share * len(good()))]))


def test_no_servo_messages_and_no_attitude_at_all():
    """verdict: no_rudder, no_yaw; without HEARTBEAT no_vehicle."""
    for idents, reason in (((36,), "no_rudder"), ((30, 74), "no_yaw")):
        assert_refused(join(r for r in good() if message_id(r[1]) not in idents), reason)
    vehicles = (r for r in good() if message_id(r[1]) != 0 or sender(r[1]) != (1, 1))
    assert_refused(join(vehicles), "no_vehicle")


def test_two_flights_of_the_day_in_one_log():
    """theta: near; link.reboots: 1; link.gaps: 0 (the clock began anew); sigma below the clean."""
    found = assert_near(join(after(good(), good(), 600.0)))

    assert found["link"]["reboots"] == 1
    assert dutch_roll(found, "els")[2] < dutch_roll(clean(), "els")[2]
