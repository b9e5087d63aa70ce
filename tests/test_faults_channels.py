"""Faults of senders and channels in a good log, and what must come of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fault_injection import (
    MIDDLE_S,
    NEAR,
    SAME,
    Fault,
    Summary,
    assert_refused,
    assert_right_or_refused,
    changed,
    clean,
    dutch_roll,
    good,
    of_els,
    with_others,
)
from flights.surgery import Encoder, Record, after, join, message_id, sender
from pymavlink.dialects.v20 import ardupilotmega as mavlink


def beat(kind: int, autopilot: int = 8) -> Any:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)


STRANGERS = [
    *[(50, beat(kind), ids) for kind, ids in
      ((6, (255, 190)), (6, (1, 190)), (27, (1, 0)), (18, (51, 68)), (26, (1, 154)))],
    (30, mavlink.MAVLink_radio_status_message(90, 91, 92, 40, 41, 3, 4), (51, 68)),
    (3, mavlink.MAVLink_attitude_message(90_000, 0, 0, 0, 0, 0, 3.0), (1, 154)),
]  # fmt: skip
SECOND = [
    (50, beat(1, 3), (7, 1)),
    (5, mavlink.MAVLink_attitude_message(90_000, 0, 0, 0, 0, 0, 3.0), (7, 1)),
]


def behind_the_first() -> bytes:
    head = join(good()[:60])
    return head + with_others(SECOND)[len(head) :]


def is_of_the_vehicle(found: Summary) -> Any:
    ids = found["vehicle"]["sysid"], found["vehicle"]["compid"], found["link"]["lost"]
    return ids, (1, 1, 0)


def zero_servos(message: Any) -> None:
    if message.get_type() == "SERVO_OUTPUT_RAW":
        for n in range(1, 9):
            setattr(message, f"servo{n}_raw", 0)


def others_zero(message: Any) -> None:
    rudder = getattr(message, "servo4_raw", 0)
    zero_servos(message)
    if message.get_type() == "SERVO_OUTPUT_RAW":
        message.servo4_raw = rudder


def zero_between(low_s: float, high_s: float) -> Fault:
    """Every servo is 0 from one time of the vehicle to another: those samples are held."""
    now_s = [0.0]

    def silent(message: Any) -> None:
        if message.get_type() == "ATTITUDE":
            now_s[0] = message.time_boot_ms / 1000
        if low_s <= now_s[0] < high_s:
            zero_servos(message)

    lasts_s = high_s - max(low_s, 30.0)
    return Fault(lambda: changed(silent), NEAR, held_more(10 * lasts_s - 7, 10 * lasts_s + 7))


def held_more(low: float, high: float = np.inf) -> Callable[[Summary], Any]:
    return of_els("held", lambda found, before: low <= found - before <= high)


def repeat(message: Any) -> None:
    if message.get_type() == "VFR_HUD":
        message.airspeed = message.groundspeed


def spiked() -> bytes:
    count = [0]

    def spike(message: Any) -> None:
        if message.get_type() == "ATTITUDE":
            count[0] += 1
            if count[0] % 101 == 0:
                message.yawspeed = [1e30, -1e6, np.inf, np.nan][count[0] // 101 % 4]

    return changed(spike)


def silent_in_turns() -> bytes:
    first = good()[0][0]
    return join(
        r
        for r in good()
        if not (message_id(r[1]) == 30 and 40e6 < r[0] - first < 43e6)
        and not (message_id(r[1]) == 36 and 60e6 < r[0] - first < 72e6)
    )


def on_the_ground(airspeed: float, *, armed: bool) -> list[Record]:
    """Return 25 s before take-off: the rudder is tried, the aircraft stands still."""
    encoder, records = Encoder(), []
    for i in range(1250):
        ms, stamp = 4000 + 20 * i, good()[0][0] - 26_000_000 + 20_000 * i
        pulse = 1500 + (200 if (i // 40) % 2 else -200)
        servos = 1500, 1500, 1000, pulse, *[0] * 4
        messages: list[Any] = [
            mavlink.MAVLink_attitude_message(ms, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
            mavlink.MAVLink_servo_output_raw_message(1000 * ms, 0, *servos),
        ]
        if i % 50 == 0:
            mode = 128 if armed else 0
            messages.insert(0, mavlink.MAVLink_heartbeat_message(1, 3, mode, 0, 4, 3))
            messages.append(mavlink.MAVLink_vfr_hud_message(airspeed, 0.1, 0, 0, 0.0, 0.0))
        records += [(stamp, encoder.frame(message)) for message in messages]
    return records


def tried(airspeed: float, *, armed: bool) -> Fault:
    log = lambda: join([*on_the_ground(airspeed, armed=armed), *good()])  # noqa: E731
    return Fault(log, NEAR, held_more(201))


FAULTS = {
    "HEARTBEATs of GCS, radio, ADS-B and gimbal": Fault(
        lambda: with_others(STRANGERS), SAME, is_of_the_vehicle
    ),
    "a second aircraft": Fault(behind_the_first, SAME, is_of_the_vehicle),
    "all channels 0 but the rudder": Fault(lambda: changed(others_zero), SAME),
    "airspeed equal to the ground speed": Fault(lambda: changed(repeat), SAME),
    "servos 0 for 1.7 s after the boot": zero_between(0.0, 31.7),
    "servos 0 for 20 s after the boot": zero_between(0.0, 50.0),
    "servos 0 for 5 s in flight": zero_between(90.0, 95.0),
    "the rudder tried, VFR_HUD of 63 m/s, disarmed": tried(63.0, armed=False),
    "the rudder tried, VFR_HUD of 0 m/s, armed": tried(0.0, armed=True),
    "the rudder tried, VFR_HUD of 0 m/s, disarmed": tried(0.0, armed=False),
    "yaw rates of 1e30, inf, NaN": Fault(spiked, NEAR, held_more(1)),
    "ATTITUDE, then servo messages silent": Fault(
        silent_in_turns,
        NEAR,
        lambda found: (found["link"]["gaps"] >= 2, True),
        of_els("updates", lambda found, before: found < before - 100),
    ),
    # The clock began again, so there is no gap; sigma is below that of one flight.
    "two flights of the day": Fault(
        lambda: join(after(good(), good(), 600.0)),
        NEAR,
        lambda found: (found["link"]["reboots"], 1),
        lambda found: (dutch_roll(found, "els")[2] < dutch_roll(clean(), "els")[2], True),
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_senders_or_channels(name: str):
    FAULTS[name].check()


def only(which: Callable[[bytes], bool]) -> bytes:
    return join(r for r in good() if which(r[1]))


@pytest.mark.parametrize(
    ("log", "reason", "settings"),
    [
        (lambda: changed(zero_servos), "not_excited", {}),
        (lambda: with_others(SECOND), "no_rudder", {"sysid": 7}),
        (lambda: only(lambda frame: message_id(frame) != 36), "no_rudder", {}),
        (lambda: only(lambda frame: message_id(frame) not in (30, 74)), "no_yaw", {}),
        (lambda: only(lambda f: message_id(f) != 0 or sender(f) != (1, 1)), "no_vehicle", {}),
    ],
)
def test_a_log_without_what_is_needed_is_refused(
    log: Callable[[], bytes], reason: str, settings: dict[str, Any]
):
    found = assert_refused(log(), reason, **settings)
    assert found.get("estimates", {}).get("els", {}).get("updates", 0) == 0


def frozen() -> bytes:
    """The yaw sensor freezes halfway."""
    seen: list[float] = []

    def freeze(message: Any) -> None:
        if message.get_type() == "ATTITUDE":
            seen.append(message.yawspeed)
            message.yawspeed = seen[0]

    return changed(freeze, start_s=MIDDLE_S)


def test_a_sensor_that_freezes_and_a_log_cut_short_are_refused_or_right():
    assert_right_or_refused(frozen())
    for share in (0.1, 0.2, 0.3, 0.5):
        assert_right_or_refused(join(good()[: int(share * len(good()))]))
