"""The usual feed of a live link, frame by frame: a few whole records, in step, nothing odd.

NumPy takes as long for three frames as for three hundred: what a live session hears in a fiftieth
of a second is read sooner by a plain loop. Whatever is odd (damage, a stamp that does not fit, an
unknown message, a frame in two parts) is left to the decoder's other way, which can do everything;
of what is plain both make the same, and a test holds them to it.
"""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from yawid.blocks import MessageBlock
from yawid.sources.chain import stamps_agree
from yawid.sources.crc import REVERSED, START
from yawid.sources.framing import (
    CRC_SIZE,
    LONGEST_HEADER,
    MAGIC_V1,
    MAGIC_V2,
    SIGNATURE_SIZE,
    SIGNED,
    STAMP_SIZE,
)
from yawid.sources.messages import UNKNOWN, Definitions


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
        self._extra = [bytes([byte]).translate(REVERSED) for byte in known.crc_extra.tolist()]

    def read(self, data: bytes, last_us: int) -> list[PlainRecord] | None:
        """Return the records, None where anything is odd; ``last_us`` is the stamp before them."""
        mirrored = data.translate(REVERSED)
        found = []
        at = 0
        while at < len(data):
            record = self._parse(data, at)
            if record is None or record.end > len(data) or not stamps_agree(record.stamp, last_us):
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
        begin = at + STAMP_SIZE
        head = data[begin : begin + LONGEST_HEADER]
        if len(head) < LONGEST_HEADER:
            return None
        stamp, length = int.from_bytes(data[at:begin], "big"), head[1]
        if head[0] == MAGIC_V2 and head[2] <= SIGNED and not head[9]:
            row = self._known.row_of.item(head[7] | head[8] << 8)
            payload, sequence, sender = begin + 10, head[4], head[5] << 8 | head[6]
            end = payload + length + CRC_SIZE + SIGNATURE_SIZE * head[2]
        elif head[0] == MAGIC_V1:
            row = self._known.row_of.item(head[5])
            payload, sequence, sender = begin + 6, head[2], head[3] << 8 | head[4]
            end = payload + length + CRC_SIZE
            if not self._known.fits_v1[row, length]:
                return None
        else:
            return None
        if row == UNKNOWN:
            return None
        return PlainRecord(begin, payload, end, length, row, stamp, sequence, sender)


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
    sender = np.array([r.sender for r in records])
    return MessageBlock(
        name,
        np.array([first + r.begin - STAMP_SIZE for r in records]),
        np.array([r.stamp for r in records]),
        (sender >> 8).astype(np.uint8),
        sender.astype(np.uint8),
        np.frombuffer(payloads, dtype),
    )
