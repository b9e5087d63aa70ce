"""Units as flight-test files spell them, and what a column's header says of its own."""

import re
from typing import Final, NamedTuple

import numpy as np

from yawid.airspeed import Kind
from yawid.sources.records.columns import COLUMNS, HALF_TRAVEL, TEXTS


class Unit(NamedTuple):
    """A unit of one of the table's units (``of``), so many of those: 1 deg is 0.01745 rad.

    ``airspeed`` is which airspeed it is, where a unit says so: ktas are knots of a true one.
    """

    of: str
    factor: float
    airspeed: Kind | None = None


_DEG: Final = float(np.deg2rad(1.0))
_FT, _KT, _MPH = 0.3048, 1852.0 / 3600.0, 1609.344 / 3600.0
_SPELT: Final = (
    ("s", 1.0, "s sec secs second seconds"),
    ("s", 1e-3, "ms msec millisecond milliseconds"),
    ("s", 1e-6, "us usec microsecond microseconds"),
    ("s", 1e-9, "ns nanosecond nanoseconds"),
    ("s", 60.0, "min minute minutes"),
    ("rad", 1.0, "rad radian radians"),
    ("rad", _DEG, "deg degree degrees °"),
    ("rad/s", 1.0, "rad/s rad/sec rad_s rad_per_s radps rads-1 rad*s^-1"),
    ("rad/s", _DEG, "deg/s deg/sec deg_s deg_per_s degps dps °/s degs-1 deg*s^-1"),
    ("m/s", 1.0, "m/s m/sec m_s mps ms-1 m*s^-1"),
    ("m/s", _KT, "kt kts kn knot knots"),
    ("m/s", 1.0 / 3.6, "km/h km_h kmh kph"),
    ("m/s", _FT, "ft/s ft/sec ft_s fps"),
    ("m/s", _MPH, "mph"),
    ("m", 1.0, "m metre metres meter meters"),
    ("m", _FT, "ft foot feet"),
    ("m", 1000.0, "km"),
    ("kg/m^3", 1.0, "kg/m^3 kg/m3 kg/m³"),
    ("m/s^2", 1.0, "m/s^2 m/s2 m/s² m_s2 mps2"),
    ("m/s^2", 9.80665, "g"),
    ("m/s^2", _FT, "ft/s^2 ft/s2 ft/s²"),
    (HALF_TRAVEL, 1.0, "half-travel halftravel half_travel"),
)
_PLAIN: Final = {
    spelt: Unit(of, factor) for of, factor, all_of_it in _SPELT for spelt in all_of_it.split()
}
KIND_WORDS: Final = {
    "tas": Kind.TRUE, "eas": Kind.EQUIVALENT, "cas": Kind.CALIBRATED, "ias": Kind.INDICATED,
}  # fmt: skip
UNITS: Final = _PLAIN | {
    f"{spelt}{parts}{word}": Unit(unit.of, unit.factor, kind)
    for spelt, unit in [*_PLAIN.items(), ("k", _PLAIN["kt"])]
    for parts in ("", "-", "_")
    for word, kind in KIND_WORDS.items()
    if unit.of == "m/s"
}
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


def unit_of(text: str) -> Unit | None:
    """Return the unit that a text spells, None where it spells none that is known."""
    plain = text.strip().strip("[](){}").strip().replace("µ", "u").replace("μ", "u")
    return UNITS.get(plain.lower().replace(" ", "")) or UNITS.get(plain.lower().replace(" ", "-"))


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
    wanted = COLUMNS[column].unit
    if unit.airspeed is not None and column != "airspeed":
        return False
    return unit.of == wanted or (wanted == HALF_TRAVEL and unit.of == "rad")


def is_column(name: str) -> str | None:
    """Return which of the table's columns a header names, with a unit's suffix or without."""
    for candidate in (name, name.lower()):
        # Of one letter the case is told apart: T is a temperature.
        if candidate in COLUMNS and (len(candidate) > 1 or candidate == name):
            return candidate
    for column in COLUMNS.keys() - TEXTS:
        if name.lower().startswith(f"{column}_") and (len(column) > 1 or name[0] == column):
            suffix = by_suffix(name, column)
            if suffix is not None and len(name) == len(column) + 1 + len(suffix):
                return column
    return None
