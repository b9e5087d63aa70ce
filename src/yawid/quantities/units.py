"""THE table of units: their spellings, and their size in SI units."""

from typing import Final, NamedTuple

import numpy as np

from yawid.quantities.airspeed import Kind

HALF_TRAVEL: Final = "half-travel"
"""The unit of a surface whose full deflection is unknown: half its travel is 1."""


class Unit(NamedTuple):
    """A unit of the size ``factor`` in the SI unit ``symbol``: 1 deg is 0.01745 rad.

    ``airspeed`` is the kind of airspeed if the unit names it: ktas are knots of true airspeed.
    """

    symbol: str
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
    spelt: Unit(symbol, factor) for symbol, factor, every in _SPELT for spelt in every.split()
}
KIND_WORDS: Final = {
    "tas": Kind.TRUE, "eas": Kind.EQUIVALENT, "cas": Kind.CALIBRATED, "ias": Kind.INDICATED,
}  # fmt: skip
UNITS: Final = _PLAIN | {
    f"{spelt}{parts}{word}": unit._replace(airspeed=kind)
    for spelt, unit in [*_PLAIN.items(), ("k", _PLAIN["kt"])]
    for parts in ("", "-", "_")
    for word, kind in KIND_WORDS.items()
    if unit.symbol == "m/s"
}
"""The units by every spelling that is understood."""


def unit_of(text: str) -> Unit | None:
    """Return the unit that a text spells, None where it spells no known unit."""
    plain = text.strip().strip("[](){}").strip().replace("µ", "u").replace("μ", "u")
    return UNITS.get(plain.lower().replace(" ", "")) or UNITS.get(plain.lower().replace(" ", "-"))


def unit_of_derivative(name: str, rudder_unit: str) -> str:
    """Return the unit of a derivative of the bare airframe, such as ``N_delta_r``."""
    unit = "1/s" if name[0] == "Y" or name[2:] in ("p", "r") else "1/s^2"
    surface = {"delta_a": HALF_TRAVEL, "delta_r": rudder_unit}.get(name[2:])
    return unit if surface is None else f"{unit} per {surface}"
