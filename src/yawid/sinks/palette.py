"""The colours of every picture, one meaning each: in the report, in Rerun, on the trend's page.

Any two that meet in one picture also differ for the three kinds of colour blindness. Each has a
contrast of at least 2.9 on white paper and on the viewer's dark background.
"""

from collections.abc import Mapping
from typing import Final

from yawid.estimation import methods

Rgba = tuple[int, int, int, int]

DATA: Final = "#0072b2"
"""Measured values."""
MODEL: Final = "#cc7a00"
"""Values predicted or simulated by the answering model, its poles and its response."""
BARE: Final = "#00a0a0"
"""The bare airframe, next to the model and to the answers of the aircraft as flown."""
RUDDER: Final = "#009e73"
"""The input; pale: a manoeuvre, in which the rudder moved on its own."""
AILERON: Final = "#87702a"
BAD: Final = "#c4183c"
"""What is refused, fatal, diverged, worse than before or outside its bound."""
NEUTRAL: Final = "#7d7d7d"
"""Everything else: held samples, levels, other methods' numbers; dotted: changes of flight mode."""
GOOD: Final = "#3f8f29"
"""What is usable: for states and cards, never for a line, as it is too similar to RUDDER."""
CARE: Final = "#e8c000"
"""What is usable with care: only next to words, as it is too pale for a line."""

INPUTS: Final[Mapping[str, str]] = {"rudder": RUDDER, "aileron": AILERON}
METHODS: Final[Mapping[str, str]] = {name: row.colour for name, row in methods.METHODS.items()}
OF_METHODS: Final = ", ".join(f"{name.upper()} {methods.METHODS[name].shade}" for name in METHODS)
"""The names of all methods with their colours in words."""
MANOEUVRE: Final = METHODS[methods.OF_STRUCTURES]
"""A manoeuvre among others: no picture has it next to the lines of the methods."""
LINES: Final = ("#d85e15", "#8c8cd8", "#2d6a72", "#a58f6b", "#a715d8")
"""The parameters in one panel: these colours only distinguish lines and mean nothing else."""


def rgba(colour: str, alpha: int = 255) -> Rgba:
    """Return a colour "#rrggbb" as red, green, blue and alpha, each 0 to 255."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue, alpha
