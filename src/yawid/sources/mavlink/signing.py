"""MAVLink 2 signing: accepts frames from the holder of the key, and each of them only once.

A signature follows the CRC: link id (1 byte), time stamp (6 bytes, little-endian, in 10 us since
2015) and the first 6 bytes of sha256(key, frame, link id, time stamp).
"""

import hashlib
import hmac
import re
from functools import cache
from pathlib import Path

import numpy as np

from yawid.blocks import Bytes
from yawid.errors import ConfigError
from yawid.quantities.link import Check
from yawid.sources.mavlink.framing import CRC_SIZE, MAGIC_V2, SIGNATURE_SIZE, SIGNED, Frames

KEY_SIZE = 32
EPOCH_S = 1_420_070_400  # 2015, in Unix time
TICKS_PER_S = 100_000
_HASH_SIZE = 6
_NEW_STREAM_MAY_LAG = 60 * TICKS_PER_S  # how much older than the newest the first stamp may be
_LARGEST_FILE = 4096
_HEX = re.compile(rb"[0-9a-fA-F]{64}")


class SigningKey:
    """A key for signatures; the key itself is not kept, only the state of a hash after it.

    Raises:
        ConfigError: the key does not have 32 bytes.
    """

    __slots__ = ("_begun",)

    def __init__(self, key: bytes) -> None:
        if len(key) != KEY_SIZE:
            raise ConfigError(f"a signing key has {KEY_SIZE} bytes, not {len(key)}")
        self._begun = hashlib.sha256(key)

    @staticmethod
    def from_file(path: Path) -> "SigningKey":
        """Return the key in a file: 32 raw bytes, 64 hex digits, or one line of text (passphrase).

        The key is then the sha256 of the line without its end, in UTF-8, as in MAVProxy and Mission
        Planner.

        Raises:
            ConfigError: the file cannot be read or holds none of the three.
        """
        try:
            with path.open("rb") as file:
                content = file.read(_LARGEST_FILE + 1)
        except OSError as error:
            raise ConfigError(f"signing key file {path}: {error.strerror}") from error
        return SigningKey(_key_in(content, path))

    @property
    def mark(self) -> str:
        """The hex digits that distinguish keys in data sets.

        To guess a passphrase from them costs scrypt's time and memory for each try.
        """
        return _mark(self._begun.digest())

    def signs(self, signed: bytes, signature: bytes) -> bool:
        """Return whether these are the first bytes of sha256(key, signed)."""
        return hmac.compare_digest(self._signature_of(signed), signature)

    def has_signed(self, frame: bytes) -> bool:
        """Return whether a whole frame has this key's signature, of any time."""
        is_signed = frame[0] == MAGIC_V2 and bool(frame[2] & SIGNED)
        return is_signed and self.signs(frame[:-_HASH_SIZE], frame[-_HASH_SIZE:])

    def sign(self, frame: bytes) -> bytes:
        """Return the frame, which has room for a signature at its end, with that signature."""
        return frame[:-_HASH_SIZE] + self._signature_of(frame[:-_HASH_SIZE])

    def _signature_of(self, signed: bytes) -> bytes:
        begun = self._begun.copy()
        begun.update(signed)
        return begun.digest()[:_HASH_SIZE]


@cache
def _mark(digest: bytes) -> str:
    return hashlib.scrypt(digest, salt=b"yawid", n=1 << 14, r=8, p=1, dklen=16).hex()


class Signing:
    """The check of one stream, in the order received.

    A frame is accepted if its signature is right and its time stamp is newer than the last accepted
    one of its (link id, sysid, compid). The first time stamp of those may be up to a minute older
    than the newest of all. Nothing is compared with the present time, so that a recording gives the
    same result at any time, and a live session the same as its replay. Frames without a signature
    are rejected from any sender: also RADIO_STATUS frames, which radios put into the link unsigned,
    and all of MAVLink 1.
    """

    def __init__(self, key: SigningKey) -> None:
        self._key = key
        self._newest = 0
        self._streams: dict[tuple[int, int, int], int] = {}

    def check(self, data: bytes, frames: Frames, sysid: Bytes, compid: Bytes) -> Bytes:
        """Return a :class:`Check` (n,) for each of the frames in ``data``."""
        checks = np.full(len(frames), Check.UNSIGNED, np.uint8)
        is_signed = frames.end - frames.payload - frames.length == CRC_SIZE + SIGNATURE_SIZE
        rows = np.flatnonzero(is_signed)
        columns = (frames.begin[rows], frames.end[rows], sysid[rows], compid[rows])
        for row, *place in zip(rows.tolist(), *(c.tolist() for c in columns), strict=True):
            checks[row] = self._check_one(data, *place)
        return checks

    def _check_one(self, data: bytes, begin: int, end: int, sysid: int, compid: int) -> Check:
        hash_at = end - _HASH_SIZE
        # The signature is checked first: a forged frame must not move the time stamps.
        if not self._key.signs(data[begin:hash_at], data[hash_at:end]):
            return Check.WRONG
        stream = data[end - SIGNATURE_SIZE], sysid, compid
        stamp = int.from_bytes(data[end - SIGNATURE_SIZE + 1 : hash_at], "little")
        if stamp <= self._streams.get(stream, self._newest - _NEW_STREAM_MAY_LAG - 1):
            return Check.REPLAYED
        self._streams[stream] = stamp
        self._newest = max(self._newest, stamp)
        return Check.ACCEPTED


def _key_in(content: bytes, path: Path) -> bytes:
    """Return the key from a file's content; errors never quote it."""
    if len(content) == KEY_SIZE:
        return content
    if _HEX.fullmatch(content.strip()):
        return bytes.fromhex(content.strip().decode("ascii"))
    line = content.rstrip(b"\r\n")
    if not line or b"\n" in line or b"\0" in line or len(content) > _LARGEST_FILE:
        raise _no_key(path)
    try:
        line.decode("utf-8")
    except UnicodeDecodeError:
        # The original error is not chained, because it contains the bytes.
        raise _no_key(path) from None
    return hashlib.sha256(line).digest()


def _no_key(path: Path) -> ConfigError:
    return ConfigError(
        f"signing key file {path}: must hold 32 bytes, 64 hex digits or one line of text"
    )
