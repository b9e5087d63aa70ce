"""Changes to the log of a flight: the same aircraft seems to have another autopilot or servos.

Each function takes the records of a flight (tools/flights/surgery.py) and returns others.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from flights.surgery import Record, edited, px4_control, rewrite, together, without
from pymavlink.dialects.v20 import ardupilotmega as mavlink


def vtail(records: list[Record]) -> list[Record]:
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
    return edited(records, PARAM_VALUE=partial(_set, values), SERVO_OUTPUT_RAW=servos)


def _set(values: dict[str, float], message: Any) -> None:
    message.param_value = values.get(message.param_id, message.param_value)


def _as_px4(message: Any) -> None:
    message.autopilot = mavlink.MAV_AUTOPILOT_PX4


def px4_controls(records: list[Record]) -> list[Record]:
    """Make the autopilot a PX4 that reports normalised controls, of group 0 and of another."""

    def servos(message: Any) -> list[Any]:
        yaw, roll = (message.servo4_raw - 1500) / 400, (message.servo1_raw - 1500) / 400
        other = (message.time_usec, 1, [0.3] * 8)
        mine = px4_control(message.time_usec, roll, yaw)
        return [mine, mavlink.MAVLink_actuator_control_target_message(*other)]

    return edited(records, HEARTBEAT=_as_px4, PARAM_VALUE=lambda _: [], SERVO_OUTPUT_RAW=servos)


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


def px4_outputs(records: list[Record]) -> list[Record]:
    """Make the autopilot a PX4 that reports its outputs, with the surface of each as parameters.

    PX4 sends the four bytes of an integer parameter in the place of the float.
    """
    parameters = [
        mavlink.MAVLink_param_value_message(
            name.encode(),
            float(np.int32(value).view(np.float32)),
            mavlink.MAV_PARAM_TYPE_INT32,
            len(PX4_PARAMETERS),
            index,
        )
        for index, (name, value) in enumerate(PX4_PARAMETERS)
    ]

    def servos(message: Any) -> None:
        message.servo5_raw, message.servo4_raw = 3000 - message.servo4_raw, 1000

    def parameter(message: Any) -> list[Any]:
        return [parameters.pop(0)] if parameters else []

    return edited(records, HEARTBEAT=_as_px4, PARAM_VALUE=parameter, SERVO_OUTPUT_RAW=servos)


def no_rudder(records: list[Record]) -> list[Record]:
    """Make the aircraft a flying wing: its parameters name elevons and no rudder."""
    values = {"SERVO1_FUNCTION": 77.0, "SERVO2_FUNCTION": 78.0, "SERVO4_FUNCTION": 0.0}
    return edited(records, PARAM_VALUE=partial(_set, values))


def with_gaps(records: list[Record]) -> list[Record]:
    """Silence the link for 0.8 s, 4 s and 15 s."""
    for low, high in ((30.0, 30.8), (45.0, 49.0), (65.0, 80.0)):
        records = without(records, low, high)
    return records


def two_vehicles(other: list[Record], mine: list[Record]) -> list[Record]:
    """Put a second vehicle, system 2, on the link of the first."""
    return together(other, rewrite(mine, sysid=2))
