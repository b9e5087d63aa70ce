"""A column's values in the table's unit, or an error of one line that asks for what is missing."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from yawid.blocks import Floats, Held, Ints, RecordBlock
from yawid.errors import ConfigError, SourceError
from yawid.quantities.table import CHANNELS
from yawid.quantities.units import HALF_TRAVEL, UNITS, Unit, unit_of
from yawid.quantities.vehicles import (
    ARDUPILOT,
    AUTOPILOT_NAMES,
    FIXED_WING,
    PX4,
    mode_name,
    px4_custom_modes,
)
from yawid.sources.records.find_columns import (
    RUDDER_UNIT,
    SIGN,
    UNITS_OPTION,
    Asked,
    Found,
    LackingError,
)
from yawid.sources.records.headers import ANGLES, KINDS, is_column
from yawid.sources.records.rows import (
    BACK_US,
    in_flight,
    largest,
    largest_stroke,
    usual_interval_us,
)
from yawid.sources.records.tables import NO_DATE, Table, is_unix

MOST: Final = {
    **dict.fromkeys(("q", "turn_rate"), 3.0),
    **{"r": 30.0, "roll": 3.2, "pitch": 1.6, "yaw": 6.3, "aileron": 2.0},
}
"""The largest values of columns without a unit that may be in the table's unit."""
EITHER: Final = 0.3
"""A yaw rate without a unit that stays below this is in rad/s: as deg/s it would not be a flight.
From here up to its ``MOST`` it could be either."""
IMPOSSIBLE: Final = {
    **dict.fromkeys(("r", "q", "turn_rate"), 1e3),
    **dict.fromkeys(("roll", "pitch", "yaw", "aileron"), 1e3),
    **{"ground_speed": 1e4, "altitude": 1e6, "mode": 2.0**32},
}
"""Values of this size are damage, in the table's units: an orbit is slower and lower. Angles may
have been unwrapped over many turns."""
MOST_RUDDER: Final = {HALF_TRAVEL: 2.0, "rad": 1.6, "deg": 90.0}
"""The largest rudder deflection that is possible, by unit."""
LEAST_STEP_S, MOST_STEP_S = 9e-4, 2.0
"""The range of the median step between rows if t has no unit: otherwise it is not in seconds."""
LATEST_S: Final = 9e9
"""The greatest time in s: no record has a greater one."""
LEAST_STROKE_RAD: Final = 1e-6
AILERON_RAD: Final = float(np.deg2rad(1.0))
"""The least stroke by which an aileron in rad is divided."""
MOST_BACK_SHARE, MOST_BACK = 0.01, 10
"""With more steps back than this share of the rows, and than this number, the rows are not in
order."""
_NUMBER: Final = re.compile("[0-9]{1,10}")
FIRST_UNNAMED: Final = 1000
"""The first number for modes with unknown names: the name is lost, but changes of mode are not."""
_NUMBERS: Final = {ARDUPILOT: range(64), PX4: sorted({*px4_custom_modes(np.arange(64)).tolist()})}


@dataclass(frozen=True, slots=True)
class Settled:
    """What is settled about a record's rudder.

    These are its unit by the names of ``--rudder-unit``, its sign, and its full deflection in deg,
    or, if that is unknown and the unit is an angle, its largest stroke within 5 s in rad; and
    whether it is measured or commanded, as ``--rudder-is`` says.
    """

    rudder_unit: str
    rudder_sign: str
    rudder_max_deg: float | None
    stroke_rad: float | None
    rudder_is: str


def place_of(table: Table, found: Found) -> str:
    """Return file and column in words, for an error."""
    return f"{table.path}, column {found.header.name}"


def in_its_unit(table: Table, name: str, found: Found) -> Floats:
    """Return a column in the table's unit.

    Raises:
        ConfigError: its unit is missing, and its name or its values do not fit the table's unit.
        SourceError: a cell is no number.
    """
    values, header = table.numbers(found.place), found.header
    if found.unit is not None:
        values = values * found.unit.factor if found.unit.factor != 1.0 else values
        return possible(name, values)
    own, most = CHANNELS[name].unit, largest(values)
    option = f"--columns '{name}={header.name}[UNIT]'"
    if own in ANGLES:
        option = f"--units deg or --units rad, or only for it by {option}"
    why = None
    if is_column(header.name) != name and name != "on_ground":
        why = f"the unit of this {name} is not given: give it by {option}"
    elif most > MOST.get(name, np.inf):
        why = (
            f"it goes up to {most:.4g}, which is too much in {own}, and no other unit is given: "
            f"give it by {option}"
        )
    elif name == "r" and most >= EITHER:
        why = (
            f"it goes up to {most:.4g}, which may be rad/s or deg/s, and the unit is not given: "
            f"give it by --columns 'r={header.name}[deg/s]' or 'r={header.name}[rad/s]'"
        )
    if why is not None:
        options = UNITS_OPTION if own in ANGLES else {}
        columns = () if own in ANGLES else (f"{name}={header.name}[UNIT]",)
        what = f"the unit of {header.name} (up to {most:.4g})"
        raise LackingError(f"{place_of(table, found)}: {why}", what, options, columns)
    return possible(name, values)


