"""Makes long telemetry logs of a plane quickly, with all messages of a real link.

The mix is that of recorded ArduPlane links. Each second has the same messages at the same times, so
a log is a table with a row for each second. Messages that yawid does not read have random payloads.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

from flights.surgery import CLASSES, Encoder, join
from yawid.channels.stage import WANTED
from yawid.sources.mavlink.crc import crc_of_frames
from yawid.sources.mavlink.definitions import definitions, dtype_of

RATE_HZ: Final = 20
PLANT: Final = [0.0, 0.0124, -0.0115], [1.0, -1.957, 0.9735]
"""B and A of a discrete model from rudder to yaw rate, at ``RATE_HZ``."""
START_US: Final = 1_700_000_000_000_000
_SLOW = (
    "AHRS", "AHRS2", "AIRSPEED", "BATTERY_STATUS", "EKF_STATUS_REPORT", "ESC_TELEMETRY_1_TO_4",
    "GPS_RAW_INT", "LOCAL_POSITION_NED", "MEMINFO", "MISSION_CURRENT", "NAV_CONTROLLER_OUTPUT",
    "POSITION_TARGET_GLOBAL_INT", "POWER_STATUS", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE",
    "SCALED_PRESSURE2", "SYSTEM_TIME", "SYS_STATUS", "TERRAIN_REPORT", "VIBRATION", "WIND",
    "HEARTBEAT",
)  # fmt: skip
MIX: Final = (
    dict.fromkeys(("SERVO_OUTPUT_RAW", "ATTITUDE", "RAW_IMU", "SIMSTATE", "AOA_SSA"), RATE_HZ)
    | dict.fromkeys(("GLOBAL_POSITION_INT", "VFR_HUD", "RC_CHANNELS"), RATE_HZ // 2)
    | dict.fromkeys(_SLOW, 1)
)
"""Messages a second of an ArduPlane with higher rates of the streams that yawid needs; a ground
station set the others."""
_FIELDS: Final[dict[str, dict[str, int | float]]] = {
    "HEARTBEAT": {"type": 1, "autopilot": 3, "base_mode": 128, "custom_mode": 5,
                  "system_status": 4, "mavlink_version": 3},
    "VFR_HUD": {"airspeed": 25.0, "groundspeed": 26.0, "throttle": 50, "alt": 100.0},
    "SERVO_OUTPUT_RAW": {f"servo{i}_raw": 1500 for i in (1, 2, 3)},
}  # fmt: skip


def write_log(
    path: Path,
    hours: float,
    seed: int = 1,
    moved_s: float = 1.0,
    every_s: float = 1.0,
    *,
    start_us: int = START_US,
) -> None:
    """Write a flight of whole seconds whose rudder moves for ``moved_s`` in every ``every_s``.

    By default the rudder always moves. ``start_us`` (us since 1970) is when the vehicle was
    switched on.
    """
    rng, second, encoder = np.random.default_rng(seed), np.arange(round(3600 * hours)), Encoder()
    n = len(second) * RATE_HZ
    u = np.repeat(rng.choice([-0.2, 0.0, 0.2], n // 10 + 1), 10)[:n]
    u = np.where(np.arange(n) / RATE_HZ % every_s < moved_s, u, 0.0)
    rate = lfilter(*PLANT, u) + 0.002 * rng.normal(size=n)
    yaw = (np.cumsum(rate) / RATE_HZ + np.pi) % (2.0 * np.pi) - np.pi
    flight = {"servo4_raw": 1500 + np.round(400 * u), "yawspeed": rate, "yaw": yaw}
    frames = sorted(
        (sample * 1_000_000 // RATE_HZ + 400 * phase, name, sample)
        for phase, (name, hz) in enumerate(MIX.items())
        for sample in range(0, RATE_HZ, RATE_HZ // hz)
    )
    rows = np.zeros(
        len(second), [(f"{after_us} {name}", _kind(name)) for after_us, name, _ in frames]
    )
    for i, (after_us, name, sample) in enumerate(frames):
        of = {key: each[sample::RATE_HZ] for key, each in flight.items()}
        known = _FIELDS.get(name, {}) | of if name in WANTED else None
        boot_us, number = 1_000_000 * (10 + second) + after_us, 4 + i + len(frames) * second
        rows[f"{after_us} {name}"] = packed(name, boot_us, number, start_us, known, rng)
    parameters = {"FUNCTION": 21, "MIN": 1100, "MAX": 1900, "TRIM": 1500}
    sent = [mavlink.MAVLink_param_value_message(f"SERVO4_{name}".encode(), value, 9, 4, i)
            for i, (name, value) in enumerate(parameters.items())]  # fmt: skip
    with path.open("wb") as out:
        out.write(join((start_us + i, encoder.frame(each)) for i, each in enumerate(sent)))
        rows.tofile(out)


def packed(
    name: str,
    boot_us: NDArray[np.int64],
    number: NDArray[np.int64],
    start_us: int,
    known: dict[str, Any] | None,
    rng: np.random.Generator | None = None,
) -> NDArray[Any]:
    """Return the records of one message (n,), sent at ``boot_us`` as these numbers of the link.

    ``known`` are fields and their values; without them the payload is random. The receiver's clock
    is ``start_us`` when the vehicle's is 0.
    """
    of = np.zeros(len(boot_us), _kind(name))
    data = of.view(np.uint8).reshape(len(of), -1)
    payload, size = of["payload"], of.itemsize
    of["stamp"], of["magic"], of["length"] = start_us + boot_us, 0xFD, payload.itemsize
    of["seq"], of["ids"] = number % 256, 1
    of["message"] = list(CLASSES[name].id.to_bytes(3, "little"))
    if known is None and rng is not None:  # all but stamp, header and CRC
        data[:, 18:-2] = rng.integers(0, 256, (len(of), payload.itemsize))
    given = {"time_boot_ms": boot_us // 1000, "time_usec": boot_us} | (known or {})
    for field in given.keys() & (payload.dtype.names or ()):
        payload[field] = given[field]
    at, extra = size * np.arange(len(of)), np.full(len(of), CLASSES[name].crc_extra, np.uint8)
    of["crc"] = crc_of_frames(data.ravel(), at + 9, at + size - 2, extra)
    return of


def _kind(name: str) -> np.dtype[Any]:
    """Return the dtype of a message's record, whose payload has no extension fields."""
    length, own = int(definitions().fits_v1[definitions().names[name]].argmax()), dtype_of(name)
    fields = {field: of for field, of in (own.fields or {}).items() if of[1] < length}
    formats, offsets = ([of[i] for of in fields.values()] for i in (0, 1))
    payload: Any = {"names": [*fields], "formats": formats, "offsets": offsets, "itemsize": length}
    return np.dtype([
        ("stamp", ">u8"), ("magic", "u1"), ("length", "u1"), ("flags", "u1", 2), ("seq", "u1"),
        ("ids", "u1", 2), ("message", "u1", 3), ("payload", np.dtype(payload)), ("crc", "<u2"),
    ])  # fmt: skip
