"""The names of flight modes."""

from __future__ import annotations

from pymavlink import mavutil

from yawid.quantities.vehicles import ARDUPILOT, mode_name


def test_arduplanes_modes_are_called_as_pymavlink_calls_them() -> None:
    for vehicle_type in range(46):
        names = mavutil.mode_mapping_bynumber(vehicle_type) or {}
        for mode in range(-1, 40):
            expected = names.get(mode, f"mode {mode}")
            assert mode_name(ARDUPILOT, vehicle_type, mode) == expected
