"""Which session gets which records: one takes everything, or each vehicle has its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, Protocol

from yawid.channels.vehicle import AUTOPILOT_INVALID, NOT_A_VEHICLE
from yawid.errors import ConfigError
from yawid.live.session import Ended, LiveSession, Setting, for_vehicle
from yawid.sources.framing import MAGIC_V1, STAMP_SIZE, frame_size
from yawid.sources.tap import sysid_of

KEPT = 4096
"""Records kept of a system that has not yet said that it is a vehicle."""
_HEARTBEAT = 0


class Sessions(Protocol):
    """One session or many, as the loop sees them."""

    def feed(self, data: bytes) -> None:
        """Take whole records."""

    def running(self) -> list[LiveSession]:
        """Return the sessions there are."""

    def finish(self, live: dict[str, Any]) -> list[Ended]:
        """Finish them all."""


class Single:
    """One session that records and reads everything heard."""

    def __init__(self, setting: Setting) -> None:
        self._session = LiveSession(setting)

    def feed(self, data: bytes) -> None:
        """See :class:`Sessions`."""
        self._session.feed(data)

    def running(self) -> list[LiveSession]:
        """See :class:`Sessions`."""
        return [self._session]

    def finish(self, live: dict[str, Any]) -> list[Ended]:
        """See :class:`Sessions`."""
        return [self._session.finish(live)]


class Fleet:
    """A session for each system id whose HEARTBEAT says that it flies, opened with the first.

    What a system sent before is kept until then; what never becomes a vehicle is recorded nowhere.
    """

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._sessions: dict[int, LiveSession] = {}
        self._early: dict[int, deque[bytes]] = {}
        self._refused: set[int] = set()

    def feed(self, data: bytes) -> None:
        """See :class:`Sessions`."""
        parts: dict[int, list[bytes]] = {}
        for record in records(data):
            sysid = sysid_of(record[STAMP_SIZE : STAMP_SIZE + 6])
            if sysid in self._sessions or sysid in parts or self._is_ready(sysid, record):
                parts.setdefault(sysid, []).append(record)
        for sysid, own in parts.items():
            if sysid not in self._sessions:
                self._sessions[sysid] = for_vehicle(self._setting, sysid)
                own = [*self._early.pop(sysid, ()), *own]
            self._feed_one(sysid, b"".join(own))

    def running(self) -> list[LiveSession]:
        """See :class:`Sessions`."""
        return [s for sysid, s in self._sessions.items() if sysid not in self._refused]

    def finish(self, live: dict[str, Any]) -> list[Ended]:
        """See :class:`Sessions`; where no vehicle was heard, one summary says so."""
        running = self.running() or [LiveSession(self._setting)]
        return [session.finish(live) for session in running]

    def _feed_one(self, sysid: int, data: bytes) -> None:
        """Feed one vehicle; one whose link does not fit what was asked for must not stop others."""
        if sysid in self._refused:
            return
        try:
            self._sessions[sysid].feed(data)
        except ConfigError as error:
            self._refused.add(sysid)
            self._sessions[sysid].tell(f"{error}: no longer estimated")
            self._sessions[sysid].abort()

    def _is_ready(self, sysid: int, record: bytes) -> bool:
        """Whether this record opens a session; else it is kept."""
        if is_vehicle(record[STAMP_SIZE:]):
            return True
        self._early.setdefault(sysid, deque(maxlen=KEPT)).append(record)
        return False


def records(data: bytes) -> Iterator[bytes]:
    """Yield the records of which ``data`` is made up."""
    at = 0
    while at < len(data):
        size = frame_size(data[at + STAMP_SIZE : at + STAMP_SIZE + 3])
        assert size is not None, "a tap hands out whole records"
        yield data[at : at + STAMP_SIZE + size]
        at += STAMP_SIZE + size


def is_vehicle(frame: bytes) -> bool:
    """Whether the frame is a HEARTBEAT of something that flies."""
    is_v1 = frame[0] == MAGIC_V1
    header = 6 if is_v1 else 10
    number = frame[5] if is_v1 else int.from_bytes(frame[7:10], "little")
    if number != _HEARTBEAT:
        return False
    payload = frame[header : header + frame[1]].ljust(9, b"\0")  # zeros at the end are not sent
    return payload[5] != AUTOPILOT_INVALID and payload[4] not in NOT_A_VEHICLE
