"""The header of a record's column: its name, its unit, and how a positive value turns the nose."""

import re
from typing import Final, NamedTuple

from yawid.quantities.table import CHANNELS, TEXTS
from yawid.quantities.units import HALF_TRAVEL, UNITS, Unit, unit_of

NOTHING: Final = frozenset({"", "-", "--", "1", "[-]", "none", "n/a", "bool", "text", "utc"})
"""Texts in place of a unit for a column without a unit, or whose unit does not matter."""
_BRACKETS: Final = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|\{([^{}]*)\})\s*")
ANGLES: Final = frozenset({"rad", "rad/s"})
"""The units of the table that ``--units`` is for."""
SIGNS: Final = ("nose-right", "nose-left")
KINDS: Final = {"held": "commanded", "measured": "measured"}
"""The last word of a surface's unit, and what ``--rudder-is`` calls it."""


class Header(NamedTuple):
    """A column's header: its name without the unit in brackets, and its unit.

    ``unit`` is None where none is given. ``sign``, one of ``SIGNS``, is the way a positive value
    turns the nose, and ``kind``, one of ``KINDS``, what a deflection is between two rows; both are
    None where they are not given.
    """

    name: str
    unit: str | None
    sign: str | None = None
    kind: str | None = None


def header_of(cell: str, unit_row: str = "") -> Header:
    """Return the header from a cell such as ``r [deg/s]``, and the unit below it, if any."""
    name, unit = cell.strip(), unit_row.strip()
    found = _BRACKETS.fullmatch(name)
    if found is not None and found.group(1):
        inside = next(group for group in found.groups()[1:] if group is not None).strip()
        # f(x) is a name too: brackets must contain a unit, or a text for no unit.
        if unit_of(inside) is not None or inside.lower() in NOTHING or not unit:
            name, unit = found.group(1), unit or inside
    kind = next((each for each in KINDS if unit.lower().split()[-1:] == [each]), None)
    if kind is not None:
        unit = unit[: -len(kind)].strip()
    sign = next((each for each in SIGNS if unit.lower().replace(" ", "-").endswith(each)), None)
    if sign is not None:
        unit = unit[: -len(sign)].strip()
    return Header(name, None if unit.lower() in NOTHING else unit, sign, kind)


def by_suffix(name: str, column: str) -> str | None:
    """Return the unit at a name's end, such as ``r_deg_s``, if it fits ``column``, else None."""
    parts = name.split("_")
    for count in (3, 2, 1):
        suffix = "_".join(parts[-count:]).lower()
        if len(parts) > count and (unit := UNITS.get(suffix)) and fits(unit, column):
            return suffix
    return None


def fits(unit: Unit, column: str) -> bool:
    """Return whether a column may be in a unit; a surface may also be in angles."""
    wanted = CHANNELS[column].unit
    if unit.airspeed is not None and column != "airspeed":
        return False
    return unit.symbol == wanted or (wanted == HALF_TRAVEL and unit.symbol == "rad")


def is_column(name: str) -> str | None:
    """Return the table's column that a header names, with or without a unit's suffix, else None."""
    for candidate in (name, name.lower()):
        # In names of one letter the case counts: T is a temperature.
        if candidate in CHANNELS and (len(candidate) > 1 or candidate == name):
            return candidate
    for column in CHANNELS.keys() - TEXTS:
        if name.lower().startswith(f"{column}_") and (len(column) > 1 or name[0] == column):
            suffix = by_suffix(name, column)
            if suffix is not None and len(name) == len(column) + 1 + len(suffix):
                return column
    return None
