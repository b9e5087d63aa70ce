"""Flight modes by name: which autopilot they belong to, and their numbers there."""

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.quantities.vehicles import (
    ARDUPILOT,
    AUTOPILOT_NAMES,
    FIXED_WING,
    PX4,
    mode_name,
    px4_custom_modes,
)

_NUMBER: Final = re.compile("[0-9]{1,10}")
FIRST_UNNAMED: Final = 1000
"""The first number for modes with unknown names: the name is lost, but changes of mode are not."""
_NUMBERS: Final = {ARDUPILOT: range(64), PX4: sorted({*px4_custom_modes(np.arange(64)).tolist()})}


def modes_of(texts: Sequence[str], autopilot: str | None) -> tuple[Floats, tuple[int, int]]:
    """Return modes (n,) as HEARTBEAT.custom_mode, NaN where a text is empty, and their vehicle.

    That is autopilot and vehicle type: the ``autopilot`` named, else the one that has most of the
    names; (0, 0) where no autopilot has any.
    """
    names = list(dict.fromkeys(text for text in texts if text and not _NUMBER.fullmatch(text)))
    known = {who: _numbers(who) for who in _NUMBERS} if names or autopilot else {}
    who = next((each for each in _NUMBERS if AUTOPILOT_NAMES[each] == autopilot), 0)
    if not who and names:
        who = max(known, key=lambda each: sum(name in known[each] for name in names))
        who = who if any(name in known[who] for name in names) else 0
    numbers = dict(known.get(who, {}))
    for name in names:
        numbers.setdefault(name, FIRST_UNNAMED + len(numbers))
    found = {text: float(text) if _NUMBER.fullmatch(text) else numbers.get(text, np.nan)
             for text in set(texts)}  # fmt: skip
    return np.array([found[text] for text in texts], float), (who, FIXED_WING if who else 0)


def _numbers(autopilot: int) -> dict[str, int]:
    """Return the numbers of an autopilot's modes by name."""
    named = ((mode_name(autopilot, FIXED_WING, n), n) for n in _NUMBERS[autopilot])
    return {name: number for name, number in named if not name.startswith("mode ")}
