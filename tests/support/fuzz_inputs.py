"""The inputs of the fuzzer: hostile flights as tlog bytes, and command lines.

Hypothesis draws them, and reduces a failing one in size before it is shown.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from flights.surgery import Encoder, join, message_of
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

START_US = 1_700_000_000_000_000
HOSTILE = (
    0.0, -0.0, 1.0, -1.0, 21.0, 4.0, 19.0, 79.0, 80.0, 77.0, 78.0, 24.0, 25.0, 201.0, 202.0,
    1100.0, 1500.0, 1900.0, 65535.0, 2.0**31, 1e30, -1e30, 3.4e38, 1e-38,
    float("nan"), float("inf"), float("-inf"),
)  # fmt: skip
NAMES = (
    *(f"SERVO{n}_{end}" for n in (1, 4, 16) for end in ("FUNCTION", "MIN", "TRIM", "MAX")),
    "SERVO4_REVERSED", "SERVO33_FUNCTION", "MIXING_GAIN", "MIXING_OFFSET", "RCMAP_YAW",
    "RCMAP_ROLL", "RC4_MIN", "RC4_TRIM", "RC4_MAX", "RC4_REVERSED", "KFF_RDDRMIX",
    *(f"{bank}_{end}{n}" for bank in ("PWM_MAIN", "PWM_AUX", "HIL_ACT")
      for end in ("FUNC", "MIN", "MAX", "CENT") for n in (1, 4)),
    "PWM_MAIN_REV", "HIL_ACT_REV", "CA_SV_CS0_TYPE", "CA_SV_CS1_TYPE", "CA_SV_CS_COUNT",
)  # fmt: skip


def numbers() -> st.SearchStrategy[float]:
    """Return a strategy for numbers of a parameter or field, many of them extreme."""
    return st.sampled_from(HOSTILE) | st.floats(width=32)


@dataclass(frozen=True)
class FuzzFlight:
    """A flight that may be hostile; :meth:`tlog` returns its bytes, and its repr makes it again.

    ``parameters`` are (fraction of the flight, name, value), ``steps`` (fraction, seconds) are the
    jumps of the vehicle's clock, ``fields`` (fraction, message, payload) are further messages, and
    ``damage`` (fraction, kind, seed) is done to the bytes.
    """

    kind: int = 1
    autopilot: int = 3
    seconds: float = 8.0
    hz: tuple[float, float] = (20.0, 20.0)
    messages: tuple[str, str] = ("ATTITUDE", "SERVO_OUTPUT_RAW")
    start_s: float = 10.0
    moves: bool = True
    parameters: tuple[tuple[float, str, float], ...] = ()
    steps: tuple[tuple[float, float], ...] = ()
    fields: tuple[tuple[float, str, bytes], ...] = ()
    damage: tuple[tuple[float, str, int], ...] = ()
    seed: int = 0

    def tlog(self) -> bytes:
        """Return the flight as the bytes of a tlog."""
        rng = np.random.default_rng(self.seed)
        encoder, records = Encoder(), []
        for t, message in self._timeline(rng):
            stamp = START_US + int(1e6 * t) + int(rng.exponential(3000.0))
            records.append((stamp, encoder.frame(message)))
        data = bytearray(join(records))
        for where, kind, seed in self.damage:
            damage(data, where, kind, np.random.default_rng(seed))
        return bytes(data)

    def _timeline(self, rng: np.random.Generator) -> list[tuple[float, Any]]:
        beat = dialect.MAVLink_heartbeat_message(self.kind, self.autopilot, 209, 5, 4, 3)
        events = [(float(t), beat) for t in np.arange(0.0, self.seconds, 1.0)]
        events += [
            (
                at * self.seconds,
                dialect.MAVLink_param_value_message(name.encode()[:16], value, 9, 10, 0),
            )
            for at, name, value in self.parameters
        ]
        events += [(at * self.seconds, message_of(name, data)) for at, name, data in self.fields]
        for hz, name in zip(self.hz, self.messages, strict=True):
            for t in np.arange(0.01, self.seconds, 1.0 / hz):
                boot_s = self.start_s + t
                boot_s += sum(step for at, step in self.steps if at * self.seconds <= t)
                swing = rng.normal() if self.moves else 0.0
                events.append((float(t), message_of(name, _payload(name, boot_s, t, swing))))
        return sorted(events, key=lambda event: event[0])


def _payload(name: str, boot_s: float, t: float, swing: float) -> bytes:
    """Return the payload of a message at a time; the rudder's position follows ``swing``."""
    ms, us = int(1e3 * boot_s) % 2**32, int(1e6 * boot_s) % 2**32
    rate = 0.4 * np.sin(2.0 * t) + 0.01 * swing
    pulse = 1500 + int(np.clip(100.0 * swing, -390.0, 390.0))
    controls, attitude = [np.clip(swing, -1, 1)] * 8, ("<I6f", ms, 0.1, 0.0, np.sin(t), 0, 0, rate)
    packed: dict[str, tuple[Any, ...]] = {
        "SERVO_OUTPUT_RAW": ("<I8H", us, *[pulse] * 8),
        "RC_CHANNELS": ("<I18H", ms, *[pulse] * 18),
        "ACTUATOR_OUTPUT_STATUS": ("<QI8f", us, 8, *controls),
        "ACTUATOR_CONTROL_TARGET": ("<Q8f", us, *controls),
        "HIL_ACTUATOR_CONTROLS": ("<Q8f", us, *controls),
        "ATTITUDE_QUATERNION": ("<I7f", ms, 1.0, 0, 0, 0, 0, 0, rate),
        "VFR_HUD": ("<4fhH", 20.0, 20.0, 100.0, 0.0, int(50.0 * t) % 360, 50),
    }
    return struct.pack(*packed.get(name, attitude))


