"""A control surface: the message fields that report it, and how raw values become a deflection.

Positive rudder means nose right (ArduPilot's and PX4's convention). One unit is half the travel,
MAX - TRIM. The normalisation is the inverse of ArduPilot's ``SRV_Channel::pwm_from_angle``: the
slope differs on the two sides of TRIM. PX4's ``output_limit_calc_single`` is the same with TRIM in
the middle, or at CENT.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from yawid.blocks import Bools, Floats, MessageBlock

Travel = tuple[float, float, float]

STICKS = ("RC_CHANNELS", "RC_CHANNELS_RAW")
"""The messages that report the pilot's stick, the better one first."""
STOPS = 0.995
"""An output beyond this part of half its travel may have been cut off at its stop."""


@dataclass(frozen=True, slots=True)
class SurfacePart:
    """One output of a surface: its number, travel in us (min, trim, max), direction and weight.

    ``number`` counts as the message does (servo and rc from 1, control from 0). ``travel_us`` is
    None where the raw value is already in -1..1.
    """

    number: int
    travel_us: Travel | None
    reversed: bool = False
    weight: float = 1.0

    def normalised(self, raw: Floats) -> Floats:
        """Return the raw values (n,) scaled to -1..1, NaN where the output is off or absent."""
        if self.travel_us is None:
            value = np.where(np.abs(raw) <= 2.0, raw, np.nan)
        else:
            low, trim, high = self.travel_us
            pwm = np.where((raw > 0.0) & (raw < 65535.0), raw, np.nan)
            value = (pwm - trim) / np.where(pwm > trim, high - trim, trim - low)
        return -value if self.reversed else value


@dataclass(frozen=True, slots=True)
class Surface:
    """A surface as the weighted sum of its parts, usually one; V-tails and elevons have two.

    ``how`` says how it was found (parameter, option, assumed, ...). ``scale`` converts half travels
    to the unit wanted, with its sign. ``twins`` are further outputs of the same function, which
    should move alike and are only compared. ``column`` is its name in a record without messages;
    ``measured`` is True for a measured deflection there, False for a command, else None.
    """

    message: str
    how: str
    parts: tuple[SurfacePart, ...]
    scale: float = 1.0
    twins: tuple[SurfacePart, ...] = ()
    column: str = ""
    measured: bool | None = None

    @property
    def source(self) -> str:
        """The message fields, in words, or a record's column."""
        if self.column:
            return self.column
        return " and ".join(self.name_of(part) for part in self.parts)

    def name_of(self, part: SurfacePart) -> str:
        """Return the message field of one output."""
        return f"{self.message}.{_field(self.message, part.number)}"

    def same_meaning(self, other: "Surface") -> bool:
        """Return whether one unit has the same meaning in both; trims and stops may differ."""
        measured = self.how == other.how == "parameter"
        mine, theirs = (
            replace(s, how="", twins=(), parts=tuple(replace(p, travel_us=None) for p in s.parts))
            for s in (self, other)
        )
        travels = [p.travel_us for p in self.parts] == [p.travel_us for p in other.parts]
        return mine == theirs and (measured or travels)

    def deflection(self, block: MessageBlock) -> Floats:
        """Return the deflection (n,) of each row, NaN where an output is off, absent or ambiguous.

        Where two outputs are mixed, an output at its stop does not show what was commanded.
        """
        total = np.zeros(len(block))
        for part in self.parts:
            value = self.normalised(part, block)
            if len(self.parts) > 1:
                value = np.where(np.abs(value) < STOPS, value, np.nan)
            total = total + part.weight * value
        return self.scale * total

    def normalised(self, part: SurfacePart, block: MessageBlock) -> Floats:
        """Return one output (n,) scaled to -1..1, NaN where it is off or absent."""
        return part.normalised(raw_output(block, part.number))

    def rows(self, block: MessageBlock) -> Bools:
        """Return which rows of the message carry this surface at all (port, group)."""
        if "port" in (block.fields.dtype.names or ()):
            _, count = NUMBERED[self.message]
            return np.asarray(block.fields["port"] == (self.parts[0].number - 1) // count)
        if self.message == "ACTUATOR_CONTROL_TARGET":
            return np.asarray(block.fields["group_mlx"] == 0)
        return np.ones(len(block), bool)


ARRAYS = {
    "ACTUATOR_CONTROL_TARGET": ("controls", 0),
    "HIL_ACTUATOR_CONTROLS": ("controls", 1),
    "ACTUATOR_OUTPUT_STATUS": ("actuator", 1),
}
"""Messages whose outputs are in an array: its field, and the number of the first output."""
NUMBERED = {
    "SERVO_OUTPUT_RAW": ("servo", 16),
    "RC_CHANNELS": ("chan", 18),
    "RC_CHANNELS_RAW": ("chan", 8),
}
"""Messages with a field for each output: its prefix, and the outputs in a message (one port)."""
OUTPUTS = frozenset({"SERVO_OUTPUT_RAW", *ARRAYS})
"""The messages that report outputs of the vehicle."""


def _field(message: str, number: int) -> str:
    if message in ARRAYS:
        name, first = ARRAYS[message]
        return f"{name}[{number - first}]"
    prefix, count = NUMBERED[message]
    return f"{prefix}{(number - 1) % count + 1}_raw"


def raw_outputs(block: MessageBlock) -> Iterator[tuple[int, Floats]]:
    """Yield the number and the raw values (n,) of every output; SERVO_OUTPUT_RAW's by ports."""
    ports, numbers = np.zeros(len(block), int), range(1, 17)
    if block.name in ARRAYS:
        name, first = ARRAYS[block.name]
        numbers = range(first, first + block.fields[name].shape[1])
    else:
        ports = block.fields["port"]
    for port in np.unique(ports).tolist():
        own = block.select(ports == port)
        yield from ((16 * port + i, raw_output(own, 16 * port + i)) for i in numbers)


def raw_output(block: MessageBlock, number: int) -> Floats:
    """Return one output's raw values (n,)."""
    if block.name in ARRAYS:
        name, first = ARRAYS[block.name]
        return np.asarray(block.fields[name][:, number - first], float)
    return np.asarray(block.fields[_field(block.name, number)], float)
