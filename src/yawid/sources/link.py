"""What a link carried, counted per sender."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from yawid.blocks import Bytes, Ints
from yawid.sources.framing import CRC_SIZE, SIGNATURE_SIZE, STAMP_SIZE, Frames
from yawid.sources.messages import HEARTBEAT, Definitions

Sender = tuple[int, int]
GCS_SYSID = 255
_MAV_TYPE_GCS = 6
_TYPE_OFFSET = 4  # of HEARTBEAT.type in the payload
_RESTART = 127  # a larger step of the sequence is a reboot or a duplicate, not a loss


@dataclass(frozen=True, slots=True)
class LinkStats:
    """What has been read so far.

    ``frames`` counts the records whose stamp and frame are intact, of all senders, ``signed`` those
    of them that carry a signature (which nobody has checked) and ``senders`` splits them by (sysid,
    compid). ``bad_crc`` and ``unknown`` count records passed over whole because the CRC was wrong
    or the message id unknown; ``skipped_bytes`` are the bytes in no record of these three kinds.
    ``lost`` counts the frames missing by sequence number, ground stations left out. ``first_us``
    and ``last_us`` are the receive stamps of the first and last record, None before there is one.
    """

    frames: int
    skipped_bytes: int
    bad_crc: int
    unknown: int
    lost: int
    signed: int
    first_us: int | None
    last_us: int | None
    senders: Mapping[Sender, int]


class Tally:
    """Counts records as they are believed."""

    def __init__(self, known: Definitions) -> None:
        self.record_bytes = 0
        self._heartbeat = known.row_of[HEARTBEAT]
        self._signed = 0
        self._first: int | None = None
        self._last: int | None = None
        self._frames: dict[Sender, int] = {}
        self._lost: dict[Sender, int] = {}
        self._sequence: dict[Sender, int] = {}
        self._ground: set[Sender] = set()

    def add(self, data: Bytes, frames: Frames, stamps: Ints, sequence: Bytes, sender: Ints) -> None:
        """Count the records; ``sender`` (n,) is 256 * sysid + compid."""
        if self._first is None:
            self._first = int(stamps[0])
        self._last = int(stamps[-1])
        payload_bytes = int(frames.length.sum())
        trailer_bytes = int((frames.end - frames.payload).sum()) - payload_bytes
        self._signed += (trailer_bytes - CRC_SIZE * len(frames)) // SIGNATURE_SIZE
        header_bytes = int((frames.payload - frames.begin).sum()) + STAMP_SIZE * len(frames)
        self.record_bytes += header_bytes + payload_bytes + trailer_bytes
        for key in np.flatnonzero(np.bincount(sender)).tolist():
            self._add_sender(divmod(key, 256), sequence[sender == key])
        self._find_ground(data, frames, sender)

    def _add_sender(self, sender: Sender, sequence: Bytes) -> None:
        before = self._sequence.get(sender, int(sequence[0]) - 1)
        # uint8 arithmetic is modulo 256, as the sequence is; the expected step of 1 becomes 0.
        missing = np.diff(sequence, prepend=np.uint8(before % 256)) - np.uint8(1)
        lost = int(missing[missing <= _RESTART].sum(dtype=np.int64))
        self._lost[sender] = self._lost.get(sender, 0) + lost
        self._frames[sender] = self._frames.get(sender, 0) + len(sequence)
        self._sequence[sender] = int(sequence[-1])

    def _find_ground(self, data: Bytes, frames: Frames, sender: Ints) -> None:
        rows = np.flatnonzero((frames.row == self._heartbeat) & (frames.length > _TYPE_OFFSET))
        is_ground = data[frames.payload[rows] + _TYPE_OFFSET] == _MAV_TYPE_GCS
        self._ground.update(divmod(key, 256) for key in set(sender[rows[is_ground]].tolist()))

    def stats(self, decided_bytes: int, passed_bytes: int, bad_crc: int, unknown: int) -> LinkStats:
        """Return the counts; ``passed_bytes`` of the ``decided_bytes`` were passed over whole."""
        lost = sum(
            count
            for sender, count in self._lost.items()
            if sender[0] != GCS_SYSID and sender not in self._ground
        )
        return LinkStats(
            frames=sum(self._frames.values()),
            skipped_bytes=decided_bytes - passed_bytes - self.record_bytes,
            bad_crc=bad_crc,
            unknown=unknown,
            lost=lost,
            signed=self._signed,
            first_us=self._first,
            last_us=self._last,
            senders=MappingProxyType(dict(sorted(self._frames.items()))),
        )
