"""The channels: MAVLink messages in, samples of rudder and yaw rate on one uniform grid out."""
