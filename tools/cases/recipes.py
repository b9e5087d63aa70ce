"""The recipes of replay_logs/: how each log is made, and what is true of the aircraft in it.

The first functions change the records of a flight (tools/flights/surgery.py): the same aircraft
seems to have another autopilot or servos.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import fly_jsbsim
import numpy as np
from flights.flight import Hands
from flights.fly import Made, fly
from flights.ordinary import Ordinary, fly_ordinary
from flights.plan import FlightPlan, excitation
from flights.surgery import (
    Record,
    after,
    edited,
    join,
    littered,
    px4_controls,
    rewrite,
    setting,
    split,
    together,
    without,
)
from flights.telemetry import Link
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from trim_tlog import ESSENTIAL, trim


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


def px4_groups(records: list[Record]) -> list[Record]:
    """Make the autopilot a PX4 that reports normalised controls, of group 0 and of another."""

    def controls(mine: Any) -> list[Any]:
        other = (mine.time_usec, 1, [0.3] * 8)
        return [mine, mavlink.MAVLink_actuator_control_target_message(*other)]

    return edited(px4_controls(records), ACTUATOR_CONTROL_TARGET=controls)


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

    heartbeat = setting(autopilot=mavlink.MAV_AUTOPILOT_PX4)
    return edited(records, HEARTBEAT=heartbeat, PARAM_VALUE=parameter, SERVO_OUTPUT_RAW=servos)


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


Truth = dict[str, Any]
KEY = bytes(range(32))
"""The key that signs the frames of the signed case; it is not secret."""
UINT32_WRAP_S = 2**32 / 1e6


def flown(command: str, *_: Path) -> Made:
    """Fly as tools/fly_jsbsim.py does with these options."""
    options = fly_jsbsim.parse([*shlex.split(command), "--out", "log.tlog"])
    return fly(*fly_jsbsim.asked(options), flight=f"tools/fly_jsbsim.py {command}")


def changed(
    command: str,
    change: Callable[[list[Record]], Iterable[Record] | bytes],
    *_: Path,
    has_truth: bool = True,
) -> Made:
    """Fly, then change the log's records; without ``has_truth``, the result has no truth."""
    made = flown(command)
    log = change(split(made.log))
    return Made(log if isinstance(log, bytes) else join(log), made.truth if has_truth else None)


def flown_twice(
    first: str,
    second: str,
    combine: Callable[[list[Record], list[Record]], Sequence[Record]],
    *_: Path,
) -> Made:
    """Fly twice and combine the logs; the truth is that of the second flight."""
    a, b = flown(first), flown(second)
    return Made(join(combine(split(a.log), split(b.log))), b.truth)


def cut(name: str, low_s: float, high_s: float, truth: Truth | None, flights: Path) -> Made:
    """Cut a stretch out of a recorded flight, keeping only the messages that yawid reads."""
    log = (flights / f"{name}.tlog").read_bytes()
    command = (
        f"python tools/trim_tlog.py {name}.tlog log.tlog --from {low_s:g} --to {high_s:g} --only"
    )
    return Made(trim(log, low_s, high_s, ESSENTIAL), truth and truth | {"command": command})


def with_aileron(_: Path) -> Made:
    """Fly with rudder and aileron both moved on purpose, so that each moves the yaw on its own.

    The aileron is then an input, so that the Dutch roll estimated is that of the bare airframe.
    """
    plan = FlightPlan(seconds=100.0, roll_gain=0.3, roll_rate_gain=0.0, true_feedback=True)
    link = Link(attitude_hz=25.0, servo_hz=25.0, seed=11)
    pulses = np.random.default_rng(12).choice([-0.12, 0.12], size=round(plan.seconds / 0.3) + 2)
    pulses[: round(5.0 / 0.3)] = 0.0
    rudder = excitation(plan)
    hands = Hands(rudder, np.repeat(pulses, 300)[: len(rudder)], nose_held=False)
    made = fly(plan, link, hands)
    assert made.truth is not None
    return Made(made.log, made.truth | {"dutch_roll": made.truth["dutch_roll_open_loop"]})


def turned(severity: int, mix: float, law: str, lag_s: float, *_: Path) -> Made:
    """Fly eight minutes of turns, in which the rudder is not moved on purpose."""
    plan = FlightPlan(
        "OV10", 170.0, 4000.0, seconds=480.0, manoeuvre="none", roll_gain=0.8, roll_rate_gain=0.2
    )
    link = Link(10.0, 10.0, seed=31, servo_ms=40)
    return fly_ordinary(
        Ordinary(plan, link, severity=severity, mix=mix, law=law, servo_lag_s=lag_s)
    )


