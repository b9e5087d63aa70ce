"""What a ULog says of flying: landed or not, and of a VTOL on its wings or on its rotors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.sources.logs.as_mavlink import PlacedFields, merged
from yawid.sources.logs.ulog_file import UlogTopic, published
from yawid.sources.mavlink.enums import IN_AIR, LANDED, ROTORS, TO_ROTORS, TO_WINGS, WINGS

TOPICS = ("vehicle_land_detected", "vtol_vehicle_status")
_ROTARY_WING = 1  # vehicle_status.vehicle_type
_NOTHING = np.zeros(0, np.int64), np.zeros(0)


def system_state(topics: Mapping[tuple[str, int], UlogTopic]) -> PlacedFields:
    """Return an EXTENDED_SYS_STATE wherever one of its columns is reported, the others one held."""
    land = topics.get(("vehicle_land_detected", 0), {})
    landed = _NOTHING
    if "landed" in land:
        landed = published(land), np.where(land["landed"] != 0, LANDED, IN_AIR).astype(float)
    return merged("EXTENDED_SYS_STATE", 0.0, landed_state=landed, vtol_state=_vtol(topics))


def _vtol(topics: Mapping[tuple[str, int], UlogTopic]) -> tuple[Ints, Floats]:
    """Return the state of a VTOL as its own status says it, else as the vehicle's type then."""
    own = topics.get(("vtol_vehicle_status", 0), {})
    if "vehicle_vtol_state" in own:
        return published(own), own["vehicle_vtol_state"].astype(float)
    if {"vtol_in_rw_mode", "vtol_in_trans_mode", "in_transition_to_fw"} <= own.keys():
        steady = np.where(own["vtol_in_rw_mode"] != 0, ROTORS, WINGS)
        turning = np.where(own["in_transition_to_fw"] != 0, TO_WINGS, TO_ROTORS)
        state = np.where(own["vtol_in_trans_mode"] != 0, turning, steady)
        return published(own), state.astype(float)
    status = topics.get(("vehicle_status", 0), {})
    if {"is_vtol", "vehicle_type"} <= status.keys() and status["is_vtol"].any():
        on_rotors = status["vehicle_type"] == _ROTARY_WING
        return published(status), np.where(on_rotors, ROTORS, WINGS).astype(float)
    return _NOTHING
