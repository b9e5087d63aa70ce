"""Numbers of MAVLink's enums (common.xml) with their names, and the names of flight modes."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

import numpy as np

from yawid.blocks import Array, Ints
from yawid.quantities.airspeed import Kind

ARDUPILOT, AUTOPILOT_INVALID, PX4 = 3, 8, 12
"""Numbers of MAV_AUTOPILOT; ground stations and other components send the invalid one."""
AIRFRAME, WITH_ROLL_LOOP, LOOP_UNKNOWN = "airframe", "with_roll_loop", "unknown"
"""The ``loop`` of an answer: by whose hand the surfaces moved, the sticks' or the autopilot's."""
AUTOPILOT_NAMES = {0: "generic", ARDUPILOT: "ArduPilot", PX4: "PX4"}
AIRSPEED_GIVEN: Final[Mapping[tuple[str, str | int], Kind]] = {
    ("VFR_HUD", ARDUPILOT): Kind.EQUIVALENT,
    ("VFR_HUD", PX4): Kind.CALIBRATED,
    ("VFR_HUD", "airspeed"): Kind.INDICATED,  # MAVLink: calibrated or indicated
    ("CTUN", "As"): Kind.EQUIVALENT,
    ("ARSP", "Airspeed"): Kind.EQUIVALENT,
    ("NTUN", "Arspd"): Kind.EQUIVALENT,
    ("ULog", "calibrated_airspeed_m_s"): Kind.CALIBRATED,
    ("ULog", "equivalent_airspeed_m_s"): Kind.EQUIVALENT,
    ("ULog", "indicated_airspeed_m_s"): Kind.INDICATED,
    ("ULog", "true_airspeed_m_s"): Kind.TRUE,
}
"""The kind of airspeed that each source gives, by message and field, or by message and autopilot. A
record's column has it in its unit."""
GENERIC, FIXED_WING, GROUND_STATION = 0, 1, 6
"""Numbers of MAV_TYPE."""
TYPE_NAMES = {
    0: "generic", 1: "fixed wing", 2: "quadrotor", 3: "coaxial helicopter", 4: "helicopter",
    5: "antenna tracker", 6: "ground station", 7: "airship", 8: "balloon", 9: "rocket",
    10: "ground rover", 11: "boat", 12: "submarine", 13: "hexarotor", 14: "octorotor",
    15: "tricopter", 18: "onboard controller", 19: "VTOL duo-rotor tailsitter",
    20: "VTOL quad tailsitter", 21: "VTOL tiltrotor", 22: "VTOL fixed-rotor", 26: "gimbal",
    27: "ADS-B receiver", 29: "dodecarotor", 30: "camera", 35: "decarotor", 43: "multirotor",
}  # fmt: skip
VTOL_TYPES = range(19, 26)
"""The MAV_TYPE of vehicles that hover and also fly on wings."""
WITHOUT_RUDDER = frozenset({2, 3, 4, 10, 12, 13, 14, 15, 29, 35, 43})
"""The MAV_TYPE of helicopters, multirotors, ground rover and submarine, which turn without a
rudder."""
NOT_A_VEHICLE = frozenset({5, 6, 18, 26, 27, 30, 31, 32, 33, 34, 36, 37, 38, 39})
"""The MAV_TYPE of ground stations, radios, gimbals, cameras and other parts."""
ARMED = 128
"""The bit MAV_MODE_FLAG_SAFETY_ARMED of HEARTBEAT.base_mode."""
LANDED, IN_AIR = 1, 2
"""Numbers of MAV_LANDED_STATE. Larger ones are for taking off and landing."""
TO_WINGS, TO_ROTORS, ROTORS, WINGS = 1, 2, 3, 4
"""Numbers of MAV_VTOL_STATE: transitions, then flight on rotors and on wings. 0 is unknown."""
_PX4_MODES = {
    0: (1, 0), 1: (2, 0), 2: (3, 0), 3: (4, 4), 4: (4, 3), 5: (4, 5), 10: (5, 0),
    14: (6, 0), 15: (7, 0), 17: (4, 2), 18: (4, 6), 19: (4, 8),
}  # fmt: skip
"""PX4's main and sub mode by nav_state (px4_custom_mode.h, VehicleStatus.msg)."""
_ARDUPLANE_TYPES = (FIXED_WING, 19, 20, 21)
_ARDUPLANE_MODES = (
    "MANUAL", "CIRCLE", "STABILIZE", "TRAINING", "ACRO", "FBWA", "FBWB", "CRUISE", "AUTOTUNE", None,
    "AUTO", "RTL", "LOITER", "TAKEOFF", "AVOID_ADSB", "GUIDED", "INITIALISING", "QSTABILIZE",
    "QHOVER", "QLOITER", "QLAND", "QRTL", "QAUTOTUNE", "QACRO", "THERMAL", "LOITERALTQLAND",
    "AUTOLAND",
)  # fmt: skip
"""ArduPlane's modes by HEARTBEAT.custom_mode (ArduPlane/mode.h), with mavutil's names."""
ARDUPLANE_HOVER = range(17, 24)
"""The HEARTBEAT.custom_mode of ArduPlane's modes that hover, QSTABILIZE to QACRO."""


def type_name(number: int) -> str:
    """Return a MAV_TYPE in words."""
    return TYPE_NAMES.get(number, f"type {number}")


def autopilot_name(number: int) -> str:
    """Return a MAV_AUTOPILOT in words."""
    return AUTOPILOT_NAMES.get(number, f"autopilot {number}")


@lru_cache(maxsize=1024)  # a hostile link may name any mode
def mode_name(autopilot: int, vehicle_type: int, custom_mode: int) -> str:
    """Return the name of HEARTBEAT.custom_mode, ``mode N`` for one without a name.

    ``autopilot`` and ``vehicle_type`` are HEARTBEAT's numbers (MAV_AUTOPILOT, MAV_TYPE).
    """
    is_plane = autopilot == ARDUPILOT and vehicle_type in _ARDUPLANE_TYPES
    if is_plane and custom_mode in range(len(_ARDUPLANE_MODES)):
        return _ARDUPLANE_MODES[custom_mode] or f"mode {custom_mode}"
    # Importing mavutil changes the environment and takes a third as long as NumPy, so it is done
    # only for other vehicles.
    from pymavlink import mavutil

    name = None
    if autopilot == ARDUPILOT:
        name = (mavutil.mode_mapping_bynumber(vehicle_type) or {}).get(custom_mode)
    elif autopilot == PX4:
        reported = mavutil.interpret_px4_mode(0, custom_mode)
        name = None if reported == "UNKNOWN" else reported
    return name or f"mode {custom_mode}"


def px4_custom_modes(nav_state: Array) -> Ints:
    """Return the HEARTBEAT.custom_mode (n,) that PX4 sends for nav_state (n,) of its own logs.

    A state without a mode of its own keeps its number.
    """
    modes = np.arange(256)
    for state, (main, sub) in _PX4_MODES.items():
        modes[state] = main << 16 | sub << 24
    return modes[nav_state.astype(np.uint8)]
