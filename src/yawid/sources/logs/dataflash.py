"""ArduPilot's on-board log (.bin) as the MAVLink messages that the channels read.

| message of the log | becomes |
|---|---|
| RCOU | SERVO_OUTPUT_RAW, up to output 14 |
| RCIN | RC_CHANNELS |
| PARM | PARAM_VALUE |
| MODE, ARM | HEARTBEAT |
| CTUN or ARSP, GPS, POS | VFR_HUD |
| STAT | EXTENDED_SYS_STATE |
| RATE or IMU, ATT | ATTITUDE |
| IMU | ACCELERATION, the lateral one |

ATTITUDE has a row for each row of RATE or IMU, with their body rates and with the angles of ATT,
which are interpolated between two of its rows. ArduPlane writes RATE only in VTOL modes. IMU is the
first gyro as calibrated; unlike RATE it still has its slow drift. Without both there is no yaw
rate.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import Array, Floats, FrameBlock, Ints, MessageBlock
from yawid.quantities.link import LinkStats
from yawid.quantities.vehicles import AIRSPEED_GIVEN, ARDUPILOT, ARMED, IN_AIR, LANDED
from yawid.sources.logs.as_mavlink import (
    COMPID,
    DTYPES,
    FIX_3D,
    NONE,
    PlacedFields,
    angles_at,
    frame_block,
    hold_last,
    merged,
    message,
    table,
    within,
)
from yawid.sources.logs.dataflash_index import DataflashIndex
from yawid.sources.logs.tlog import CHUNK

_RATES = {"RATE": ("R", "P", "Y"), "IMU": ("GyrX", "GyrY", "GyrZ")}
_TIMED = ("ATT", "RCOU", "RCIN", *_RATES, "GPS", "CTUN", "ARSP", "NTUN", "POS", "STAT")
_ENOUGH = 0.9
"""RATE is read if it covers at least this share of the seconds that IMU covers."""
_UNTIMED = ("PARM", "MODE", "ARM", "EV", "MSG", "VER", "DSF")
"""The messages that are read without regard to their times."""
_TYPE_OF_BUILD = {1: 10, 2: 2, 3: 1, 4: 5, 7: 12, 12: 7, 13: 4}  # VER.BU -> MAV_TYPE
_TYPE_OF_NAME = {b"Plane": 1, b"Copter": 2, b"Rover": 10, b"Sub": 12, b"Tracker": 5, b"Blimp": 7}
_AIRSPEED = (("CTUN", "As"), ("ARSP", "Airspeed"), ("NTUN", "Arspd"))  # best first
_ALTITUDE = (("POS", "Alt"), ("GPS", "Alt"))
_SYSID = (b"MAV_SYSID", b"SYSID_THISMAV")
_EV_ARMED, _EV_DISARMED = 10, 11
_GPS_EPOCH_S = 315_964_800  # 1980-01-06 in Unix time
_LEAP_S = 18  # GPS minus UTC since 2017


class DataflashReader:
    """A dataflash log; the module's docstring lists the messages made from it.

    Messages come in the order of the file. The vehicle's state when the log began comes first: its
    type, its mode and the first value of every parameter. ``received_us`` is Unix time from GPS,
    with the receiver's delay (0.1 to 0.3 s) and the 18 leap seconds since 2017; without a 3D fix it
    is the boot time.

    Raises:
        SourceError: the file cannot be read, or holds no message.
    """

    vehicle_id = None

    def __init__(self, path: Path) -> None:
        self._index = index = DataflashIndex(path, (*_TIMED, *_UNTIMED))
        index.keep_timed(_TIMED)
        for name in ("IMU", "GPS", "ARSP"):
            self._keep_one_instance(name)
        self._unix_us = _unix_minus_boot_us(index)
        self._rates = self._rate_source()
        (_, first), (changed, values) = _parameters(index)
        self._sysid = _system_id(first)
        self._shift = len(first) + 1
        order = np.arange(1, self._shift)
        self._first = self._placed("PARAM_VALUE", order - self._shift, first)
        beats, states = _heartbeats(index)
        self._context = [
            # The state before the log's first byte gets the place at which order becomes 0.
            self._placed("HEARTBEAT", np.where(beats < 0, -self._shift, beats), states),
            self._placed("VFR_HUD", *_hud(index)),
            self._placed("EXTENDED_SYS_STATE", *_system_state(index)),
            self._placed("PARAM_VALUE", changed, values),
        ]

    @property
    def link(self) -> LinkStats:
        """The counts of the whole log: messages believed, other bytes, messages it lost itself."""
        index = self._index
        lost = int(index.found("DSF", "Dp")[1]["Dp"].max(initial=0))
        ends = [index.times(n, index.offsets[n][[0, -1]]) for n in _TIMED if index.has(n)]
        known = np.concatenate(ends) + self._unix_us if ends else None
        return LinkStats(
            frames=index.messages,
            skipped_bytes=len(index.data) - index.message_bytes,
            lost=lost,
            first_us=None if known is None else int(known.min()),
            last_us=None if known is None else int(known.max()),
            senders={(self._sysid, COMPID): index.messages},
        )

    def read(self) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, their messages) from the start."""
        size = len(self._index.data)
        opening = [within(block, 0, self._shift) for block in self._context]
        yield 0, frame_block([opening[0], self._first])
        for low in range(0, size, CHUNK):
            high = min(low + CHUNK, size)
            edges = low + self._shift, high + self._shift
            context = [within(block, *edges) for block in self._context]
            yield high - low, frame_block([*context, *self._flying(low, high)])

    def _flying(self, low: int, high: int) -> Iterator[MessageBlock]:
        """Yield the messages with high rates from the bytes [low, high)."""
        if len(offsets := self._between("RCOU", low, high)):
            yield self._outputs("SERVO_OUTPUT_RAW", "servo", "RCOU", offsets)
        if len(offsets := self._between("RCIN", low, high)):
            yield self._outputs("RC_CHANNELS", "chan", "RCIN", offsets)
        if len(offsets := self._between(self._rates, low, high)):
            yield self._attitude(offsets, low, high)
        if self._index.has("IMU", "AccY"):
            yield self._acceleration(self._between("IMU", low, high))

    def _between(self, name: str, low: int, high: int, more: int = 0) -> Ints:
        """Return where messages of this name start in [low, high), plus ``more`` on each side."""
        offsets = self._index.offsets.get(name, NONE)
        first, stop = np.searchsorted(offsets, (low, high))
        return offsets[max(first - more, 0) : stop + more]

    def _placed(
        self, name: str, offsets: Ints, fields: Array, t_us: Ints | int = 0
    ) -> MessageBlock:
        received = np.full(len(offsets), t_us + self._unix_us)
        return message(name, offsets + self._shift, received, fields, self._sysid)

    def _timed(self, name: str, log: str, offsets: Ints, **columns: Any) -> MessageBlock:
        t_us = self._index.times(log, offsets)
        fields = table(name, len(offsets), time_usec=t_us, **columns)
        return self._placed(name, offsets, fields, t_us)

    def _outputs(self, name: str, prefix: str, log: str, offsets: Ints) -> MessageBlock:
        rows = self._index.rows(log, offsets)
        # The columns are C1 to C14; in older logs Ch1 or Chan1.
        fields = {f"{prefix}{c.lstrip('Chan')}_raw": rows[c] for c in rows.dtype.names or ()}
        columns = {field: fields[field] for field in DTYPES[name].names or () if field in fields}
        return self._timed(name, log, offsets, **columns)

    def _attitude(self, offsets: Ints, low: int, high: int) -> MessageBlock:
        index, log = self._index, self._rates
        rows = index.rows(log, offsets)
        p, q, r = (index.si(log, rows, name) for name in _RATES[log])
        angles = self._angles(index.times(log, offsets), low, high)
        rates = {"rollspeed": p, "pitchspeed": q, "yawspeed": r}
        return self._timed("ATTITUDE", log, offsets, **rates, **angles)

    def _acceleration(self, offsets: Ints) -> MessageBlock:
        lateral = self._index.si("IMU", self._index.rows("IMU", offsets), "AccY")
        made = self._timed("ACCELERATION", "IMU", offsets, yacc=lateral)
        return replace(made, order=made.order + 1)  # after the ATTITUDE of the same row

    def _angles(self, t_us: Ints, low: int, high: int) -> dict[str, Any]:
        index = self._index
        if not index.has("ATT", "Roll", "Pitch", "Yaw"):
            return dict.fromkeys(("roll", "pitch", "yaw"), np.nan)
        offsets = self._between("ATT", low, high, more=2)
        rows = index.rows("ATT", offsets)
        roll, pitch, yaw = (index.si("ATT", rows, name) for name in ("Roll", "Pitch", "Yaw"))
        return angles_at(t_us, index.times("ATT", offsets), roll, pitch, yaw)

    def _rate_source(self) -> str:
        """Return RATE, or IMU where that covers more of the flight, or "" without either."""
        index = self._index
        times = {
            name: index.times(name, index.offsets[name])
            for name, columns in _RATES.items()
            if index.has(name, *columns)
        }
        seconds = {name: len(np.unique(times.get(name, NONE) // 1_000_000)) for name in _RATES}
        if not any(seconds.values()):
            return ""
        return "RATE" if seconds["RATE"] >= _ENOUGH * seconds["IMU"] else "IMU"

    def _keep_one_instance(self, name: str) -> None:
        """Keep only the first of several sensors, or the one that is reported as primary."""
        if not self._index.has(name, "I"):
            return
        offsets, rows = self._index.reported(name)
        primary = rows["Pri"] if "Pri" in (rows.dtype.names or ()) else rows["I"].min()
        self._index.offsets[name] = offsets[rows["I"] == primary]


def _unix_minus_boot_us(index: DataflashIndex) -> int:
    """Return Unix time minus boot time in us from GPS, 0 without a 3D fix."""
    offsets, rows = index.found("GPS", "Status", "GWk", "GMS")
    fixed = (rows["Status"] >= FIX_3D) & (rows["GWk"] > 0)
    if not fixed.any():
        return 0
    ms = rows["GWk"].astype(np.int64) * 604_800_000 + rows["GMS"]
    unix_us = 1000 * ms + 1_000_000 * (_GPS_EPOCH_S - _LEAP_S)
    return int(np.median((unix_us - index.times("GPS", offsets))[fixed]))


def _parameters(index: DataflashIndex) -> tuple[PlacedFields, PlacedFields]:
    """Return the first value of every parameter, and all values reported after those.

    A log has its parameters within the first seconds; they apply from its beginning.
    """
    offsets, rows = index.found("PARM", "Name", "Value")
    fields = table("PARAM_VALUE", len(rows), param_id=rows["Name"], param_value=rows["Value"])
    first = np.zeros(len(rows), bool)
    first[np.unique(rows["Name"], return_index=True)[1]] = True
    return (offsets[first], fields[first]), (offsets[~first], fields[~first])


def _system_id(first: Array) -> int:
    """Return the system id from the PARAM_VALUE rows ``first`` (n,), 1 if it is missing."""
    reported = (first["param_value"][first["param_id"] == name] for name in _SYSID)
    return next((int(values[0]) for values in reported if len(values) and 1 <= values[0] <= 255), 1)


def _heartbeats(index: DataflashIndex) -> PlacedFields:
    """Return a HEARTBEAT for the state at the start, at byte -1, then one for every change."""
    column = "ModeNum" if index.has("MODE", "ModeNum") else "Mode"
    modes, rows = index.found("MODE", column)
    mode = np.asarray(rows[column], float)
    arms, armed = _arming(index)
    # A log without another report begins with arming (LOG_DISARMED is 0).
    opening = (mode[0] if len(mode) else 0.0, 1.0 - armed[0] if len(armed) else 1.0)
    offsets, (mode, armed) = hold_last(opening, (modes, mode), (arms, armed))
    base_mode = np.where(armed > 0.0, ARMED, 0)
    named = {"type": _vehicle_type(index), "autopilot": ARDUPILOT}
    fields = table("HEARTBEAT", len(offsets), base_mode=base_mode, custom_mode=mode, **named)
    return offsets, fields


def _arming(index: DataflashIndex) -> tuple[Ints, Floats]:
    """Return where the vehicle was armed (1) or disarmed (0)."""
    if index.has("ARM", "ArmState"):
        offsets, rows = index.reported("ARM")
        return offsets, np.asarray(rows["ArmState"] != 0, float)
    offsets, rows = index.found("EV", "Id")
    reported = np.isin(rows["Id"], (_EV_ARMED, _EV_DISARMED))
    return offsets[reported], np.asarray(rows["Id"][reported] == _EV_ARMED, float)


def _hud(index: DataflashIndex) -> PlacedFields:
    """Return a VFR_HUD at each place at which one of its columns is reported, the others held."""
    air, height = _first_of(index, _AIRSPEED), _first_of(index, _ALTITUDE)
    kind = next((AIRSPEED_GIVEN[each] for each in _AIRSPEED if index.has(*each)), np.nan)
    offsets, rows = index.found("GPS", "Spd", "Status")
    fixed = rows["Status"] >= FIX_3D
    ground = offsets, np.where(fixed, index.si("GPS", rows, "Spd"), np.nan)
    columns = {"airspeed": air, "groundspeed": ground, "alt": height}
    return merged("VFR_HUD", np.nan, {"airspeed_kind": kind}, **columns)


def _first_of(index: DataflashIndex, wanted: tuple[tuple[str, str], ...]) -> tuple[Ints, Floats]:
    """Return the first of these columns that the log has, and where it is reported."""
    name, column = next((each for each in wanted if index.has(*each)), wanted[0])
    offsets, rows = index.found(name, column)
    return offsets, index.si(name, rows, column)


def _system_state(index: DataflashIndex) -> PlacedFields:
    """Return an EXTENDED_SYS_STATE for each report of ArduPlane whether it is flying."""
    offsets, rows = index.found("STAT", "isFlying")
    landed = np.where(rows["isFlying"] != 0, IN_AIR, LANDED)
    return offsets, table("EXTENDED_SYS_STATE", len(offsets), landed_state=landed)


def _vehicle_type(index: DataflashIndex) -> int:
    """Return the MAV_TYPE by the build or the firmware's name, 0 (generic) without either."""
    builds = index.found("VER", "BU")[1]["BU"][:1].tolist()
    texts = index.found("MSG", "Message")[1]["Message"].tolist()
    by_build = [_TYPE_OF_BUILD[each] for each in builds if each in _TYPE_OF_BUILD]
    by_name = (kind for text in texts for name, kind in _TYPE_OF_NAME.items() if name in text)
    return next(chain(by_build, by_name), 0)
