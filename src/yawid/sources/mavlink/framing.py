"""The search for intact MAVLink frames in raw bytes: by magic, header and CRC, at any position."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Bytes, Columns, Ints
from yawid.sources.mavlink.crc import crc_of_frames
from yawid.sources.mavlink.definitions import UNKNOWN, Definitions

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
STAMP_SIZE = 8
MAX_FRAME = 280  # MAVLink 2: header 10, payload 255, CRC 2, signature 13
LONGEST_HEADER = 10
SLACK = MAX_FRAME + 16  # bytes after the last valid one, so that no look-ahead leaves the array
SIGNED = 1
SIGNATURE_SIZE = 13
CRC_SIZE = 2


@dataclass(frozen=True, slots=True)
class Frames(Columns):
    """Frames in an array of bytes, one row each, by rising position.

    ``begin`` (n,) is the position of the magic, ``end`` one past the last byte, ``payload`` and
    ``length`` the position and size of the payload, ``row`` the message's row in
    :class:`Definitions`.
    """

    begin: Ints
    end: Ints
    payload: Ints
    length: Ints
    row: Ints


class Header(NamedTuple):
    """The contents of one header.

    These are the ``size`` in bytes of the whole frame, the ``row`` of its message or ``UNKNOWN``,
    whether that message ``may_be`` so long, and the ``sender`` (256 * sysid + compid).
    """

    size: int
    row: int
    may_be: bool
    sender: int


def frame_size(head: bytes) -> int | None:
    """Return the size of the frame that begins with these bytes, None if none does."""
    if len(head) < 3:
        return None
    if head[0] == MAGIC_V1:
        return 8 + head[1]
    if head[0] == MAGIC_V2 and head[2] <= SIGNED:
        return 12 + head[1] + SIGNATURE_SIZE * head[2]
    return None


def read_header(data: bytes, begin: int, known: Definitions) -> Header | None:
    """Return the header at ``begin``, or None if no MAVLink frame can begin like that."""
    head = data[begin : begin + LONGEST_HEADER]
    size = frame_size(head[:3])
    if size is None:
        return None
    is_v1 = head[0] == MAGIC_V1
    message_id = head[5] if is_v1 else int.from_bytes(head[7:10], "little")
    row = int(known.row_of[message_id]) if message_id < len(known.row_of) else UNKNOWN
    fits = known.fits_v1[row, head[1]] if is_v1 else head[1] <= known.size[row]
    sender = int.from_bytes(head[3:5] if is_v1 else head[5:7], "big")
    return Header(size, row, row == UNKNOWN or bool(fits), sender)


def find_frames(data: Bytes, start: int, stop: int, known: Definitions) -> tuple[Frames, int]:
    """Return the intact frames in ``data[start:stop]``, and from where on there may be more.

    That position is the beginning of the first frame that may be intact once the bytes after
    ``stop`` are known, or ``stop`` if there is none: frames that begin before it no longer change.
    ``data`` (m,) has ``SLACK`` bytes after ``stop``, and ``start`` is at least ``STAMP_SIZE``.
    """
    window = data[start:stop]
    at = np.flatnonzero((window == MAGIC_V1) | (window == MAGIC_V2)) + start
    is_v2 = data[at] == MAGIC_V2
    v2, open_v2 = _finished(_parse_v2(data, at[is_v2], known), stop)
    v1, open_v1 = _finished(_parse_v1(data, at[~is_v2], known), stop)
    found = _intact(data, v2, known)
    others = _intact(data, v1, known)
    if len(others):
        found = Frames.joined([found, others]) if len(found) else others
        found = found.select(np.argsort(found.begin, kind="stable"))
    unread = at[np.searchsorted(at, stop - LONGEST_HEADER + 1) :]
    open_from = min([stop, open_v1, open_v2, *unread[:1].tolist()])
    return found, open_from


def _parse_v1(data: Bytes, at: Ints, known: Definitions) -> Frames:
    """Return the frames of MAVLink 1 that may begin at ``at``."""
    row = known.row_of[data[at + 5]]
    fits = np.flatnonzero((row != UNKNOWN) & known.fits_v1[row, data[at + 1]])
    at = at[fits]
    return _frames(at, 6, data[at + 1], row[fits], 0)


def _parse_v2(data: Bytes, at: Ints, known: Definitions) -> Frames:
    """Return the frames of MAVLink 2 that may begin at ``at``.

    The payload may be cut short (trailing zeros) or longer than known (extensions of a newer
    dialect).
    """
    row = known.row_of[data[at + 7] + data[at + 8].astype(np.int64) * 256]
    # No id of the dialect needs the third byte.
    fits = np.flatnonzero((row != UNKNOWN) & (data[at + 2] <= SIGNED) & (data[at + 9] == 0))
    at = at[fits]
    return _frames(at, 10, data[at + 1], row[fits], data[at + 2] * np.int64(SIGNATURE_SIZE))


def _finished(frames: Frames, stop: int) -> tuple[Frames, int]:
    """Return the frames that end by ``stop``, and the position of the first of the others."""
    unfinished = np.flatnonzero(frames.end > stop)
    if not len(unfinished):
        return frames, stop
    first = int(unfinished[0])
    rows: slice | Ints = slice(0, first)
    if first + len(unfinished) < len(frames):
        rows = np.flatnonzero(frames.end <= stop)
    return frames.select(rows), int(frames.begin[first])


def _frames(
    at: Ints, header: int, length: Bytes, row: NDArray[np.int16], trailer: Ints | int
) -> Frames:
    payload = at + header
    size = length.astype(np.int64)
    return Frames(at, payload + size + CRC_SIZE + trailer, payload, size, row.astype(np.int64))


def _intact(data: Bytes, frames: Frames, known: Definitions) -> Frames:
    """Return the frames whose CRC fits."""
    if not len(frames):
        return frames
    end = frames.payload + frames.length
    crc = crc_of_frames(data, frames.begin + 1, end, known.crc_extra[frames.row])
    sent = data[end] | data[end + 1].astype(np.uint16) << np.uint16(8)
    fits = crc == sent
    return frames if fits.all() else frames.select(np.flatnonzero(fits))
