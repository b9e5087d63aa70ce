"""Makes long telemetry logs of a plane quickly, with all messages of a real link.

The mixes are those of recorded ArduPlane links. Messages that yawid does not read have random
payloads.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

from yawid.channels.stage import WANTED
from yawid.sources.mavlink.crc import crc_of_frames
from yawid.sources.mavlink.definitions import definitions, dtype_of

Plant = tuple[Sequence[float], Sequence[float]]
"""B and A of a discrete model from rudder to yaw rate, at ``RATE_HZ``."""
RATE_HZ: Final = 20
PLANT: Final[Plant] = ([0.0, 0.0124, -0.0115], [1.0, -1.957, 0.9735])
START_US: Final = 1_700_000_000_000_000
_BOOT_US: Final = 10_000_000
_PIECE_S: Final = 600
_RAISED = ("SERVO_OUTPUT_RAW", "ATTITUDE", "RAW_IMU", "SIMSTATE", "AOA_SSA")
_HALF = ("GLOBAL_POSITION_INT", "VFR_HUD", "RC_CHANNELS")
_SLOW = (
    "AHRS", "AHRS2", "AIRSPEED", "BATTERY_STATUS", "EKF_STATUS_REPORT", "ESC_TELEMETRY_1_TO_4",
    "GPS_RAW_INT", "LOCAL_POSITION_NED", "MEMINFO", "MISSION_CURRENT", "NAV_CONTROLLER_OUTPUT",
    "POSITION_TARGET_GLOBAL_INT", "POWER_STATUS", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE",
    "SCALED_PRESSURE2", "SYSTEM_TIME", "SYS_STATUS", "TERRAIN_REPORT", "VIBRATION", "WIND",
)  # fmt: skip
MIXES: Final[dict[str, dict[str, int]]] = {
    # ArduPlane with higher rates of the streams that yawid needs; a ground station set the others.
    "raised": dict.fromkeys(_RAISED, RATE_HZ)
    | dict.fromkeys(_HALF, RATE_HZ // 2)
    | dict.fromkeys((*_SLOW, "HEARTBEAT"), 1),
    # MAVProxy's "set streamrate 20": all streams of the autopilot at that rate.
    "all": dict.fromkeys((*_RAISED, *_HALF, *_SLOW), RATE_HZ) | {"HEARTBEAT": 1},
}
_FIELDS: Final[dict[str, dict[str, int | float]]] = {
    "HEARTBEAT": {"type": 1, "autopilot": 3, "base_mode": 128, "custom_mode": 5,
                  "system_status": 4, "mavlink_version": 3},
    "VFR_HUD": {"airspeed": 25.0, "groundspeed": 26.0, "throttle": 50, "alt": 100.0},
    "SERVO_OUTPUT_RAW": {f"servo{i}_raw": 1500 for i in (1, 2, 3)},
}  # fmt: skip


def write_log(
    path: Path,
    hours: float,
    mix: str,
    seed: int | tuple[int, ...] = 1,
    moved_s: float = 1.0,
    every_s: float = 1.0,
    *,
    plant: Plant = PLANT,
    start_us: int = START_US,
) -> int:
    """Write a flight whose rudder moves for ``moved_s`` in every ``every_s``.

    Return the number of messages. By default the rudder always moves. ``plant`` is the model from
    rudder to yaw rate; ``start_us`` (us since 1970) is when the vehicle was switched on.
    """
    rng = np.random.default_rng(seed)
    n = round(3600 * hours * RATE_HZ)
    u = np.repeat(rng.choice([-0.2, 0.0, 0.2], n // 10 + 1), 10)[:n]
    u = np.where(np.arange(n) / RATE_HZ % every_s < moved_s, u, 0.0)
    rate = lfilter(*plant, u) + 0.002 * rng.normal(size=n)
    flight = {"servo4_raw": 1500 + np.round(400 * u), "yawspeed": rate}
    yaw = np.cumsum(rate) / RATE_HZ
    flight["yaw"] = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    with path.open("wb") as out:
        count = _write_parameters(out, start_us)
        step = _PIECE_S * RATE_HZ
        for first in range(0, n, step):
            piece = {name: column[first : first + step] for name, column in flight.items()}
            count += _write_piece(out, MIXES[mix], piece, first, count, rng, start_us)
    return count


def _write_parameters(out: BinaryIO, start_us: int) -> int:
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    parameters = {"FUNCTION": 21, "MIN": 1100, "MAX": 1900, "TRIM": 1500}
    for i, (name, value) in enumerate(parameters.items()):
        link.seq = i
        message = mavlink.MAVLink_param_value_message(f"SERVO4_{name}".encode(), value, 9, 4, i)
        out.write((start_us + i).to_bytes(8, "big") + message.pack(link))
    return len(parameters)


def _write_piece(
    out: BinaryIO,
    mix: dict[str, int],
    flight: dict[str, NDArray[Any]],
    first: int,
    count: int,
    rng: np.random.Generator,
    start_us: int,
) -> int:
    """Write the messages of ten minutes from sample ``first`` on; return how many.

    ``count`` messages were sent before.
    """
    n = len(flight["yawspeed"])
    rows = {name: np.arange(0, n, RATE_HZ // hz) for name, hz in mix.items()}
    at = np.concatenate([_times(first + rows[name], i) for i, name in enumerate(mix)])
    order = np.argsort(at, kind="stable")
    place = np.empty(len(at), np.int64)
    place[order] = np.arange(len(at))
    sizes = np.concatenate([np.full(len(rows[name]), _kind(name).itemsize) for name in mix])
    ends = np.cumsum(sizes[order])
    begins = (ends - sizes[order])[place]
    data, done = np.empty(int(ends[-1]), np.uint8), 0
    for name in mix:
        own = slice(done, done + len(rows[name]))
        done = own.stop
        frames = _frames(name, at[own], count + place[own], rows[name], flight, rng)
        frames["stamp"] = start_us + at[own]
        flat = frames.view(np.uint8).reshape(len(frames), -1)
        data[begins[own][:, None] + np.arange(flat.shape[1])] = flat
    extra = np.concatenate(
        [np.full(len(rows[name]), definitions().crc_extra[_row(name)]) for name in mix]
    )
    crc = crc_of_frames(data, begins + 9, begins + sizes - 2, extra)
    data[begins + sizes - 2], data[begins + sizes - 1] = crc & 0xFF, crc >> 8
    out.write(data.tobytes())
    return len(at)


def _times(samples: NDArray[np.int64], phase: int) -> NDArray[np.int64]:
    return _BOOT_US + samples * 1_000_000 // RATE_HZ + 400 * phase


def _row(name: str) -> int:
    return definitions().names[name]


def _kind(name: str) -> np.dtype[Any]:
    """Return the dtype of a message's record, whose payload has no extension fields."""
    length = int(definitions().fits_v1[_row(name)].argmax())
    head = [("stamp", ">u8"), ("magic", "u1"), ("length", "u1"), ("flags", "u1", 2),
            ("seq", "u1"), ("ids", "u1", 2), ("message", "u1", 3)]  # fmt: skip
    return np.dtype([*head, ("payload", "u1", length), ("crc", "u1", 2)])


