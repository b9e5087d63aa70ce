"""Which message fields are the rudder and the aileron, in which units, and with which sign.

Positive rudder means nose right (ArduPilot's and PX4's convention); ``rudder_sign="nose-left"``
turns a source that counts the other way. One unit of rudder is half the travel, MAX - TRIM. The
normalisation is the inverse of ArduPilot's ``SRV_Channel::pwm_from_angle``: the slope differs on
the two sides of TRIM.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from yawid.blocks import Floats, MessageBlock
from yawid.channels.vehicle import ARDUPILOT, FIXED_WING, Vehicle

RUDDER_FUNCTION = 21
AILERON_FUNCTION = 4
STOCK_SERVO = {RUDDER_FUNCTION: 4, AILERON_FUNCTION: 1}
CONTROL_INDEX = {RUDDER_FUNCTION: 2, AILERON_FUNCTION: 0}
STOCK_TRAVEL_US = (1100.0, 1500.0, 1900.0)
"""ArduPilot's defaults of SERVOn_MIN, SERVOn_TRIM and SERVOn_MAX."""
_TRAVEL = ("MIN", "TRIM", "MAX")
_SERVO_PARAMETER = re.compile(r"SERVO([1-9]\d?)_(FUNCTION|MIN|TRIM|MAX|REVERSED)")


