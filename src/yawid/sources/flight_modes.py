"""The names of flight modes, as pilots know them and pymavlink lists them."""

from __future__ import annotations

from functools import cache

_ARDUPILOT, _PX4 = 3, 12  # MAV_AUTOPILOT


@cache
def mode_name(autopilot: int, vehicle_type: int, custom_mode: int) -> str:
    """Return the name of HEARTBEAT.custom_mode, ``mode N`` where it has none.

    ``autopilot`` and ``vehicle_type`` are HEARTBEAT's numbers (MAV_AUTOPILOT, MAV_TYPE).
    """
    # Importing mavutil changes the environment and takes 0.1 s: only those pay who need it.
    from pymavlink import mavutil

    name = None
    if autopilot == _ARDUPILOT:
        name = (mavutil.mode_mapping_bynumber(vehicle_type) or {}).get(custom_mode)
    elif autopilot == _PX4:
        told = mavutil.interpret_px4_mode(0, custom_mode)
        name = None if told == "UNKNOWN" else told
    return name or f"mode {custom_mode}"