def _frames(
    name: str,
    at: NDArray[np.int64],
    number: NDArray[np.int64],
    rows: NDArray[np.int64],
    flight: dict[str, NDArray[Any]],
    rng: np.random.Generator,
) -> NDArray[Any]:
    """Return the records of one message (n,), still without stamps and CRCs."""
    frames = np.zeros(len(at), _kind(name))
    length = frames["payload"].shape[1]
    frames["magic"], frames["length"] = 0xFD, length
    frames["seq"], frames["ids"] = number % 256, 1
    message = int(np.flatnonzero(definitions().row_of == _row(name))[0])
    frames["message"] = list(message.to_bytes(3, "little"))
    values = np.zeros(len(at), dtype_of(name))
    known: dict[str, Any] = {"time_boot_ms": at // 1000, "time_usec": at}
    if name in WANTED:
        known |= _FIELDS.get(name, {}) | {field: flight[field][rows] for field in flight}
    else:
        values = rng.integers(0, 256, (len(at), values.itemsize), np.uint8).view(values.dtype)[:, 0]
    for field in known.keys() & set(values.dtype.names or ()):
        values[field] = np.asarray(known[field]).astype(values.dtype[field])
    frames["payload"] = values.view(np.uint8).reshape(len(at), -1)[:, :length]
    return frames
