"""ArduPilot's on-board log (.bin) as the MAVLink messages that the channels read.

RCOU becomes SERVO_OUTPUT_RAW, RCIN RC_CHANNELS, PARM PARAM_VALUE, MODE and ARM HEARTBEAT, CTUN or
ARSP, GPS and POS VFR_HUD, STAT EXTENDED_SYS_STATE. ATTITUDE has the body's rates from RATE or IMU,
a row for each of theirs, and the angles of ATT, linear between two of its rows. ArduPlane writes
RATE only in VTOL modes; IMU is the first gyro as calibrated, its slow drift not taken out as RATE's
is. With neither the heading of ATT stands in, coarse, as GLOBAL_POSITION_INT. RCOU ends at output
14; later ones are not read.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats, FrameBlock, Ints, MessageBlock
from yawid.sources.logs.as_mavlink import (
    COMPID,
    DTYPES,
    angles_at,
    frame_block,
    message,
    table,
    within,
)
from yawid.sources.logs.dataflash_index import DataflashIndex
from yawid.sources.logs.dataflash_vehicle import (
    NAMES,
    TIMED_NAMES,
    heartbeats,
    hud,
    parameters,
    system_id,
    system_state,
    unix_minus_boot_us,
)
from yawid.sources.logs.tlog import CHUNK, Digest
from yawid.sources.mavlink.link_stats import LinkStats

_RATES = {"RATE": ("R", "P", "Y"), "IMU": ("GyrX", "GyrY", "GyrZ")}
_TIMED = ("ATT", "RCOU", "RCIN", *_RATES, *TIMED_NAMES)
_ENOUGH = 0.9
"""RATE is read where it covers this share of the seconds that IMU covers."""
_NONE = np.zeros(0, np.int64)


class DataflashReader:
    """A dataflash log; the module says what is made of it.

    Messages follow each other as in the file. What the vehicle was when the log began is reported
    first: its type, its mode and the first value of every parameter. ``received_us`` is Unix time
    by GPS, as late as the receiver reports it (0.1 to 0.3 s) and by the 18 leap seconds since 2017;
    without a 3D fix it is the boot time.

    Raises:
        SourceError: the file cannot be read, or holds no message.
    """

    def __init__(self, path: Path) -> None:
        self._index = index = DataflashIndex(path, (*_TIMED, *NAMES, "DSF"))
        index.keep_timed(_TIMED)
        for name in ("IMU", "GPS", "ARSP"):
            self._keep_one_instance(name)
        self._unix_us = unix_minus_boot_us(index)
        self._rates = self._rate_source()
        (_, first), (changed, values) = parameters(index)
        self._sysid = system_id(first)
        self._shift = len(first) + 1
        order = np.arange(1, self._shift)
        self._first = self._untimed("PARAM_VALUE", order - self._shift, first)
        self._context = [
            self._untimed("HEARTBEAT", *_from_start(heartbeats(index), self._shift)),
            self._untimed("VFR_HUD", *hud(index)),
            self._untimed("EXTENDED_SYS_STATE", *system_state(index)),
            self._untimed("PARAM_VALUE", changed, values),
        ]

    @property
    def link(self) -> LinkStats:
        """Counts of the whole log: messages believed, bytes in none, messages it dropped itself."""
        index, lost = self._index, 0
        if index.has("DSF", "Dp"):
            lost = int(index.rows("DSF", index.offsets["DSF"])["Dp"].max())
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

    def read(self, digest: Digest | None = None) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they hold) from the start, continuing ``digest``."""
        data = self._index.data
        opening = [within(block, 0, self._shift) for block in self._context]
        yield 0, frame_block([opening[0], self._first])
        for low in range(0, len(data), CHUNK):
            chunk = data[low : low + CHUNK]
            if digest is not None:
                digest.update(chunk)
            high = low + len(chunk)
            edges = low + self._shift, high + self._shift
            context = [within(block, *edges) for block in self._context]
            yield len(chunk), frame_block([*context, *self._flying(low, high)])

    def _flying(self, low: int, high: int) -> Iterator[MessageBlock]:
        """Yield what is logged fast, of the bytes [low, high)."""
        if len(offsets := self._between("RCOU", low, high)):
            yield self._outputs("SERVO_OUTPUT_RAW", "servo", "RCOU", offsets)
        if len(offsets := self._between("RCIN", low, high)):
            yield self._outputs("RC_CHANNELS", "chan", "RCIN", offsets)
        if len(offsets := self._between(self._rates, low, high)):
            yield self._attitude(offsets, low, high)
        elif not self._rates and self._index.has("ATT", "Yaw"):
            yield self._heading(self._between("ATT", low, high))

    def _between(self, name: str, low: int, high: int, more: int = 0) -> Ints:
        """Return where messages of this name start in [low, high), and ``more`` on both sides."""
        offsets = self._index.offsets.get(name, _NONE)
        first, stop = np.searchsorted(offsets, (low, high))
        return offsets[max(first - more, 0) : stop + more]

    def _untimed(self, name: str, offsets: Ints, fields: NDArray[Any]) -> MessageBlock:
        received = np.full(len(offsets), self._unix_us)
        return message(name, offsets + self._shift, received, fields, self._sysid)

    def _timed(self, name: str, log: str, offsets: Ints, **columns: Any) -> MessageBlock:
        t_us = self._index.times(log, offsets)
        fields = table(name, len(offsets), time_usec=t_us, **columns)
        received = t_us + self._unix_us
        return message(name, offsets + self._shift, received, fields, self._sysid)

    def _outputs(self, name: str, prefix: str, log: str, offsets: Ints) -> MessageBlock:
        rows = self._index.rows(log, offsets)
        columns = {}
        for column in rows.dtype.names or ():
            # C1 to C14; Ch1 and Chan1 in older logs.
            field = f"{prefix}{column.lstrip('Chan')}_raw"
            if field in (DTYPES[name].names or ()):
                columns[field] = rows[column]
        return self._timed(name, log, offsets, **columns)

    def _attitude(self, offsets: Ints, low: int, high: int) -> MessageBlock:
        index, log = self._index, self._rates
        rows = index.rows(log, offsets)
        p, q, r = (index.si(log, rows, name) for name in _RATES[log])
        angles = self._angles(index.times(log, offsets), low, high)
        known = dict(zip(("roll", "pitch", "yaw"), angles, strict=True))
        return self._timed("ATTITUDE", log, offsets, rollspeed=p, pitchspeed=q, yawspeed=r, **known)

    def _angles(self, t_us: Ints, low: int, high: int) -> Floats:
        index = self._index
        if not index.has("ATT", "Roll", "Pitch", "Yaw"):
            return np.full((3, len(t_us)), np.nan)
        offsets = self._between("ATT", low, high, more=2)
        rows = index.rows("ATT", offsets)
        roll, pitch, yaw = (index.si("ATT", rows, name) for name in ("Roll", "Pitch", "Yaw"))
        return angles_at(t_us, index.times("ATT", offsets), roll, pitch, yaw)

    def _heading(self, offsets: Ints) -> MessageBlock:
        rows = self._index.rows("ATT", offsets)
        degrees = np.rad2deg(self._index.si("ATT", rows, "Yaw")) % 360.0
        return self._timed("GLOBAL_POSITION_INT", "ATT", offsets, hdg=100.0 * degrees)

    def _rate_source(self) -> str:
        """Return RATE, or IMU where that covers more of the flight, or nothing."""
        index, seconds = self._index, {}
        for name, columns in _RATES.items():
            covered = index.times(name, index.offsets[name]) if index.has(name, *columns) else _NONE
            seconds[name] = len(np.unique(covered // 1_000_000))
        if not any(seconds.values()):
            return ""
        return "RATE" if seconds["RATE"] >= _ENOUGH * seconds["IMU"] else "IMU"

    def _keep_one_instance(self, name: str) -> None:
        """Of several sensors keep the first; of airspeed sensors the one reported to be primary."""
        if not self._index.has(name, "I"):
            return
        offsets = self._index.offsets[name]
        rows = self._index.rows(name, offsets)
        primary = rows["Pri"] if "Pri" in (rows.dtype.names or ()) else rows["I"].min()
        self._index.offsets[name] = offsets[rows["I"] == primary]


def _from_start(reported: tuple[Ints, NDArray[Any]], shift: int) -> tuple[Ints, NDArray[Any]]:
    """Move what is reported before the log's first byte to where order becomes 0."""
    offsets, fields = reported
    return np.where(offsets < 0, -shift, offsets), fields
