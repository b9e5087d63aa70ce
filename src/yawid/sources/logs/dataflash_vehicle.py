"""What a dataflash log says of the vehicle beside its flying: type, mode, speeds, parameters.

Everything is returned as the bytes at which it is reported and the fields of the MAVLink message it
becomes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats, Ints
from yawid.sources.logs.as_mavlink import PlacedFields, hold_last, merged, table
from yawid.sources.logs.dataflash_index import DataflashIndex
from yawid.sources.mavlink.enums import ARDUPILOT, ARMED, IN_AIR, LANDED

NAMES = ("PARM", "MODE", "ARM", "EV", "MSG", "VER")
"""The log's messages read here, beside those with a time that counts."""
TIMED_NAMES = ("GPS", "CTUN", "ARSP", "NTUN", "POS", "STAT")
_TYPE_OF_BUILD = {1: 10, 2: 2, 3: 1, 4: 5, 7: 12, 12: 7, 13: 4}  # VER.BU -> MAV_TYPE
_TYPE_OF_NAME = {b"Plane": 1, b"Copter": 2, b"Rover": 10, b"Sub": 12, b"Tracker": 5, b"Blimp": 7}
_AIRSPEED = (("CTUN", "As"), ("ARSP", "Airspeed"), ("NTUN", "Arspd"))  # best first
_ALTITUDE = (("POS", "Alt"), ("GPS", "Alt"))
_SYSID = (b"MAV_SYSID", b"SYSID_THISMAV")
_EV_ARMED, _EV_DISARMED = 10, 11
_GPS_EPOCH_S = 315_964_800  # 1980-01-06 in Unix time
_LEAP_S = 18  # GPS minus UTC since 2017
_FIX_3D = 3
_NONE = np.zeros(0, np.int64)


def unix_minus_boot_us(index: DataflashIndex) -> int:
    """Return Unix minus boot time in microseconds by GPS, 0 without a 3D fix."""
    if not index.has("GPS", "Status", "GWk", "GMS"):
        return 0
    offsets = index.offsets["GPS"]
    rows = index.rows("GPS", offsets)
    fixed = (rows["Status"] >= _FIX_3D) & (rows["GWk"] > 0)
    if not fixed.any():
        return 0
    ms = rows["GWk"].astype(np.int64) * 604_800_000 + rows["GMS"]
    unix_us = 1000 * ms + 1_000_000 * (_GPS_EPOCH_S - _LEAP_S)
    return int(np.median((unix_us - index.times("GPS", offsets))[fixed]))


def parameters(index: DataflashIndex) -> tuple[PlacedFields, PlacedFields]:
    """Return the first value of every parameter, and all values reported after those.

    A log writes its parameters down within the first seconds; they held from its beginning.
    """
    if not index.has("PARM", "Name", "Value"):
        nothing = _NONE, table("PARAM_VALUE", 0)
        return nothing, nothing
    offsets = index.offsets["PARM"]
    rows = index.rows("PARM", offsets)
    fields = table("PARAM_VALUE", len(rows), param_id=rows["Name"], param_value=rows["Value"])
    first = np.zeros(len(rows), bool)
    first[np.unique(rows["Name"], return_index=True)[1]] = True
    return (offsets[first], fields[first]), (offsets[~first], fields[~first])


def system_id(first: NDArray[Any]) -> int:
    """Return the system id by the PARAM_VALUE rows ``first`` (n,), 1 unless it is there."""
    for name in _SYSID:
        reported = first["param_value"][first["param_id"] == name]
        if len(reported) and 1 <= reported[0] <= 255:
            return int(reported[0])
    return 1


def heartbeats(index: DataflashIndex) -> PlacedFields:
    """Return a HEARTBEAT for what held at the start, at byte -1, then one for every change."""
    modes, mode = _NONE, np.zeros(0)
    column = "ModeNum" if index.has("MODE", "ModeNum") else "Mode"
    if index.has("MODE", column):
        modes = index.offsets["MODE"]
        mode = np.asarray(index.rows("MODE", modes)[column], float)
    arms, armed = _arming(index)
    # Unless it says otherwise a log begins with arming (LOG_DISARMED is 0).
    opening = (mode[0] if len(mode) else 0.0, 1.0 - armed[0] if len(armed) else 1.0)
    offsets, (mode, armed) = hold_last(opening, (modes, mode), (arms, armed))
    base_mode = np.where(armed > 0.0, ARMED, 0)
    named = {"type": _vehicle_type(index), "autopilot": ARDUPILOT}
    fields = table("HEARTBEAT", len(offsets), base_mode=base_mode, custom_mode=mode, **named)
    return offsets, fields


def _arming(index: DataflashIndex) -> tuple[Ints, Floats]:
    """Return where the vehicle was armed (1) or disarmed (0)."""
    if index.has("ARM", "ArmState"):
        offsets = index.offsets["ARM"]
        return offsets, np.asarray(index.rows("ARM", offsets)["ArmState"] != 0, float)
    if index.has("EV", "Id"):
        offsets = index.offsets["EV"]
        events = index.rows("EV", offsets)["Id"]
        reported = np.isin(events, (_EV_ARMED, _EV_DISARMED))
        return offsets[reported], np.asarray(events[reported] == _EV_ARMED, float)
    return _NONE, np.zeros(0)


def hud(index: DataflashIndex) -> PlacedFields:
    """Return a VFR_HUD wherever one of its columns is reported, the others held."""
    air, height = _first_of(index, _AIRSPEED), _first_of(index, _ALTITUDE)
    ground: tuple[Ints, Floats] = _NONE, np.zeros(0)
    if index.has("GPS", "Spd", "Status"):
        offsets = index.offsets["GPS"]
        rows = index.rows("GPS", offsets)
        is_fixed = rows["Status"] >= _FIX_3D
        ground = offsets, np.where(is_fixed, index.si("GPS", rows, "Spd"), np.nan)
    return merged("VFR_HUD", np.nan, airspeed=air, groundspeed=ground, alt=height)


def _first_of(index: DataflashIndex, wanted: tuple[tuple[str, str], ...]) -> tuple[Ints, Floats]:
    """Return the first of these columns that the log has, and where it is reported."""
    for name, column in wanted:
        if index.has(name, column):
            offsets = index.offsets[name]
            return offsets, index.si(name, index.rows(name, offsets), column)
    return _NONE, np.zeros(0)


def system_state(index: DataflashIndex) -> PlacedFields:
    """Return an EXTENDED_SYS_STATE for each time that ArduPlane says whether it believes to fly."""
    if not index.has("STAT", "isFlying"):
        return _NONE, table("EXTENDED_SYS_STATE", 0)
    offsets = index.offsets["STAT"]
    flies = index.rows("STAT", offsets)["isFlying"] != 0
    landed = np.where(flies, IN_AIR, LANDED)
    return offsets, table("EXTENDED_SYS_STATE", len(offsets), landed_state=landed)


def _vehicle_type(index: DataflashIndex) -> int:
    """Return the MAV_TYPE by the build or the firmware's name, 0 (generic) where both lack."""
    if index.has("VER", "BU"):
        build = int(index.rows("VER", index.offsets["VER"])["BU"][0])
        if build in _TYPE_OF_BUILD:
            return _TYPE_OF_BUILD[build]
    if index.has("MSG", "Message"):
        for text in index.rows("MSG", index.offsets["MSG"])["Message"].tolist():
            for name, kind in _TYPE_OF_NAME.items():
                if name in text:
                    return kind
    return 0
