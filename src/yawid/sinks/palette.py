"""The colours of every picture, one meaning each: in the report, in Rerun, on the trend's page.

All differ for the three kinds of colour blindness too, wherever two of them meet in one picture,
and have a contrast of 2.9 at least on white paper and on the viewer's dark ground.
"""

from collections.abc import Mapping
from typing import Final

from yawid.estimation import methods

Rgba = tuple[int, int, int, int]

DATA: Final = "#0072b2"
"""Measured."""
MODEL: Final = "#cc7a00"
"""Predicted or simulated by what answers, and what that model is: poles, response."""
RUDDER: Final = "#009e73"
"""The input; pale: a manoeuvre, the rudder moved by itself."""
AILERON: Final = "#87702a"
BAD: Final = "#c4183c"
"""Refused, fatal, diverged, changed for the worse; outside its bound."""
NEUTRAL: Final = "#7d7d7d"
"""All else: held samples, levels, other methods' numbers; dotted: the flight mode changed."""
GOOD: Final = "#3f8f29"
"""Usable; of states and cards alone, never of a line, as it is near to RUDDER."""
CARE: Final = "#e8c000"
"""Usable with care; beside words alone, as it is too pale for a line."""

INPUTS: Final[Mapping[str, str]] = {"rudder": RUDDER, "aileron": AILERON}
METHODS: Final[Mapping[str, str]] = {name: row.colour for name, row in methods.METHODS.items()}
OF_METHODS: Final = ", ".join(f"{name.upper()} {methods.METHODS[name].shade}" for name in METHODS)
"""Those in words."""
MANOEUVRE: Final = METHODS[methods.of_a_record()[0]]
"""A manoeuvre among others: by the method that answers them."""
LINES: Final = ("#d85e15", "#8c8cd8", "#2d6a72", "#a58f6b", "#a715d8")
"""Of the parameters in one panel: a colour says which line is which, and has no other meaning."""


def rgba(colour: str, alpha: int = 255) -> Rgba:
    """Return a colour as four numbers of 0 to 255."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue, alpha
