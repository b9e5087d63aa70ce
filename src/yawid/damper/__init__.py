"""Which gain of the autopilot's yaw damper gives which damping, from the identified aircraft."""
