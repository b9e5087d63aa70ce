"""Frames to be sent: MAVLink 2 frames of one sender, in sequence, signed where there is a key."""

import time
from collections.abc import Callable
from functools import cache
from typing import Any, Final

from yawid.sources.mavlink.signing import EPOCH_S, KEY_SIZE, TICKS_PER_S, SigningKey

COMPID: Final = 194
"""MAV_COMP_ID_ONBOARD_COMPUTER4, the last of four: other programs use the first ones."""
_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE


class Outgoing:
    """The sender (sysid, compid) that packs messages into frames.

    Each frame has the next sequence number. With ``key`` it is signed on link 0, with the present
    time in 10 us since 2015; a time stamp is always newer than the one before, even if the clock is
    set back.
    """

    def __init__(self, sysid: int, compid: int, key: SigningKey | None = None) -> None:
        from pymavlink.dialects.v20 import ardupilotmega

        self.messages: Any = ardupilotmega.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        """pymavlink's encoder: ``messages.heartbeat_encode(...)`` and so on."""
        self._key = key
        # pymavlink makes room for a signature; ours replaces the one that it writes.
        self.messages.signing.sign_outgoing = key is not None
        self.messages.signing.secret_key = bytes(KEY_SIZE)

    def heartbeat(self) -> Any:
        """Return the HEARTBEAT of an onboard controller."""
        return self.messages.heartbeat_encode(_ONBOARD_CONTROLLER, _NO_AUTOPILOT, 0, 0, _ACTIVE)

    def frame(self, message: Any) -> bytes:
        """Return the frame of one message, made by ``messages``."""
        signing = self.messages.signing
        # Each stamp is newer than the last, because packing increments it.
        signing.timestamp = max(signing.timestamp, int((time.time() - EPOCH_S) * TICKS_PER_S))
        frame: bytes = bytes(message.pack(self.messages))
        self.messages.seq = (self.messages.seq + 1) % 256
        return frame if self._key is None else self._key.sign(frame)


def senders(compid: int, key: SigningKey | None) -> Callable[[int], Outgoing]:
    """Return a function from a system id to its one sender: two would use the same numbers."""

    @cache
    def sender(sysid: int) -> Outgoing:
        return Outgoing(sysid, compid, key)

    return sender