FLY = "--true-feedback --manoeuvre 3211 --attitude-hz 25 --servo-hz 25 --seconds 90 --seed"
SITL = "ArduPlane V4.6-dev SITL"
_FIRST = "--true-feedback --manoeuvre 3211 --seconds 120"
_GCS = f"{_FIRST} --attitude-hz 10 --servo-hz 5 --heading-deg 180 --seed 2"
SITL_TRUTH: Truth = {
    "aircraft": f"{SITL}, built-in plane model",
    "flown": "FBWA at 22.00 +- 0.03 m/s; doublets, 3-2-1-1, PRBS and sweep on the rudder",
    "dutch_roll": {"wn_rad_s": 10.22, "wn_std": 0.016, "zeta": 0.63, "zeta_std": 0.0005},
    "linearised": "at 22 m/s, closed with FBWA's roll loop as it is in the simulator",
    "uncertainty": "wn: 0.03 m/s (VFR_HUD, standard deviation) by 0.5 rad/s per m/s (9.97 at 21.5 "
    "m/s, 10.47 at 22.5), and half the last digit; zeta: half the last digit",
    "servo_lag_s": 0.14,
    "rudder_mix": "rudder carries 0.5 aileron (KFF_RDDRMIX)",
}
SEGMENTS = {
    "rest": [76.499, 86.479],
    "doublet": [86.479, 106.479],
    "3-2-1-1": [106.499, 143.079],
    "prbs": [143.099, 193.879],
    "sweep": [193.879, 253.9],
}
"""The parts of the flight at 50 Hz, in s since boot."""

RECIPES: dict[str, Callable[[Path], Made]] = {
    "c172p_3211": partial(flown, _FIRST),
    "c172p_gcs_rates": partial(flown, _GCS),
    "c172p_mavlink1": partial(flown, f"{FLY} 3 --mavlink1"),
    "c172p_reversed": partial(flown, f"{FLY} 4 --rudder 1050,1430,1900,1"),
    "c172p_vtail": partial(changed, f"{FLY} 5", vtail),
    "px4_controls": partial(changed, f"{FLY} 6", px4_groups),
    "px4_outputs": partial(changed, f"{FLY} 7", px4_outputs),
    "c172p_yaw_output": partial(flown, f"{FLY} 8 --heading-deg 0"),
    "c172p_aileron": with_aileron,
    "c172p_gaps": partial(changed, f"{FLY} 9", with_gaps),
    "c172p_reboot": partial(
        flown_twice,
        f"{FLY} 10 --boot-s 400 --seconds 50",
        f"{FLY} 11 --boot-s 8 --seconds 50",
        partial(after, pause_s=7.0),
    ),
    "c172p_uint32_wrap": partial(flown, f"{FLY} 12 --boot-s {UINT32_WRAP_S - 50.0:.3f}"),
    "two_vehicles": partial(
        flown_twice, f"{FLY} 13", f"{FLY} 14 --speed-kt 80 --boot-s 700", two_vehicles
    ),
    "c172p_garbage": partial(changed, f"{FLY} 15", partial(littered, seed=16)),
    "c172p_signed": partial(changed, f"{FLY} 17", partial(rewrite, key=KEY)),
    "no_rudder": partial(changed, f"{FLY} 18 --seconds 20", no_rudder, has_truth=False),
    "turns_calm": partial(turned, 0, 0.5, "arduplane", 0.0),
    "turns_gusts": partial(turned, 2, 0.0, "px4", 0.06),
    "sitl_fbwa_50hz": partial(
        cut, "sitl_fbwa_50hz", 76.5, 255.0, SITL_TRUTH | {"segments_boot_s": SEGMENTS}
    ),
    "sitl_fbwa_stock_33hz": partial(cut, "sitl_fbwa_stock_33hz", 76.8, 255.0, SITL_TRUTH),
    "sitl_fbwa_manoeuvres": partial(cut, "sitl_fbwa_stock_33hz", 70.0, 263.0, SITL_TRUTH),
    "sitl_auto": partial(cut, "sitl_auto_25hz", 60.0, 360.0, None),
}
"""How each log is made, by a function of the folder of recorded flights, out of which those named
sitl are cut; what is said of a log stands in its case.toml."""