def damage(data: bytearray, where: float, kind: str, rng: np.random.Generator) -> None:
    """Damage bytes: change some, insert garbage, cut some out, repeat a stretch, cut the end."""
    at, size = int(where * max(len(data) - 1, 0)), int(rng.integers(1, 3 + len(data) // 10))
    if kind == "flip":
        for place in rng.integers(0, max(len(data), 1), 1 + size // 20).tolist():
            data[place : place + 1] = rng.bytes(len(data[place : place + 1]))
        return
    end, instead = {
        "garbage": (at, rng.bytes(size)),
        "cut": (at + size, b""),
        "repeat": (at, data[at : at + size]),
        "stamp": (at + 8, rng.bytes(8)),
        "torn": (len(data), b""),
    }[kind]
    data[at:end] = instead


KINDS = st.sampled_from(["flip", "garbage", "cut", "repeat", "stamp", "torn"])
_READ = (
    "ATTITUDE", "ATTITUDE_QUATERNION", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "VFR_HUD", "HEARTBEAT",
    "PARAM_VALUE", "SYSTEM_TIME", "ACTUATOR_OUTPUT_STATUS", "ACTUATOR_CONTROL_TARGET",
    "HIL_ACTUATOR_CONTROLS", "GLOBAL_POSITION_INT", "HIGHRES_IMU", "RAW_IMU", "SCALED_IMU",
    "STATUSTEXT", "RADIO_STATUS",
)  # fmt: skip
_RUDDERS = (
    "RC_CHANNELS", "ACTUATOR_OUTPUT_STATUS", "ACTUATOR_CONTROL_TARGET", "HIL_ACTUATOR_CONTROLS",
)  # fmt: skip
_FRACTION = st.floats(0, 1)


@st.composite
def flights(draw: st.DrawFn) -> FuzzFlight:
    """Return flights of a vehicle that may report anything; most of them give an estimate."""
    odd = draw(st.sampled_from([False, False, True]))
    rates = st.sampled_from([2.0, 4.0, 10.0, 50.0] if odd else [10.0, 20.0, 20.0, 50.0])
    yaw = [*["ATTITUDE"] * 4, *(["ATTITUDE_QUATERNION", "VFR_HUD", "HIGHRES_IMU"] if odd else [])]
    rudder = [*["SERVO_OUTPUT_RAW"] * 4, *(_RUDDERS if odd else ())]
    names = st.sampled_from(NAMES) | st.text("SERVO_MAXIN14 \x7f\n", max_size=16)
    leaps = st.sampled_from([-1e4, -10.0, -1.4, 0.05, 3.0, 447.0, 5000.0, 4e6])
    payloads = st.binary(max_size=60) | st.sampled_from([b"\xff" * 60, b"\xff\xff\xff\x7f" * 15])
    return FuzzFlight(
        kind=draw(st.sampled_from([1, 2, 6, 22, 255] if odd else [1])),
        autopilot=draw(st.sampled_from([3, 12, 0, 8, 255] if odd else [3, 3, 12])),
        seconds=draw(st.sampled_from([0.2, 3.0, 6.0] if odd else [8.0, 15.0])),
        hz=draw(st.tuples(rates, rates)),
        messages=(draw(st.sampled_from(yaw)), draw(st.sampled_from(rudder))),
        start_s=draw(st.sampled_from([0.0, 10.0, 4290.0, 4294967.0, 1e9])),
        moves=draw(st.sampled_from([True, True, False])),
        parameters=draw(_tuples(st.tuples(_FRACTION, names, numbers()), 6)),
        steps=draw(_tuples(st.tuples(_FRACTION, leaps), 2)),
        fields=draw(_tuples(st.tuples(_FRACTION, st.sampled_from(_READ), payloads), 4)),
        damage=draw(_tuples(st.tuples(_FRACTION, KINDS, st.integers(0, 99)), 3)),
        seed=draw(st.integers(0, 99)),
    )


def _tuples(entries: st.SearchStrategy[Any], most: int) -> st.SearchStrategy[tuple[Any, ...]]:
    return st.lists(entries, max_size=most).map(tuple)


_WORDS = st.sampled_from(["", "nan", "inf", "-inf", "0", "-1", "1e300", "1e-300", "x", "é\n"])
_VALUES: dict[str, tuple[str, ...]] = {
    "--orders": ("3,3,2,1", "2,2,2,1", "1,1,0,1", "0,1,0,1", "6,6,6,3", "9,9,9,50", "3,3"),
    "--method": ("els", "rml"),
    "--also": ("els", "rml", "none"),
    "--memory": ("60", "1", "1e-3", "1e12", "inf"),
    "--rate": ("20", "10", "5", "0.1", "1000", "19.9999"),
    "--inputs": ("rudder", "rudder,aileron", "aileron"),
    "--output": ("yaw-rate", "yaw"),
    "--band": ("0.3,3", "0.01,9.9", "3,0.3", "1,1e9"),
    "--turn": ("keep", "remove"),
    "--rudder": ("auto", "servo:4", "servo:99", "vtail:1,4", "vtail:4,4", "control:2", "rc:4"),
    "--aileron": ("auto", "servo:1", "servo:4", "control:0", "rc:1"),
    "--rudder-sign": ("nose-right", "nose-left"),
    "--rudder-max-deg": ("25", "1e-6", "1e6"),
    "--from": ("0", "12", "1e9", "-1e9"),
    "--to": ("0", "14", "1e9"),
    "--sysid": ("1", "2", "255", "256"),
    "--signing-key-file": ("KEY", "LOG", "/nowhere/key"),
    "--config": ("TOML", "LOG", "/nowhere/x.toml"),
}  # fmt: skip


@st.composite
def options(draw: st.DrawFn) -> list[str]:
    """Return options with values that are mostly allowed; LOG, KEY and TOML stand for files."""
    chosen = draw(st.lists(st.sampled_from(sorted(_VALUES)), max_size=4, unique=True))
    given = []
    for name in chosen:
        is_allowed = draw(st.sampled_from(range(8))) < 7
        value = draw(st.sampled_from(_VALUES[name]) if is_allowed else _WORDS)
        given.append(f"{name}={value}")
    return given


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    """Return command lines, most of them of replay; LOG and OUT stand for files."""
    command = draw(
        st.sampled_from(["replay"] * 9 + ["inspect", "inspect", "orders", "live", "other"])
    )
    if command == "other":
        return draw(
            st.lists(st.text(max_size=8) | st.sampled_from(["--help", "schema"]), max_size=3)
        )
    given = draw(options())
    if command == "live":
        place = st.sampled_from(["udpin:127.0.0.1:0", "udpin:127.0.0.1:14998", "udp:", "é:1"])
        return ["live", draw(place), "--seconds=0.05", "--out=OUT", *given]
    logs = (
        ["LOG"]
        if command != "replay"
        else draw(st.sampled_from([["LOG"], ["LOG", "LOG"], ["OUT"]]))
    )
    ends = ["--out=OUT", "--force"] if command == "replay" else []
    return [command, *logs, "--json", *ends, *given]
