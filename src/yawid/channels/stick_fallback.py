"""The substitute for a rudder that no message reports: the pilot's stick, only after a wait.

A stick equals the rudder in MANUAL alone. So it is used only if no output of the vehicle has been
received while the stick was, for five seconds of the vehicle's clock; from the first output on it
is no longer used. Live and replay take the same decision at the same message.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from yawid.blocks import Ints, MessageBlock
from yawid.channels.clock import boot_us
from yawid.channels.parameters import PX4_TRAVEL_US, STOCK_TRAVEL_US, ParameterTable
from yawid.channels.surface import OUTPUTS, STICKS, Surface, SurfacePart
from yawid.quantities.vehicles import ARDUPILOT, PX4

WAIT_US = 5_000_000
"""The wait for the real channel, in us of the vehicle's clock."""
_MAPS = {
    ARDUPILOT: {"rudder": ("RCMAP_YAW", 4), "aileron": ("RCMAP_ROLL", 1)},
    PX4: {"rudder": ("RC_MAP_YAW", 0), "aileron": ("RC_MAP_ROLL", 0)},
}
"""By autopilot, the parameter that names the stick's channel, and its default; 0 is no channel."""


@dataclass(slots=True)
class Wait:
    """The search for the place in the stream at which messages have come for five seconds."""

    over_at: int | None = None
    _began_us: int | None = None

    def observe(self, order: Ints, t_us: Ints) -> None:
        """Take in the places (n,) and times (n,) of messages; a step back begins the wait again."""
        if self.over_at is not None or len(order) == 0:
            return
        first = int(t_us[0]) if self._began_us is None else self._began_us
        began = np.minimum.accumulate(np.append(first, t_us))[1:]
        over = t_us - began >= WAIT_US
        self._began_us = int(began[-1])
        if over.any():
            self.over_at = int(order[np.argmax(over)])


@dataclass(slots=True)
class ReceivedMessages:
    """The messages with surfaces that have been received; sticks only count after the wait."""

    names: frozenset[str] = frozenset()
    _sticks: dict[str, int] = field(default_factory=dict)
    _wait: Wait = field(default_factory=Wait)

    def events(self, messages: Mapping[str, MessageBlock]) -> list[tuple[int, str]]:
        """Return the places in this block from which further messages count, and their names."""
        found = [(int(messages[n].order[0]), n) for n in (OUTPUTS & messages.keys()) - self.names]
        sticks = [messages[name] for name in STICKS if name in messages]
        for block in sticks:
            self._sticks.setdefault(block.name, int(block.order[0]))
        if sticks and self._wait.over_at is None:
            order = np.concatenate([block.order for block in sticks])
            t_us = np.concatenate([boot_us(block.fields) for block in sticks])
            by_order = np.argsort(order)
            self._wait.observe(order[by_order], t_us[by_order])
        if self._wait.over_at is not None:
            over = self._wait.over_at
            new = self._sticks.keys() - self.names
            found += [(max(over, self._sticks[name]), name) for name in new]
        return sorted(found)

    def count(self, name: str) -> None:
        """Count this message as received from now on."""
        self.names |= {name}


def stick(
    what: str, autopilot: int, table: ParameterTable, received: frozenset[str]
) -> Surface | None:
    """Return the pilot's stick for ``rudder`` or ``aileron``, None where it is no substitute.

    It is not used where any output is received, or where it is unknown which stick it is.
    """
    sticks = [name for name in STICKS if name in received]
    if received & OUTPUTS or not sticks or autopilot not in _MAPS:
        return None
    name, default = _MAPS[autopilot][what]
    number = int(table.get(name, default))
    if not 1 <= number <= 18:
        return None
    part, reported = stick_part(number, autopilot, table)
    by = name if name in table.values else f"{name} assumed"
    how = f"stand-in: the pilot's stick by {by}"
    return Surface(sticks[0], how if reported else f"{how}, travel assumed", (part,))


def stick_part(number: int, autopilot: int, table: ParameterTable) -> tuple[SurfacePart, bool]:
    """Return a stick's channel with its travel, and whether the travel was reported."""
    stock = PX4_TRAVEL_US if autopilot == PX4 else STOCK_TRAVEL_US
    travel, reverse, reported = table.travel(f"RC{number}", stock)
    return SurfacePart(number, travel, reverse), reported
