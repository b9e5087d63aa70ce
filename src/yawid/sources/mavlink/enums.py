"""Numbers of MAVLink's enums (common.xml) that are known by name, each once."""

ARDUPILOT, AUTOPILOT_INVALID, PX4 = 3, 8, 12
"""MAV_AUTOPILOT; invalid is what ground stations and other components send."""
GENERIC, FIXED_WING, GROUND_STATION = 0, 1, 6
"""MAV_TYPE."""
VTOL_TYPES = range(19, 26)
"""MAV_TYPE of what hovers and flies on wings."""
ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED in HEARTBEAT.base_mode."""
LANDED, IN_AIR = 1, 2
"""MAV_LANDED_STATE: on the ground, in the air. Larger ones are taking off and landing."""
TO_WINGS, TO_ROTORS, ROTORS, WINGS = 1, 2, 3, 4
"""MAV_VTOL_STATE: between, and on the one or the other. 0 says nothing."""
