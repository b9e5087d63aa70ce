"""How a case of replay_logs/ is made: what the table ``[made]`` of its case.toml says.

    [made]                                              [made]
    fly = ["--manoeuvre 3211 --seed 5"]                 cut = "sitl_fbwa_50hz"
    change = "vtail"                                    boot_s = [76.5, 255.0]

``fly`` has command lines of tools/fly_jsbsim.py. ``change`` names a function of this file, which
gets the records of each flight and returns the log: the same aircraft seems to have another
autopilot or servos, or the link failed. The truth is that of the last flight, unless ``truth`` is
false. With ``ordinary`` (fields of flights/ordinary.py) the rudder is not moved on purpose, with
``aileron`` (a seed) the aileron is moved, too. ``cut`` is a stretch of vehicle time out of a
recorded flight, of which only the messages are kept that yawid reads.
"""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import Any

import fly_jsbsim
import numpy as np
from flights.flight import Hands
from flights.fly import Made, fly
from flights.moved import pulses
from flights.ordinary import Ordinary, fly_ordinary
from flights.plan import FlightPlan, Link, excitation
from flights.surgery import (
    Record,
    after,
    edited,
    join,
    nonsense,
    px4_controls,
    setting,
    split,
    without,
    wrong_crc,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ESSENTIAL = ("HEARTBEAT", "ATTITUDE", "SERVO_OUTPUT_RAW", "VFR_HUD", "PARAM_VALUE", "STATUSTEXT")
KEY = bytes(range(32))
"""The key that signs the frames of the signed case; it is not secret."""


def make(how: dict[str, Any], flights: Path) -> Made:
    """Return the log of a table ``[made]``, and its truth if that is known."""
    if "cut" in how:
        return Made(cut((flights / f"{how['cut']}.tlog").read_bytes(), *how["boot_s"]))
    lines = ([*shlex.split(line), "--out", "log.tlog"] for line in how["fly"])
    asked = [fly_jsbsim.asked(fly_jsbsim.parse(line)) for line in lines]
    if "ordinary" in how:
        return fly_ordinary(Ordinary(*asked[0], **how["ordinary"]))
    if "aileron" in how:
        return with_aileron(*asked[0], how["aileron"])
    made = [fly(*each) for each in asked]
    if "change" not in how:
        return made[0]
    log = globals()[how["change"]](*(split(each.log) for each in made))
    return Made(log, made[-1].truth if how.get("truth", True) else None)


def cut(log: bytes, from_s: float, to_s: float) -> bytes:
    """Return the essential records of a stretch of ATTITUDE's time_boot_ms; no byte changes.

    A record has the time of the last ATTITUDE up to it.
    """
    reader, boot_s, kept = mavlink.MAVLink(None), -1.0, []
    for stamp, frame in split(log):
        message = reader.decode(bytearray(frame))
        if message.get_type() == "ATTITUDE":
            boot_s = message.time_boot_ms / 1000.0
        if from_s <= boot_s < to_s and message.get_type() in ESSENTIAL:
            kept.append((stamp, frame))
    return join(kept)


def with_aileron(plan: FlightPlan, link: Link, seed: int) -> Made:
    """Fly with rudder and aileron both moved on purpose, so that each moves the yaw on its own.

    The aileron is then an input, so that the Dutch roll estimated is that of the bare airframe.
    """
    aileron = pulses(np.random.default_rng(seed), plan.seconds, 0.12, 0.3)
    aileron[:5100] = 0.0
    made = fly(plan, link, Hands(excitation(plan), aileron, nose_held=False))
    assert made.truth is not None
    return Made(made.log, made.truth | {"dutch_roll": made.truth["dutch_roll_open_loop"]})


def named(values: dict[str, float], parameter: Any) -> None:
    """Give a parameter the value that its name has."""
    parameter.param_value = values.get(parameter.param_id, parameter.param_value)


def vtail(records: list[Record]) -> bytes:
    """Make the aircraft a V-tail on servos 2 and 4, whose elevator moves all the time."""
    rng = np.random.default_rng(21)
    elevator_us = 0.0

    def servos(message: Any) -> None:
        nonlocal elevator_us
        # left = (elevator + rudder) / 2, right = (elevator - rudder) / 2: MIXING_GAIN 0.5
        rudder_us = message.servo4_raw - 1500
        elevator_us = 0.9 * elevator_us + rng.normal(0.0, 30.0)
        message.servo2_raw = 1500 + round((elevator_us + rudder_us) / 2)
        message.servo4_raw = 1500 + round((elevator_us - rudder_us) / 2)

    values = {"SERVO2_FUNCTION": 79.0, "SERVO4_FUNCTION": 80.0}
    return join(edited(records, PARAM_VALUE=partial(named, values), SERVO_OUTPUT_RAW=servos))


def no_rudder(records: list[Record]) -> bytes:
    """Make the aircraft a flying wing: its parameters name elevons and no rudder."""
    values = {"SERVO1_FUNCTION": 77.0, "SERVO2_FUNCTION": 78.0, "SERVO4_FUNCTION": 0.0}
    return join(edited(records, PARAM_VALUE=partial(named, values)))


def px4_groups(records: list[Record]) -> bytes:
    """Make the autopilot a PX4 that reports normalised controls, of group 0 and of another."""
    other = mavlink.MAVLink_actuator_control_target_message
    return join(edited(
        px4_controls(records),
        ACTUATOR_CONTROL_TARGET=lambda mine: [mine, other(mine.time_usec, 1, [0.3] * 8)],
    ))  # fmt: skip


PX4_PARAMETERS = (
    ("PWM_MAIN_FUNC1", 201),
    ("PWM_MAIN_FUNC2", 202),
    ("PWM_MAIN_FUNC4", 101),
    ("PWM_MAIN_FUNC5", 203),
    ("PWM_MAIN_MIN5", 1100),
    ("PWM_MAIN_MAX5", 1900),
    ("PWM_MAIN_REV", 0b10000),
    ("CA_SV_CS0_TYPE", 15),
    ("CA_SV_CS1_TYPE", 3),
    ("CA_SV_CS2_TYPE", 4),
)
"""The rudder is the third surface, so it is the third servo (203), which is output 5, reversed."""


def px4_outputs(records: list[Record]) -> bytes:
    """Make the autopilot a PX4 that reports its outputs, with the surface of each as parameters.

    PX4 sends the four bytes of an integer parameter in the place of the float.
    """
    parameters = [
        mavlink.MAVLink_param_value_message(
            name.encode(), float(np.int32(value).view(np.float32)),
            mavlink.MAV_PARAM_TYPE_INT32, len(PX4_PARAMETERS), index,
        )
        for index, (name, value) in enumerate(PX4_PARAMETERS)
    ]  # fmt: skip

    def servos(message: Any) -> None:
        message.servo5_raw, message.servo4_raw = 3000 - message.servo4_raw, 1000

    edits = {
        "HEARTBEAT": setting(autopilot=mavlink.MAV_AUTOPILOT_PX4),
        "PARAM_VALUE": lambda _: [parameters.pop(0)] if parameters else [],
        "SERVO_OUTPUT_RAW": servos,
    }
    return join(edited(records, **edits))


def gaps(records: list[Record]) -> bytes:
    """Silence the link for 0.8 s, 4 s and 15 s."""
    for low, high in ((30.0, 30.8), (45.0, 49.0), (65.0, 80.0)):
        records = without(records, low, high)
    return join(records)


def reboot(first: list[Record], second: list[Record]) -> bytes:
    """Reboot the autopilot between two flights."""
    return join(after(first, second, pause_s=7.0))


def two_vehicles(other: list[Record], mine: list[Record]) -> bytes:
    """Put a second vehicle, system 2, on the link of the first: sorted by stamp."""
    return join(sorted([*other, *edited(mine, sysid=2)], key=lambda record: record[0]))


def signed(records: list[Record]) -> bytes:
    """Sign every frame."""
    return join(edited(records, key=KEY))


def garbage(records: list[Record]) -> bytes:
    """Put garbage at the start and between records, and cut the end off.

    The garbage is noise without a stamp, frames with unknown ids, frames with a wrong CRC, and line
    ends.
    """
    rng = np.random.default_rng(16)
    parts = [rng.bytes(333)]
    for stamp, frame in records:
        parts.append(join([(stamp, frame)]))
        if rng.random() < 0.02:
            match int(rng.integers(0, 4)):
                case 0:
                    parts.append(rng.bytes(int(rng.integers(1, 40))))
                case 1:
                    parts.append(join([(stamp, nonsense(rng))]))
                case 2:
                    parts.append(join([(stamp, wrong_crc(frame))]))
                case 3:
                    parts.append(b"\r\n")
    return b"".join(parts)[:-20]