def possible(name: str, values: Floats) -> Floats:
    """Return values (n,), NaN where they are impossible, as in a damaged row."""
    most = IMPOSSIBLE.get(name, np.inf)
    return np.where(np.abs(values) < most, values, np.nan) if np.isfinite(most) else values


def rudder_of(
    table: Table, found: Found, asked: Asked, own: dict[str, str], t_us: Ints
) -> tuple[Floats, Settled]:
    """Return the rudder in half travels or in rad, signed as in the file, and what is settled.

    ``own`` holds the facts in the metadata of a file that yawid exported.

    Raises:
        ConfigError: unit or sign is missing, or the unit does not fit the values.
        SourceError: a cell is no number.
    """
    where, option = place_of(table, found), asked.rudder_unit
    if found.unit is not None and option is not None and unit_of(option) != found.unit:
        raise ConfigError(f"{where}: it is in {found.spelt}, but --rudder-unit is {option}")
    sign = asked.rudder_sign or found.header.sign or own.get("rudder_sign")
    turns = "to which positive rudder turns the nose"
    if found.unit is None and option is None:
        lacks_sign = {} if sign else SIGN
        side = "" if sign else f", and, if that is rad or deg, the side {turns}"
        raise LackingError(
            f"{where}: its unit is not given: give --rudder-unit half-travel, rad or deg, and for "
            "rad or deg also --rudder-sign",
            f"the unit of {found.header.name}{side}",
            RUDDER_UNIT | lacks_sign,
        )
    unit = found.unit or UNITS[option or HALF_TRAVEL]
    name = next(each for each in MOST_RUDDER if UNITS[each] == unit)
    values = table.numbers(found.place)
    most = largest(values)
    if most > MOST_RUDDER[name]:
        other = f"--columns 'rudder={found.header.name}[UNIT]'" if found.unit else "--rudder-unit"
        raise ConfigError(
            f"{where}: it goes up to {most:.4g}, which is too much in {name}: give another unit by "
            f"{other}, or leave missing values empty"
        )
    if sign is None and unit.symbol == "rad":
        raise LackingError(
            f"{where}: its sign is not given: give --rudder-sign nose-right or nose-left, the side "
            f"{turns} (flight test often has trailing edge left positive, which is nose-left)",
            f"the side {turns}",
            SIGN,
        )
    given = asked.rudder_max_deg, own.get("rudder_max_deg")
    max_deg = next((float(each) for each in given if each is not None), None)
    values = values if unit.factor == 1.0 else values * unit.factor
    stroke = None
    if unit.symbol == "rad" and max_deg is None:
        own_stroke = own.get("rudder_stroke_rad")
        stroke = (
            float(own_stroke) if own_stroke else max(largest_stroke(t_us, values), LEAST_STROKE_RAD)
        )
    rudder_is = asked.rudder_is or kind_of(found, unit, own)
    return values, Settled(name, sign or "nose-right", max_deg, stroke, rudder_is)


def kind_of(found: Found, unit: Unit, own: dict[str, str]) -> str:
    """Return whether a surface's column is ``measured`` or ``commanded``.

    The word in its header decides, then whether yawid exported the file, then the unit: an angle
    is measured.
    """
    if found.header.kind is not None:
        return KINDS[found.header.kind]
    return own.get("kind") or ("measured" if unit.symbol == "rad" else "commanded")


def flown_stroke_rad(rows: RecordBlock) -> float:
    """Return the largest stroke within 5 s of a rudder in rad, in flight only, as a scale.

    The full deflections of a control check, of taxi and of a landing roll say nothing of a flight.
    """
    flown = np.where(in_flight(rows), rows.rudder, np.nan)
    return max(largest_stroke(rows.t_us, flown), LEAST_STROKE_RAD)


def aileron_of(table: Table, found: Found, t_us: Ints) -> Floats:
    """Return the aileron in half travels, or an angle divided by its largest stroke.

    Its travel is unknown, and no answer is in its unit.

    Raises:
        ConfigError, SourceError: as :func:`in_its_unit`.
    """
    values = in_its_unit(table, "aileron", found)
    if found.unit is None or found.unit.symbol == HALF_TRAVEL:
        return values
    return np.asarray(values / max(largest_stroke(t_us, values), AILERON_RAD))


