"""Makes the logs of replay_logs/ again, as case.toml says: the same bytes each time.

    python tools/make_cases.py                    # every case whose sources are available
    python tools/make_cases.py c172p_vtail
    python tools/make_cases.py --check            # make them, compare, write nothing

Log, checksum and truth.json are written, but no references: see tests/test_replay_logs.py. The
table ``[made]`` of a case.toml says how its log is made:

    [made]                                              [made]
    fly = ["--manoeuvre 3211 --seed 5"]                 cut = "sitl_fbwa_50hz"
    change = "vtail"                                    boot_s = [76.5, 255.0]

``fly`` has command lines of tools/fly_jsbsim.py. ``change`` names a function of this file, which
gets the records of each flight and returns the log: the same aircraft seems to have another
autopilot or servos, or the link failed. The truth is that of the last flight, unless ``truth`` is
false. With ``ordinary`` (fields of flights/ordinary.py) the rudder is not moved on purpose, with
``aileron`` (a seed) the aileron is moved, too, and with ``parameters`` (by name) ArduPlane's yaw
damper flies. ``cut`` is a stretch of vehicle time out of a recorded flight (--flights DIR), of
which only the messages are kept that yawid reads, with ``names`` (a regular expression) the
parameters of the whole flight that match it; so this also cuts the log of a case in another folder
(--cases DIR).
"""

from __future__ import annotations

import argparse
import hashlib
import re
import shlex
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import fly_jsbsim
import numpy as np
from flights.flight import Hands
from flights.fly import Made, fly, written
from flights.moved import ArduPlanesDamper, pulses
from flights.ordinary import Ordinary, fly_ordinary
from flights.plan import FlightPlan, Link, count, excitation
from flights.surgery import (
    Record,
    after,
    edited,
    join,
    messages,
    nonsense,
    px4_controls,
    setting,
    split,
    without,
    wrong_crc,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

CASES = Path(__file__).resolve().parents[1] / "replay_logs"
ESSENTIAL = ("HEARTBEAT", "ATTITUDE", "SERVO_OUTPUT_RAW", "VFR_HUD", "PARAM_VALUE", "STATUSTEXT")


def make(how: dict[str, Any], flights: Path) -> Made:
    """Return the log of a table ``[made]``, and its truth if that is known."""
    if "cut" in how:
        flight = flights / f"{how['cut']}.tlog"
        return Made(cut(flight.read_bytes(), *how["boot_s"], names=how.get("names", "")))
    lines = ([*shlex.split(line), "--out", "log.tlog"] for line in how["fly"])
    asked = [fly_jsbsim.asked(fly_jsbsim.parse(line)) for line in lines]
    if "ordinary" in how:
        return fly_ordinary(Ordinary(*asked[0], **how["ordinary"]))
    if "aileron" in how:
        return with_aileron(*asked[0], how["aileron"])
    if "parameters" in how:
        return with_damper(*asked[0], how["parameters"])
    made = [fly(*each) for each in asked]
    if "change" not in how:
        return made[0]
    log = globals()[how["change"]](*(split(each.log) for each in made))
    return Made(log, made[-1].truth if how.get("truth", True) else None)


def cut(log: bytes, from_s: float, to_s: float, *, names: str) -> bytes:
    """Return the essential records of a stretch of ATTITUDE's time_boot_ms; no byte changes.

    A record has the time of the last ATTITUDE up to it. Unless ``names`` is empty, the
    parameters are those of the whole log that match this regular expression.
    """
    boot_s, kept, records = -1.0, list[Record](), split(log)
    for record, message in zip(records, messages(records), strict=True):
        kind = message.get_type()
        if kind == "ATTITUDE":
            boot_s = message.time_boot_ms / 1000.0
        is_in = from_s <= boot_s < to_s
        if names and kind == "PARAM_VALUE":
            is_in = re.match(names, message.param_id) is not None
        if is_in and kind in ESSENTIAL:
            kept.append(record)
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


def with_damper(plan: FlightPlan, link: Link, parameters: dict[str, float]) -> Made:
    """Fly with ArduPlane's yaw damper of these parameters; at the end the aileron moves alone."""
    rudder, aileron = excitation(plan), np.zeros(count(plan.seconds))
    rudder[-8000:] = 0.0  # 8 s of rest
    aileron[-7000:-6000] = np.repeat([0.1, -0.1], 500)
    aileron[-4000:-3000] = np.repeat([-0.1, 0.1], 500)
    plan = replace(plan, parameters=tuple(parameters.items()))
    return fly(plan, link, Hands(rudder, aileron, react=ArduPlanesDamper()))


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
    """Sign every frame with a key that is not secret."""
    return join(edited(records, key=bytes(range(32))))


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


def main(argv: Sequence[str]) -> int:
    """Make cases; return 0, or 1 if --check finds that a log is not the one of its case.toml."""
    parser = argparse.ArgumentParser(
        prog="make_cases.py", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("names", nargs="*", metavar="CASE", help="(all)")
    parser.add_argument("--cases", type=Path, default=CASES, help="the folder of the cases")
    parser.add_argument("--flights", type=Path, default=Path("flights"), help="recorded flights")
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    options = parser.parse_args(argv)
    differ = False
    for name in options.names or sorted(x.parent.name for x in options.cases.glob("*/case.toml")):
        folder = options.cases / name
        text = (folder / "case.toml").read_text(encoding="utf-8")
        how = tomllib.loads(text).get("made", {})
        if not how or ("cut" in how and not options.flights.is_dir()):
            print(f"left out  {name}: {'no recorded flights' if how else 'no [made]'}")
            continue
        made = make(how, options.flights)
        assert len(made.log) < 1_000_000, f"{len(made.log)} bytes: a case's log has less"
        checksum = f'sha256 = "{hashlib.sha256(made.log).hexdigest()}"'
        differ |= checksum not in text
        print(f"{'same' if checksum in text else 'differs':>8}  {name}", flush=True)
        if not options.check:
            (folder / "log.tlog").write_bytes(made.log)
            text = re.sub(r'^sha256 = "\w*"', checksum, text, count=1, flags=re.MULTILINE)
            (folder / "case.toml").write_text(text, encoding="utf-8")
            if made.truth is not None:
                (folder / "truth.json").write_text(written(made), encoding="utf-8")
    return int(options.check and differ)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
