"""Context of the samples: airspeed, whether the aircraft flies at all, and its mode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats, Ints, MessageBlock

LEAST_AIRSPEED = 5.0
"""Below this in m/s, and as slow over ground, an aircraft with wings does not fly."""
ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED in HEARTBEAT.base_mode."""


@dataclass(slots=True)
class Latest:
    """The newest values of a message before any place of the stream, NaN before the first."""

    columns: int
    order: Ints = field(default_factory=lambda: np.full(1, -1, np.int64))
    values: Floats = field(default_factory=lambda: np.zeros((1, 0)))

    def note(self, block: MessageBlock | None, read: Callable[[NDArray[Any]], Floats]) -> None:
        """Take a block in; of what came before only the newest row is still needed."""
        before = self.values[-1:] if self.values.shape[1] else np.full((1, self.columns), np.nan)
        order, values = self.order[-1:], before
        if block is not None:
            order = np.concatenate([order, block.order])
            values = np.concatenate([values, read(block.fields)])
        self.order, self.values = order, values

    def at(self, order: Ints) -> Floats:
        """Return the values (n, columns) held at each place."""
        held: Floats = self.values[np.searchsorted(self.order, order) - 1]
        return held


@dataclass(slots=True)
class Context:
    """What VFR_HUD and HEARTBEAT said last: airspeed and ground speed, mode and armed."""

    armed_counts: bool = False
    _speeds: Latest = field(default_factory=lambda: Latest(2))
    _state: Latest = field(default_factory=lambda: Latest(2))

    def note(self, messages: Mapping[str, MessageBlock]) -> None:
        """Take in the context messages of a block."""
        speeds, state = messages.get("VFR_HUD"), messages.get("HEARTBEAT")
        self._speeds.note(
            speeds, lambda f: np.stack([f["airspeed"], f["groundspeed"]], axis=1).astype(float)
        )
        self._state.note(
            state,
            lambda f: np.stack([f["custom_mode"], f["base_mode"] & ARMED], axis=1).astype(float),
        )

    def at(self, order: Ints) -> Floats:
        """Return (airspeed m/s, on ground 0 or 1, mode) (n, 3) as known at each place.

        On the ground is what is slow by both speeds, or disarmed and slow over ground: VFR_HUD
        tells any airspeed at boot. Without VFR_HUD an aircraft is taken to fly.
        """
        speeds, state = self._speeds.at(order), self._state.at(order)
        air, over_ground = speeds[:, 0], speeds[:, 1]
        slow = over_ground < LEAST_AIRSPEED
        disarmed = (state[:, 1] == 0.0) & self.armed_counts
        on_ground = slow & ((air < LEAST_AIRSPEED) | disarmed)
        return np.stack([air, on_ground.astype(float), state[:, 0]], axis=1)