@dataclass(frozen=True, slots=True)
class Surface:
    """One control surface: the field that carries it and how a raw value becomes a deflection.

    ``number`` counts as the message does (servo and rc from 1, control from 0); ``how`` is one of
    parameter, option, assumed; ``travel_us`` is (min, trim, max) or None where the raw value is
    already in -1..1; ``scale`` turns half the travel into the unit wanted, sign included.
    """

    message: str
    number: int
    how: str
    travel_us: tuple[float, float, float] | None
    reversed: bool = False
    scale: float = 1.0

    @property
    def source(self) -> str:
        """The message field, as a person would write it."""
        if self.message == "ACTUATOR_CONTROL_TARGET":
            return f"{self.message}.controls[{self.number}]"
        field = "servo{}_raw" if self.message == "SERVO_OUTPUT_RAW" else "chan{}_raw"
        return f"{self.message}.{field.format(self.number)}"

    def same_meaning(self, other: Surface) -> bool:
        """Tell whether a deflection of one unit still means the same, but for a moving trim."""
        mine, theirs = replace(self, travel_us=None, how=""), replace(other, travel_us=None, how="")
        measured = self.how == other.how == "parameter"
        return mine == theirs and (measured or self.travel_us == other.travel_us)

    def deflection(self, block: MessageBlock) -> Floats:
        """Return the deflection (n,) of each row, NaN where the output is off or absent."""
        raw = self._raw(block)
        if self.travel_us is None:
            value = np.where(np.abs(raw) <= 2.0, raw, np.nan)
        else:
            low, trim, high = self.travel_us
            pwm = np.where((raw > 0.0) & (raw < 65535.0), raw, np.nan)
            half = np.where(pwm > trim, high - trim, trim - low)
            value = (pwm - trim) / half
        sign = -self.scale if self.reversed else self.scale
        deflection: Floats = sign * value
        return deflection

    def _raw(self, block: MessageBlock) -> Floats:
        fields = block.fields
        if self.message == "ACTUATOR_CONTROL_TARGET":
            raw = fields["controls"][:, self.number].astype(float)
            return np.where(fields["group_mlx"] == 0, raw, np.nan)
        if self.message == "RC_CHANNELS":
            return np.asarray(fields[f"chan{self.number}_raw"], float)
        return np.asarray(fields[f"servo{(self.number - 1) % 16 + 1}_raw"], float)

    def rows(self, block: MessageBlock) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which rows of the message carry this channel at all (port, group)."""
        if self.message == "SERVO_OUTPUT_RAW":
            return np.asarray(block.fields["port"] == (self.number - 1) // 16)
        if self.message == "ACTUATOR_CONTROL_TARGET":
            return np.asarray(block.fields["group_mlx"] == 0)
        return np.ones(len(block), bool)


@dataclass(slots=True)
class ParameterTable:
    """The parameters heard so far, by name; the last value counts."""

    values: dict[str, float]

    def changes(self, block: MessageBlock) -> Iterator[int]:
        """Take PARAM_VALUE rows in, one by one; yield the order of each that may matter."""
        for order, raw, value in zip(
            block.order.tolist(),
            block.fields["param_id"].tolist(),
            block.fields["param_value"].tolist(),
            strict=True,
        ):
            name = raw.split(b"\0", 1)[0].decode("ascii", "replace")
            changed = self.values.get(name) != value
            self.values[name] = value
            if changed and (_SERVO_PARAMETER.fullmatch(name) or name.startswith("RC")):
                yield order

    def functions(self) -> dict[int, int]:
        """Return servo number -> function for every SERVOn_FUNCTION heard."""
        found = {}
        for name, value in self.values.items():
            match = _SERVO_PARAMETER.fullmatch(name)
            if match is not None and match[2] == "FUNCTION" and np.isfinite(value):
                found[int(match[1])] = int(value)
        return dict(sorted(found.items()))

    def travel(self, prefix: str) -> tuple[tuple[float, float, float], bool, bool]:
        """Return (min, trim, max), reversed, and whether all three were told and make sense."""
        told = [self.values.get(f"{prefix}_{end}") for end in _TRAVEL]
        low, trim, high = (
            s if t is None else t for s, t in zip(STOCK_TRAVEL_US, told, strict=True)
        )
        sound = 0.0 < low < trim < high < 65535.0
        reverse = self.values.get(f"{prefix}_REVERSED", 0.0) == 1.0
        return (low, trim, high) if sound else STOCK_TRAVEL_US, reverse, sound and None not in told


def find_surface(
    selector: str, function: int, vehicle: Vehicle, table: ParameterTable, *, controls_heard: bool
) -> Surface | None:
    """Return where a surface is to be read now, or None while nothing names it.

    With ``auto``: the servo whose SERVOn_FUNCTION says so; on an ArduPilot fixed-wing that has told
    no SERVOn_FUNCTION at all the stock channel, as an assumption; elsewhere
    ACTUATOR_CONTROL_TARGET.
    """
    kind, _, number = selector.partition(":")
    if kind == "servo":
        return _servo(int(number), "option", table)
    if kind == "control":
        return Surface("ACTUATOR_CONTROL_TARGET", int(number), "option", None)
    if kind == "rc":
        travel, reverse, _ = table.travel(f"RC{number}")
        return Surface("RC_CHANNELS", int(number), "option", travel, reverse)
    functions = table.functions()
    for servo, found in functions.items():
        if found == function:
            return _servo(servo, "parameter", table)
    if not functions and vehicle.autopilot == ARDUPILOT and vehicle.type == FIXED_WING:
        return _servo(STOCK_SERVO[function], "assumed", table)
    if not functions and controls_heard and vehicle.autopilot != ARDUPILOT:
        return Surface("ACTUATOR_CONTROL_TARGET", CONTROL_INDEX[function], "convention", None)
    return None


def _servo(number: int, how: str, table: ParameterTable) -> Surface:
    travel, reverse, told = table.travel(f"SERVO{number}")
    if how == "parameter" and not told:
        how = "parameter, travel assumed"
    return Surface("SERVO_OUTPUT_RAW", number, how, travel, reverse)


def why_no_surface(what: str, vehicle: Vehicle, table: ParameterTable) -> str:
    """Say what was found where a surface should have been."""
    functions = {n: f for n, f in table.functions().items() if f}
    if functions:
        found = ", ".join(f"SERVO{n}={f}" for n, f in functions.items())
        return f"no {what}: the servo functions found are {found}"
    return (
        f"no {what}: the vehicle is a {vehicle.type_name} on {vehicle.autopilot_name} "
        "and no SERVOn_FUNCTION names one"
    )
