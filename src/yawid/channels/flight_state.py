"""Context of the samples: airspeed, altitude, whether the aircraft flies at all, and its mode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats, Ints, MessageBlock
from yawid.channels.latest import Latest
from yawid.channels.vehicle import Vehicle
from yawid.channels.vtol import Wings
from yawid.sources.mavlink.enums import ARDUPILOT, ARMED, LANDED

LEAST_AIRSPEED = 5.0
"""Below this in m/s, and as slow over ground, an aircraft with wings does not fly."""


@dataclass(slots=True)
class FlightState:
    """What VFR_HUD, HEARTBEAT and EXTENDED_SYS_STATE said last of the ``vehicle``."""

    vehicle: Vehicle | None = None
    wings: Wings = field(default_factory=Wings)
    _hud: Latest = field(default_factory=lambda: Latest(3))
    _state: Latest = field(default_factory=lambda: Latest(2))
    _landed: Latest = field(default_factory=lambda: Latest(1))

    def observe(self, messages: Mapping[str, MessageBlock]) -> None:
        """Take in the context messages of a block."""
        self._hud.observe(messages.get("VFR_HUD"), _columns("airspeed", "groundspeed", "alt"))
        self._state.observe(
            messages.get("HEARTBEAT"),
            lambda f: np.stack([f["custom_mode"], f["base_mode"] & ARMED], axis=1).astype(float),
        )
        self._landed.observe(messages.get("EXTENDED_SYS_STATE"), _columns("landed_state"))
        self.wings.observe(messages)

    def at(self, order: Ints) -> Floats:
        """Return what is known at each place, NaN where it is not, (n, 5).

        The columns are airspeed in m/s, on ground (0, 1), mode, altitude in m as VFR_HUD has it
        (above the sea, by ArduPilot and PX4 alike), and the bits of :class:`Held` by which nobody
        flies on wings alone.
        """
        hud, state = self._hud.at(order), self._state.at(order)
        on_ground = self._on_ground(hud, state[:, 1], self._landed.at(order)[:, 0])
        held = self.wings.held(order, state[:, 0], self.vehicle)
        return np.stack([hud[:, 0], on_ground, state[:, 0], hud[:, 2], held], axis=1)

    def _on_ground(self, hud: Floats, armed: Floats, landed: Floats) -> Floats:
        """Return 1 on the ground, 0 in the air and NaN where nothing reports, (n,).

        On the ground is what is slow by both speeds, or disarmed and slow over ground: VFR_HUD
        reports any airspeed at boot. An autopilot that says it has landed is believed unless it is
        fast over ground: a disarmed PX4 may be a passenger.
        """
        air, over_ground = hud[:, 0], hud[:, 1]
        fast, slow = over_ground >= LEAST_AIRSPEED, over_ground < LEAST_AIRSPEED
        counts = self.vehicle is not None and self.vehicle.autopilot == ARDUPILOT
        disarmed = (armed == 0.0) & counts
        grounded = slow & ((air < LEAST_AIRSPEED) | disarmed) | ~fast & (landed == LANDED)
        flying = fast | (air >= LEAST_AIRSPEED) | (landed > LANDED)
        return np.where(grounded, 1.0, np.where(flying, 0.0, np.nan))


def _columns(*names: str) -> Callable[[NDArray[Any]], Floats]:
    """Return what reads these fields as (n, columns)."""
    return lambda f: np.stack([np.asarray(f[name], float) for name in names], axis=1)
