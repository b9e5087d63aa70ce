"""The names of flight modes, as pilots know them and pymavlink lists them."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Ints
from yawid.sources.mavlink.enums import ARDUPILOT, PX4

_PX4_MODES = {
    0: (1, 0), 1: (2, 0), 2: (3, 0), 3: (4, 4), 4: (4, 3), 5: (4, 5), 10: (5, 0),
    14: (6, 0), 15: (7, 0), 17: (4, 2), 18: (4, 6), 19: (4, 8),
}  # fmt: skip
"""PX4's main and sub mode of each nav_state of its own (px4_custom_mode.h, VehicleStatus.msg)."""


ARDUPLANE_HOVER = range(17, 24)
"""ArduPlane's modes that hover, QSTABILIZE to QACRO, as HEARTBEAT.custom_mode."""


@lru_cache(maxsize=1024)  # a hostile link may name any mode
def mode_name(autopilot: int, vehicle_type: int, custom_mode: int) -> str:
    """Return the name of HEARTBEAT.custom_mode, ``mode N`` where it has none.

    ``autopilot`` and ``vehicle_type`` are HEARTBEAT's numbers (MAV_AUTOPILOT, MAV_TYPE).
    """
    # Importing mavutil changes the environment and takes 0.1 s: only those pay who need it.
    from pymavlink import mavutil

    name = None
    if autopilot == ARDUPILOT:
        name = (mavutil.mode_mapping_bynumber(vehicle_type) or {}).get(custom_mode)
    elif autopilot == PX4:
        reported = mavutil.interpret_px4_mode(0, custom_mode)
        name = None if reported == "UNKNOWN" else reported
    return name or f"mode {custom_mode}"


def px4_custom_modes(nav_state: NDArray[Any]) -> Ints:
    """Return HEARTBEAT.custom_mode as PX4 sends it for nav_state (n,), a byte, in its own logs.

    A state that is sent as another one is, or under no name, stays the number it is.
    """
    modes = np.arange(256)
    for state, (main, sub) in _PX4_MODES.items():
        modes[state] = main << 16 | sub << 24
    return modes[nav_state.astype(np.uint8)]
