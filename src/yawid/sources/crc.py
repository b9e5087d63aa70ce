"""CRC-16/MCRF4XX of many frames at once, eight bytes a step.

The generator ``P = x^16 + x^12 + x^5 + 1`` is sparse and squaring over GF(2) spreads its exponents:
``P^4 = x^64 + x^48 + x^20 + 1``. A message is therefore reduced modulo P^4 in words of 64 bits by a few
shifts, then modulo P^2 and P. The first byte of a word holds its highest powers, lowest bit first: a shift
to the left is a division by x.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Bytes, Ints

Words = NDArray[np.unsignedinteger[Any]]

_WORD = 8
_START = 0xFFFF  # the CRC's start value, added to the first two bytes of a message


def crc_of_frames(data: Bytes, first: Ints, end: Ints, extra: Bytes) -> NDArray[np.uint16]:
    """Return the CRC of ``data[first:end]`` followed by the byte ``extra``, one row per frame.

    ``first``, ``end`` and ``extra`` are (n,), n >= 1, with ``end - first >= 2``; up to 7 bytes before
    ``first`` are read and ignored, so ``first`` must be at least 7.
    """
    size = end - first
    count = (size + (_WORD - 1)) // _WORD
    longest_first = np.argsort(count.astype(np.uint8), kind="stable")[::-1]
    unused_bits = ((-size % _WORD) * 8)[longest_first].astype(np.uint64)
    columns = _columns(data, end[longest_first], np.bincount(count))
    remainder = _modulo_p4(columns, unused_bits, np.bincount(count))
    crc = np.empty(len(first), np.uint16)
    crc[longest_first] = _advance(_modulo_p(remainder))
    return _append(crc, extra)


def _columns(data: Bytes, end: Ints, counts: Ints) -> NDArray[np.uint64]:
    """Return the last words of each message (words, n), rows sorted by falling number of words.

    ``counts[w]`` is the number of messages of ``w`` words. What lies above a message is not set.
    """
    most = len(counts) - 1
    columns = np.empty((most, len(end)), np.uint64)
    done = 0
    for words in range(most, 0, -1):
        rows = slice(done, done + int(counts[words]))
        if rows.stop > rows.start:
            size = words * _WORD
            message_at = np.ndarray((len(data) - size + 1,), f"V{size}", data, 0, (1,))
            messages = message_at[end[rows] - size].view(np.uint64).reshape(-1, words)
            columns[most - words :, rows] = messages.T
        done = rows.stop
    return columns


def _modulo_p4(columns: NDArray[np.uint64], unused: NDArray[np.uint64], counts: Ints) -> Words:
    """Return the messages modulo P^4 (n,); ``columns`` is used up.

    All messages end together, a shorter one joins later. The first word of each loses the ``unused``
    bits that lie before the message and takes up the start value.
    """
    keep = ~np.uint64(0) << unused
    start = np.uint64(_START) << unused
    spilt = np.uint64(_START) >> (np.uint64(64) - unused).clip(max=np.uint64(63))
    before = joined = 0
    for row, column in enumerate(columns):
        rows = joined + int(counts[len(columns) - row])
        column[joined:rows] &= keep[joined:rows]
        column[joined:rows] ^= start[joined:rows]
        if row:
            column[before:joined] ^= spilt[before:joined]
            column[:joined] ^= _advance(columns[row - 1, :joined])
        before, joined = joined, rows
    return columns[-1]


def _modulo_p(remainder: NDArray[np.uint64]) -> NDArray[np.uint16]:
    """Reduce modulo P^4 to modulo P: each half step is ``high * x^(width / 2) + low``."""
    halves = remainder.view(np.uint32).reshape(-1, 2)
    quarters = (_advance(halves[:, 0]) ^ halves[:, 1]).view(np.uint16).reshape(-1, 2)
    return np.asarray(_advance(quarters[:, 0]) ^ quarters[:, 1], np.uint16)


def _advance(v: Words) -> Words:
    """Return ``v * x^w`` modulo ``P^(w / 16)`` for words of w = 16, 32 or 64 bits.

    With ``k = w / 16`` and ``y = 1 / x``, the quotient is v times the head of
    ``1 / (1 + y^4k + y^11k + y^16k) = 1 + y^4k + y^8k + y^11k + y^12k + ...``.
    """
    kind = v.dtype.type
    k = v.dtype.itemsize // 2
    quotient = v << kind(4 * k)
    quotient ^= v
    quotient ^= quotient << kind(8 * k)
    quotient ^= v << kind(11 * k)
    product = quotient >> kind(5 * k)
    product ^= quotient
    product ^= quotient >> kind(12 * k)
    return product


def _append(crc: Words, byte: Bytes) -> NDArray[np.uint16]:
    """Continue the CRC by one byte each."""
    x = (crc ^ byte) & np.uint16(0xFF)
    x ^= (x << np.uint16(4)) & np.uint16(0xFF)
    shifted = (x << np.uint16(8)) ^ (x << np.uint16(3)) ^ (x >> np.uint16(4))
    return np.asarray((crc >> np.uint16(8)) ^ shifted, np.uint16)
