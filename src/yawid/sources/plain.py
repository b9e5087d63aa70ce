"""The usual feed of a live link, frame by frame: a few whole records, in step, nothing odd.

NumPy takes as long for three frames as for three hundred: what a live session hears in a fiftieth
of a second is read sooner by a plain loop. Whatever is odd (damage, a stamp that does not fit, an
unknown message, a frame in two parts) is left to the decoder's other way, which can do everything;
of what is plain both make the same, and a test holds them to it.
"""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Sequence
from struct import Struct
from typing import Any, NamedTuple

import numpy as np

from yawid.blocks import MessageBlock
from yawid.sources.chain import LATEST_US, STAMP_TOLERANCE_US
from yawid.sources.crc import REVERSED, START
from yawid.sources.framing import (
    CRC_SIZE,
    MAGIC_V1,
    MAGIC_V2,
    SIGNATURE_SIZE,
    SIGNED,
    STAMP_SIZE,
)
from yawid.sources.messages import UNKNOWN, Definitions

_HEAD = Struct(">Q10B")  # a stamp and the longest header


class PlainRecord(NamedTuple):
    """One record: where its frame lies in the bytes fed, and what stamp and header say.

    ``row`` is the message's in :class:`Definitions`, ``sender`` is 256 * sysid + compid.
    """

    begin: int
    payload: int
    end: int
    length: int
    row: int
    stamp: int
    sequence: int
    sender: int


class PlainReader:
    """Reads bytes that are nothing but whole and intact records."""

    def __init__(self, known: Definitions) -> None:
        self._known = known
        rows = enumerate(known.row_of.tolist())
        self._row_of = {number: row for number, row in rows if row != UNKNOWN}
        self._extra = [bytes([byte]).translate(REVERSED) for byte in known.crc_extra.tolist()]

    def read(self, data: bytes, last_us: int) -> list[PlainRecord] | None:
        """Return the records, None where anything is odd; ``last_us`` is the stamp before them."""
        mirrored = data.translate(REVERSED)
        found = []
        at, stop = 0, len(data)
        while at < stop:
            record = self._parse(data, at) if at + _HEAD.size <= stop else None
            if record is None or record.end > stop or not _is_near(record.stamp, last_us):
                return None
            crc_at = record.payload + record.length
            crc = crc_hqx(mirrored[record.begin + 1 : crc_at], START)
            crc = crc_hqx(self._extra[record.row], crc)
            # A sum over a message and its own sum is zero.
            if crc_hqx(mirrored[crc_at : crc_at + CRC_SIZE], crc):
                return None
            found.append(record)
            at, last_us = record.end, record.stamp
        return found

    def _parse(self, data: bytes, at: int) -> PlainRecord | None:
        """Return the record at a position as its header has it, None if it is none we know."""
        stamp, magic, length, b2, b3, b4, b5, b6, b7, b8, b9 = _HEAD.unpack_from(data, at)
        begin = at + STAMP_SIZE
        if magic == MAGIC_V2 and b2 <= SIGNED and not b9:
            row, sequence, sender = self._row_of.get(b7 | b8 << 8), b4, b5 << 8 | b6
            payload = begin + 10
            end = payload + length + CRC_SIZE + SIGNATURE_SIZE * b2
        elif magic == MAGIC_V1:
            row, sequence, sender = self._row_of.get(b5), b2, b3 << 8 | b4
            payload = begin + 6
            end = payload + length + CRC_SIZE
            if row is not None and not self._known.fits_v1[row, length]:
                return None
        else:
            return None
        if row is None:
            return None
        return PlainRecord(begin, payload, end, length, row, stamp, sequence, sender)


def _is_near(stamp: int, last_us: int) -> bool:
    return stamp <= LATEST_US and abs(stamp - last_us) <= STAMP_TOLERANCE_US


def plain_message(
    name: str, data: bytes, first: int, records: Sequence[PlainRecord], dtype: np.dtype[Any]
) -> MessageBlock:
    """Return records of one message as columns; ``first`` is the place of ``data`` in the stream.

    Bytes of a payload that were not sent are zero, those beyond what is known are left out.
    """
    size = dtype.itemsize
    payloads = bytearray().join(
        [data[r.payload : r.payload + min(r.length, size)].ljust(size, b"\0") for r in records]
    )
    return MessageBlock(
        name,
        np.array([first + r.begin - STAMP_SIZE for r in records]),
        np.array([r.stamp for r in records]),
        np.frombuffer(bytearray([r.sender >> 8 for r in records]), np.uint8),
        np.frombuffer(bytearray([r.sender & 0xFF for r in records]), np.uint8),
        np.frombuffer(payloads, dtype),
    )
