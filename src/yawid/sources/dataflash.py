"""ArduPilot's on-board log (.bin) as the MAVLink messages that the channels read.

RCOU becomes SERVO_OUTPUT_RAW, PARM PARAM_VALUE, MODE and ARM HEARTBEAT, CTUN or ARSP and GPS
VFR_HUD. ATTITUDE has the body's rates from RATE or IMU, a row for each of theirs, and the angles
of ATT between two of its rows. ArduPlane writes RATE only in VTOL modes; IMU is the first gyro as
calibrated, its slow drift not taken out as RATE's and ATTITUDE's is: the bias is the model's. With
neither the heading of ATT stands in, coarse, as GLOBAL_POSITION_INT. Outputs 15 and up are not
read.

What the vehicle was when the log began is told first: its type, mode and every parameter's first
value, though the log writes them down within its first seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from yawid.blocks import Floats, FrameBlock, Ints, MessageBlock
from yawid.sources.columns import ARMED, DTYPES, angles_at, counts, frames, latest, table, within
from yawid.sources.columns import message as message_block
from yawid.sources.dataflash_index import DataflashIndex
from yawid.sources.link import LinkStats
from yawid.sources.tlog import CHUNK, Digest

ARDUPILOT = 3  # MAV_AUTOPILOT
_TYPE_OF_BUILD = {1: 10, 2: 2, 3: 1, 4: 5, 7: 12, 12: 7, 13: 4}  # VER.BU -> MAV_TYPE
_TYPE_OF_NAME = {"Plane": 1, "Copter": 2, "Rover": 10, "Sub": 12, "Tracker": 5, "Blimp": 7}
_AIRSPEED = (("CTUN", "As"), ("ARSP", "Airspeed"), ("NTUN", "Arspd"))  # best first
_SYSID = ("MAV_SYSID", "SYSID_THISMAV")
_EV_ARMED, _EV_DISARMED = 10, 11
_GPS_EPOCH_S = 315_964_800  # 1980-01-06 in Unix time
_LEAP_S = 18  # GPS minus UTC since 2017
_FIX_3D = 3
_ENOUGH = 0.9  # RATE must cover this share of the seconds IMU covers
_TIMED = ("ATT", "RATE", "IMU", "RCOU", "RCIN", "GPS", "CTUN", "ARSP", "NTUN")
_OTHERS = ("PARM", "MODE", "ARM", "EV", "MSG", "VER", "DSF")
_NONE = np.zeros(0, np.int64)


class DataflashReader:
    """A dataflash log; see the module for what is made of it.

    Messages follow each other as in the file. ``received_us`` is Unix time by the median of GPS
    week and milliseconds against the boot time, as late as the receiver tells them (0.1 to 0.3 s)
    and by the 18 leap seconds of 2017; without a 3D fix it is the boot time.

    Raises:
        SourceError: the file cannot be read, or holds no message.
    """

    def __init__(self, path: Path) -> None:
        self._index = index = DataflashIndex(path, _TIMED + _OTHERS)
        index.keep_timed(_TIMED)
        for name in ("IMU", "GPS", "ARSP"):
            self._keep_one_instance(name)
        self._unix_us = self._boot_to_unix()
        self._rates = self._rate_source()
        changed = self._parameters()
        self._shift = len(self._first.fields) + 1
        self._context = [self._heartbeats(), self._speeds(), changed]
        self._opening = [self._context[0].select(slice(0, 1)), self._first]

    @property
    def link(self) -> LinkStats:
        """Counts of the whole log: messages believed, bytes in none, messages it dropped itself."""
        index = self._index
        lost = 0
        if index.has("DSF", "Dp"):
            lost = int(index.rows("DSF", index.offsets["DSF"])["Dp"].max())
        times = [index.times(n, index.offsets[n][[0, -1]]) for n in _TIMED if index.has(n)]
        known = np.concatenate(times) + self._unix_us if times else None
        return counts(
            frames=index.messages,
            skipped_bytes=len(index.data) - index.message_bytes,
            lost=lost,
            first_us=None if known is None else int(known.min()),
            last_us=None if known is None else int(known.max()),
            senders={(self._sysid, 1): index.messages},
        )

    def read(self, digest: Digest | None = None) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they hold) from the start, continuing ``digest``."""
        data = self._index.data
        yield 0, frames(self._opening)
        for low in range(0, len(data), CHUNK):
            chunk = data[low : low + CHUNK]
            if digest is not None:
                digest.update(chunk)
            high = low + len(chunk)
            shifted = low + self._shift, high + self._shift
            held = [within(block, *shifted) for block in self._context]
            yield len(chunk), frames([*held, *self._flying(low, high)])

    def _flying(self, low: int, high: int) -> Iterator[MessageBlock]:
        """Yield what is logged at speed, of the bytes [low, high)."""
        yield self._outputs("RCOU", "SERVO_OUTPUT_RAW", "servo", low, high)
        yield self._outputs("RCIN", "RC_CHANNELS", "chan", low, high)
        yield self._attitude(low, high) if self._rates else self._heading(low, high)

    def _between(self, name: str, low: int, high: int, more: int = 0) -> Ints:
        """Return where messages of this name start in [low, high), and ``more`` on both sides."""
        offsets = self._index.offsets.get(name, _NONE)
        first, stop = np.searchsorted(offsets, (low, high))
        return offsets[max(first - more, 0) : stop + more]

    def _message(self, name: str, log: str, offsets: Ints, **columns: object) -> MessageBlock:
        t_us = self._index.times(log, offsets)
        if "time_usec" in (DTYPES[name].names or ()):
            columns["time_usec"] = t_us
        fields = table(name, len(offsets), **columns)
        received = t_us + self._unix_us
        return message_block(name, offsets + self._shift, received, fields, self._sysid)

    def _outputs(self, log: str, name: str, prefix: str, low: int, high: int) -> MessageBlock:
        index, offsets = self._index, self._between(log, low, high)
        columns: dict[str, object] = {}
        if len(offsets):
            rows = index.rows(log, offsets)
            for column in rows.dtype.names or ():
                number = column.lstrip("Chan")
                field = f"{prefix}{number}_raw"
                if number.isdecimal() and field in (DTYPES[name].names or ()):
                    columns[field] = rows[column]
            return self._message(name, log, offsets, **columns)
        return message_block(name, _NONE, _NONE, table(name, 0), self._sysid)

    def _attitude(self, low: int, high: int) -> MessageBlock:
        index, log = self._index, self._rates
        offsets = self._between(log, low, high)
        rows = index.rows(log, offsets)
        names = ("R", "P", "Y") if log == "RATE" else ("GyrX", "GyrY", "GyrZ")
        p, q, r = (index.si(log, rows, name) for name in names)
        roll, pitch, yaw = self._angles(index.times(log, offsets), low, high)
        angles = {"roll": roll, "pitch": pitch, "yaw": yaw}
        rates = {"rollspeed": p, "pitchspeed": q, "yawspeed": r}
        return self._message("ATTITUDE", log, offsets, **angles, **rates)

    def _angles(self, t_us: Ints, low: int, high: int) -> Floats:
        index = self._index
        if not index.has("ATT", "Roll", "Pitch", "Yaw"):
            return np.full((3, len(t_us)), np.nan)
        offsets = self._between("ATT", low, high, more=2)
        rows = index.rows("ATT", offsets)
        roll, pitch, yaw = (index.si("ATT", rows, name) for name in ("Roll", "Pitch", "Yaw"))
        return angles_at(t_us, index.times("ATT", offsets), roll, pitch, yaw)

    def _heading(self, low: int, high: int) -> MessageBlock:
        name, offsets = "GLOBAL_POSITION_INT", self._between("ATT", low, high)
        if len(offsets) == 0 or not self._index.has("ATT", "Yaw"):
            return message_block(name, _NONE, _NONE, table(name, 0), self._sysid)
        rows = self._index.rows("ATT", offsets)
        degrees = np.rad2deg(self._index.si("ATT", rows, "Yaw")) % 360.0
        return self._message(name, "ATT", offsets, hdg=100.0 * degrees)

    def _rate_source(self) -> str:
        """Return RATE, or IMU where that covers more of the flight, or nothing."""
        seconds = {"RATE": 0, "IMU": 0}
        for name, column in (("RATE", "Y"), ("IMU", "GyrZ")):
            if self._index.has(name, column):
                t_us = self._index.times(name, self._index.offsets[name])
                seconds[name] = len(np.unique(t_us // 1_000_000))
        if not any(seconds.values()):
            return ""
        return "RATE" if seconds["RATE"] >= _ENOUGH * seconds["IMU"] else "IMU"

    def _keep_one_instance(self, name: str) -> None:
        """Of several sensors keep the first; of airspeed sensors the one told to be primary."""
        if not self._index.has(name, "I"):
            return
        offsets = self._index.offsets[name]
        rows = self._index.rows(name, offsets)
        primary = rows["Pri"] if "Pri" in (rows.dtype.names or ()) else rows["I"].min()
        self._index.offsets[name] = offsets[rows["I"] == primary]

    def _boot_to_unix(self) -> int:
        """Return Unix minus boot time in microseconds, 0 where the log does not know it."""
        if not self._index.has("GPS", "Status", "GWk", "GMS"):
            return 0
        offsets = self._index.offsets["GPS"]
        rows = self._index.rows("GPS", offsets)
        fixed = (rows["Status"] >= _FIX_3D) & (rows["GWk"] > 0)
        if not fixed.any():
            return 0
        ms = rows["GWk"].astype(np.int64) * 604_800_000 + rows["GMS"]
        unix_us = 1000 * ms + 1_000_000 * (_GPS_EPOCH_S - _LEAP_S)
        return int(np.median((unix_us - self._index.times("GPS", offsets))[fixed]))

    def _parameters(self) -> MessageBlock:
        """Note each parameter's first value as the opening's; return the changes after it."""
        index, offsets = self._index, self._index.offsets.get("PARM", _NONE)
        self._sysid = 1
        if not index.has("PARM", "TimeUS", "Name", "Value"):
            self._first = message_block("PARAM_VALUE", _NONE, _NONE, table("PARAM_VALUE", 0), 1)
            return self._first
        rows = index.rows("PARM", offsets)
        _, first = np.unique(rows["Name"], return_index=True)
        first.sort()
        for name in _SYSID:
            told = rows["Value"][rows["Name"] == name.encode()]
            if len(told) and 1 <= told[0] <= 255:
                self._sysid = int(told[0])
        later = np.setdiff1d(np.arange(len(rows)), first)
        self._shift = len(first) + 1
        t_us = index.times("PARM", offsets) + self._unix_us
        fields = table("PARAM_VALUE", len(rows), param_id=rows["Name"], param_value=rows["Value"])
        order = np.arange(1, len(first) + 1)
        self._first = message_block("PARAM_VALUE", order, t_us[first], fields[first], self._sysid)
        order = offsets[later] + self._shift
        return message_block("PARAM_VALUE", order, t_us[later], fields[later], self._sysid)

    def _heartbeats(self) -> MessageBlock:
        """Return a HEARTBEAT for what held at the start, then one for every change."""
        index, log = self._index, self._index.offsets
        modes, arms = log.get("MODE", _NONE), _NONE
        mode, armed = np.zeros(0), np.zeros(0)
        if len(modes):
            rows = index.rows("MODE", modes)
            column = "ModeNum" if index.has("MODE", "ModeNum") else "Mode"
            mode = np.asarray(rows[column], float)
        if index.has("ARM", "ArmState"):
            arms = log["ARM"]
            armed = np.asarray(index.rows("ARM", arms)["ArmState"] != 0, float)
        elif index.has("EV", "Id"):
            events = index.rows("EV", log["EV"])["Id"]
            told = np.isin(events, (_EV_ARMED, _EV_DISARMED))
            arms, armed = log["EV"][told], np.asarray(events[told] == _EV_ARMED, float)
        # Unless told otherwise a log begins with arming (LOG_DISARMED is 0).
        opening = (mode[0] if len(mode) else 0.0, 1.0 - armed[0] if len(armed) else 1.0)
        return self._states(opening, (modes, mode), (arms, armed))

    def _states(
        self, opening: tuple[float, float], modes: tuple[Ints, Floats], arms: tuple[Ints, Floats]
    ) -> MessageBlock:
        offsets, (mode, armed) = _held(modes, arms)
        order = np.concatenate([[0], offsets + self._shift])
        mode, armed = (
            latest(np.concatenate([[first], column]))
            for first, column in zip(opening, (mode, armed), strict=True)
        )
        fields = table(
            "HEARTBEAT",
            len(order),
            type=self._type(),
            autopilot=ARDUPILOT,
            base_mode=np.where(armed > 0.0, ARMED, 0),
            custom_mode=mode,
        )
        received = np.full(len(order), self._unix_us)
        return message_block("HEARTBEAT", order, received, fields, self._sysid)
