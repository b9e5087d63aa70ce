"""pymavlink's definitions of the messages, as tables for NumPy."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Bytes, Ints
from yawid.errors import ConfigError

HEARTBEAT = 0
UNKNOWN = -1
_IDS = 1 << 16  # MAVLink 2 allows 2^24 ids, but no dialect uses more than these

_SCALARS = {
    "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4",
    "q": "<i8", "Q": "<u8", "f": "<f4", "d": "<f8", "c": "S1",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Definitions:
    """The dialect's messages, one row each.

    ``row_of`` (65536,) is the row of a message id or ``UNKNOWN``, ``names`` the row of a name. By
    row there are ``crc_extra`` (n,), the payload's full ``size`` (n,) in bytes, and ``fits_v1``
    (n, 256), whether a payload of MAVLink 1 may have this number of bytes.
    """

    row_of: NDArray[np.int16]
    crc_extra: Bytes
    size: Ints
    fits_v1: NDArray[np.bool_]
    names: dict[str, int]


@cache
def definitions() -> Definitions:
    """Return the tables of the ardupilotmega dialect, which contains common and PX4's messages."""
    classes = list(_dialect().values())
    row_of = np.full(_IDS, UNKNOWN, np.int16)
    fits = np.zeros((len(classes), 256), np.bool_)
    for row, cls in enumerate(classes):
        row_of[cls.id] = row
        fits[row, list(_lengths_v1(cls))] = True
    extra = np.array([cls.crc_extra for cls in classes], np.uint8)
    size = np.array([cls.unpacker.size for cls in classes], np.int64)
    return Definitions(
        row_of, extra, size, fits, {cls.msgname: row for row, cls in enumerate(classes)}
    )


@cache
def dtype_of(name: str) -> np.dtype[Any]:
    """Return the packed dtype of a whole payload, one field per MAVLink field in wire order.

    Arrays are subarrays and text is bytes ('S16'), which NumPy returns without trailing zeros.

    Raises:
        ConfigError: the dialect has no message of that name.
    """
    cls = next((cls for cls in _dialect().values() if cls.msgname == name), None)
    if cls is None:
        raise ConfigError(f"no MAVLink message is called {name!r}")
    return np.dtype(
        [
            (field, f"S{max(length, 1)}")
            if code == "c"
            else (field, _SCALARS[code], (length,) * bool(length))
            for field, code, length in _wire_fields(cls)
        ]
    )


def _dialect() -> dict[int, Any]:
    # Importing the dialect takes 40 ms: --help must not pay for it. mavutil would set environment
    # variables and start in MAVLink 1.
    from pymavlink.dialects.v20 import ardupilotmega

    messages: dict[int, Any] = ardupilotmega.mavlink_map
    return messages


def _wire_fields(cls: Any) -> Iterator[tuple[str, str, int]]:
    """Yield name, struct code and array length (0: no array) of each field in wire order."""
    codes = cls.native_format.decode("ascii").lstrip("<")
    return zip(cls.ordered_fieldnames, codes, cls.array_lengths, strict=True)


def _lengths_v1(cls: Any) -> Iterator[int]:
    """Yield the payload lengths of MAVLink 1: without extensions, or with some of them.

    The class does not say where the extensions begin, but CRC_EXTRA is the checksum of the base
    fields alone: the first field at which the checksum matches may be the last of them.
    """
    from pymavlink.generator.mavcrc import x25crc

    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    crc = x25crc(f"{cls.msgname} ".encode())
    size, ended = 0, False
    for name, code, length in _wire_fields(cls):
        kind = "uint8_t" if types[name] == "uint8_t_mavlink_version" else types[name]
        crc.accumulate(f"{kind} {name} ".encode() + (bytes([length]) if length else b""))
        size += np.dtype(_SCALARS[code]).itemsize * max(length, 1)
        ended = ended or (crc.crc & 0xFF) ^ (crc.crc >> 8) == cls.crc_extra
        if ended:
            yield size
    yield size