def held_of(table: Table, found: Found) -> Ints:
    """Return the bits of Held (n,) from a column with their names.

    Raises:
        SourceError: a word is no reason.
    """
    said = table.words(found.place)
    if said is None:
        if np.isfinite(table.numbers(found.place)).any():
            raise SourceError(
                f"{place_of(table, found)}: it holds numbers, but yawid export writes names of "
                "reasons: leave the column out"
            )
        return np.zeros(table.rows, np.int64)
    texts, row_has = said
    for i, text in enumerate(texts):
        if {*text.upper().split()} - Held.__members__.keys():
            row = int(np.argmax(row_has == i))
            raise SourceError(
                f"{place_of(table, found)}, {table.line(row)}: {text!r} is not a reason to "
                "hold a sample that yawid export writes: leave the column out or empty"
            )
    bits = [sum(Held[word].value for word in {*text.upper().split()}) for text in texts]
    return np.array(bits, np.int64)[row_has]


def times_of(table: Table, found: dict[str, Found]) -> tuple[Ints, Ints | None]:
    """Return t in us (n,) since the record's beginning, and Unix time in ns, None if unknown.

    Raises:
        ConfigError: t has no unit and is hardly in s, or is greater than any record's.
        SourceError: a row has no time, or the times do not advance.
    """
    t = found["t"]
    where, unix_ns = place_of(table, t), table.dates_ns(t.place)
    if unix_ns is None:
        t_s = table.numbers(t.place)
        t_s = t_s if t.unit is None else t_s * t.unit.factor
        _must_have_all(table, t, np.isfinite(t_s))
        if (most := largest(t_s)) > LATEST_S:
            raise ConfigError(f"{where}: it goes up to {most:.4g} s{_say_unit(t)}")
        t_us = np.rint(t_s * 1e6).astype(np.int64)
        unix_ns = t_us * 1000 if is_unix(t_s) else None
    if unix_ns is not None:
        _must_have_all(table, t, unix_ns != NO_DATE)
        t_us = (unix_ns - unix_ns[0]) // 1000
    steps_us, step_s = np.diff(t_us), usual_interval_us(t_us) / 1e6
    is_slow = t.unit is None and not LEAST_STEP_S <= step_s <= MOST_STEP_S
    back = steps_us < 0 if step_s == 0.0 or is_slow else steps_us <= -BACK_US
    if (count := int(back.sum())) > max(MOST_BACK, MOST_BACK_SHARE * len(t_us)):
        raise SourceError(
            f"{where}: the rows are not in the order of time: it falls back at {count} of "
            f"{len(t_us)} rows, first in {table.line(int(back.argmax()) + 1)}: sort them by it"
        )
    if step_s == 0.0:
        raise SourceError(f"{where}: the time does not advance in it")
    if is_slow:
        raise ConfigError(f"{where}: its median step is {step_s:g} s{_say_unit(t)}")
    if unix_ns is None and "time" in found and found["time"].place != t.place:
        unix_ns = table.dates_ns(found["time"].place)
    return t_us, unix_ns


def _must_have_all(
    table: Table, found: Found, has: "np.ndarray[tuple[int], np.dtype[np.bool_]]"
) -> None:
    if not has.all():
        row = int(np.argmin(has))
        raise SourceError(f"{place_of(table, found)}, {table.line(row)}: a row without a time")


def _say_unit(t: Found) -> str:
    return f"; give another unit by --columns 't={t.header.name}[ms]'"


def modes_of(texts: Sequence[str], autopilot: str | None) -> tuple[Floats, tuple[int, int]]:
    """Return different texts (n,) as HEARTBEAT.custom_mode, NaN for an empty one, and the vehicle.

    That is autopilot and vehicle type: the ``autopilot`` named, else the one that has most of the
    names; (0, 0) where no autopilot has any.
    """
    names = [text for text in texts if text and not _NUMBER.fullmatch(text)]
    known = {who: _numbers(who) for who in _NUMBERS} if names or autopilot else {}
    who = next((each for each in _NUMBERS if AUTOPILOT_NAMES[each] == autopilot), 0)
    if not who and names:
        who = max(known, key=lambda each: sum(name in known[each] for name in names))
        who = who if any(name in known[who] for name in names) else 0
    numbers = dict(known.get(who, {}))
    for name in names:
        numbers.setdefault(name, FIRST_UNNAMED + len(numbers))
    found = [float(t) if _NUMBER.fullmatch(t) else numbers.get(t, np.nan) for t in texts]
    return np.array(found, float), (who, FIXED_WING if who else 0)


def _numbers(autopilot: int) -> dict[str, int]:
    """Return the numbers of an autopilot's modes by name."""
    named = ((mode_name(autopilot, FIXED_WING, n), n) for n in _NUMBERS[autopilot])
    return {name: number for name, number in named if not name.startswith("mode ")}
