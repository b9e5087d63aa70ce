"""What the header of a record's column says: its name, its unit, where positive turns the nose."""

import re
from typing import Final, NamedTuple

from yawid.quantities.table import CHANNELS, TEXTS
from yawid.quantities.units import HALF_TRAVEL, UNITS, Unit, unit_of

NOTHING: Final = frozenset({"", "-", "--", "1", "[-]", "none", "n/a", "bool", "text", "utc"})
"""What says of a column that it has no unit, or none that matters."""
_BRACKETS: Final = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|\{([^{}]*)\})\s*")
ANGLES: Final = frozenset({"rad", "rad/s"})
"""What --units says."""
SIGNS: Final = ("nose-right", "nose-left")


class Header(NamedTuple):
    """A column's header: its name, the name without a suffix that may be a unit, and its unit.

    ``unit`` is None where nothing is said; ``sign`` is where positive turns the nose, if it says.
    """

    name: str
    unit: str | None
    sign: str | None = None


def header_of(cell: str, unit_row: str = "") -> Header:
    """Return what a header's cell and the unit beside it say, ``r [deg/s]`` for one."""
    name, unit = cell.strip(), unit_row.strip()
    found = _BRACKETS.fullmatch(name)
    if found is not None and found.group(1):
        inside = next(group for group in found.groups()[1:] if group is not None).strip()
        # f(x) is a name too: what is in brackets must be a unit, or say that there is none.
        if unit_of(inside) is not None or inside.lower() in NOTHING or not unit:
            name, unit = found.group(1), unit or inside
    sign = next((each for each in SIGNS if unit.lower().replace(" ", "-").endswith(each)), None)
    if sign is not None:
        unit = unit[: -len(sign)].strip()
    return Header(name, None if unit.lower() in NOTHING else unit, sign)


def by_suffix(name: str, column: str) -> str | None:
    """Return the unit that a name's end says of ``column``, if one that fits it: ``r_deg_s``."""
    parts = name.split("_")
    for count in (3, 2, 1):
        suffix = "_".join(parts[-count:]).lower()
        if len(parts) > count and (unit := UNITS.get(suffix)) and fits(unit, column):
            return suffix
    return None


def fits(unit: Unit, column: str) -> bool:
    """Tell whether a column may be in a unit; a surface may be in angles too."""
    wanted = CHANNELS[column].unit
    if unit.airspeed is not None and column != "airspeed":
        return False
    return unit.symbol == wanted or (wanted == HALF_TRAVEL and unit.symbol == "rad")


def is_column(name: str) -> str | None:
    """Return which of the table's columns a header names, with a unit's suffix or without."""
    for candidate in (name, name.lower()):
        # Of one letter the case is told apart: T is a temperature.
        if candidate in CHANNELS and (len(candidate) > 1 or candidate == name):
            return candidate
    for column in CHANNELS.keys() - TEXTS:
        if name.lower().startswith(f"{column}_") and (len(column) > 1 or name[0] == column):
            suffix = by_suffix(name, column)
            if suffix is not None and len(name) == len(column) + 1 + len(suffix):
                return column
    return None
