"""What the readers of on-board logs share: the messages they make, and the check of their times.

Each dtype has those fields of the MAVLink message of its name that the channels read and that a log
can report. Times have 64 bits of microseconds in all of them, since the logs are that exact.
ACCELERATION, in m/s^2, is no MAVLink message: one of an IMU would be a source of the yaw rate, too.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import Array, Bools, Floats, FrameBlock, Ints, MessageBlock
from yawid.sources.logs.tlog import CHUNK

PlacedFields = tuple[Ints, Array]
"""The places of a message's rows (n,), in us since boot or in bytes, and their fields (n,)."""
COMPID = 1
"""MAV_COMP_ID_AUTOPILOT1, which writes an on-board log."""
STRAY_US = 10_000_000
"""A time that is further than this from its neighbours' is damaged."""
ANGLES_GAP_US = 1_000_000
"""The longest stretch without attitude over which angles are interpolated."""
FIX_3D = 3
"""GPS_FIX_TYPE from which on a ground speed or a date of GPS is believed."""
NONE = np.zeros(0, np.int64)
"""The places of a message that a log does not have."""

_TIME = ("time_usec", "<u8")
DTYPES = {
    "HEARTBEAT": np.dtype(
        [("type", "u1"), ("autopilot", "u1"), ("base_mode", "u1"), ("custom_mode", "<u4")]
    ),
    "PARAM_VALUE": np.dtype([("param_id", "S16"), ("param_value", "<f8")]),
    "VFR_HUD": np.dtype(
        [(name, "<f8") for name in ("airspeed", "groundspeed", "alt", "airspeed_kind")]
    ),
    "EXTENDED_SYS_STATE": np.dtype([("vtol_state", "u1"), ("landed_state", "u1")]),
    "ATTITUDE": np.dtype(
        [_TIME]
        + [(name, "<f8") for name in ("roll", "pitch", "yaw")]
        + [(name, "<f8") for name in ("rollspeed", "pitchspeed", "yawspeed")]
    ),
    "ACCELERATION": np.dtype([_TIME, ("yacc", "<f8")]),
    "SERVO_OUTPUT_RAW": np.dtype(
        [_TIME, ("port", "u1")] + [(f"servo{i}_raw", "<f4") for i in range(1, 17)]
    ),
    "RC_CHANNELS": np.dtype([_TIME] + [(f"chan{i}_raw", "<f4") for i in range(1, 19)]),
    "ACTUATOR_CONTROL_TARGET": np.dtype([_TIME, ("group_mlx", "u1"), ("controls", "<f4", (8,))]),
    "HIL_ACTUATOR_CONTROLS": np.dtype([_TIME, ("controls", "<f4", (16,))]),
}


def quiet() -> np.errstate:
    """Return a context without warnings: damaged bytes may be any number, also signalling NaNs."""
    return np.errstate(invalid="ignore", over="ignore")


@quiet()
def table(name: str, rows: int, **columns: Any) -> Array:
    """Return the fields of a message (rows,); fields that are not given are zero."""
    fields = np.zeros(rows, DTYPES[name])
    for column, values in columns.items():
        fields[column] = values
    return fields


def message(name: str, order: Ints, received_us: Ints, fields: Array, sysid: int) -> MessageBlock:
    """Return rows (n,) of a message from the vehicle ``sysid``; ``received_us`` is Unix time."""
    sysids, compids = (np.full(len(order), number, np.uint8) for number in (sysid, COMPID))
    return MessageBlock(name, order, received_us, sysids, compids, fields)


def within(block: MessageBlock, low: int, high: int) -> MessageBlock:
    """Return the rows whose ``order`` is in [low, high)."""
    first, stop = np.searchsorted(block.order, (low, high))
    return block.select(slice(int(first), int(stop)))


def frame_block(blocks: Iterable[MessageBlock]) -> FrameBlock | None:
    """Return the blocks that have rows as one, None where no block has any."""
    found = {block.name: block for block in blocks if len(block)}
    return FrameBlock(found) if found else None


def in_pieces(path: Path, rows: int) -> Iterator[tuple[int, int, int]]:
    """Yield the size of each piece of a file, and the first and last of its share of the rows."""
    size = path.stat().st_size
    count = size // CHUNK + 1
    for i in range(count):
        yield min(CHUNK, size - i * CHUNK), rows * i // count, rows * (i + 1) // count


def steady(t_us: Ints) -> Bools:
    """Return which times (n,) agree with their neighbours: within 10 s of the median of five.

    A pause of the log is no damage: next to it, most of the five are on the same side of it.
    """
    from scipy.ndimage import median_filter  # takes 0.1 s: a telemetry log must not pay for it

    away: Ints = np.abs(t_us - median_filter(t_us, 5, mode="reflect"))
    return away <= STRAY_US


def hold_last(opening: tuple[float, ...], *parts: tuple[Ints, Floats]) -> tuple[Ints, list[Floats]]:
    """Return columns that have places of their own as columns at all places, the last value held.

    Each of the ``parts`` has places (m,) and values (m,). Returned are the places (n,) and each
    column (n,). The first row, at place -1, is the ``opening``; each place has one row.
    """
    places = np.unique(np.concatenate([[-1], *(own for own, _ in parts)]))
    columns = []
    for first, (own, values) in zip(opening, parts, strict=True):
        known = ~np.isnan(values)
        at, held = np.append(-1, own[known]), np.append(first, values[known])
        in_place = np.argsort(at, kind="stable")
        newest = np.searchsorted(at[in_place], places, side="right") - 1
        columns.append(held[in_place][newest])
    return places, columns


def merged(
    name: str, before: float, /, common: Mapping[str, float] | None = None,
    **columns: tuple[Ints, Floats],
) -> PlacedFields:  # fmt: skip
    """Return a message at each place at which one of its columns is reported, the others held.

    Each column has places (n,) and values (n,) of its own, and is ``before`` until its first value;
    those in ``common`` are the same at all places.
    """
    places, values = hold_last((before,) * len(columns), *columns.values())
    known = {column: own[1:] for column, own in zip(columns, values, strict=True)}
    return places[1:], table(name, len(places) - 1, **known, **(common or {}))


def forward(t_us: Ints) -> Bools:
    """Return which of times (n,) are later than all before them."""
    before = np.maximum.accumulate(np.append(np.iinfo(np.int64).min, t_us))[:-1]
    return np.asarray(t_us > before)


def between(
    t_us: Ints, known_us: Ints, values: Floats, gap_us: float, *, is_angle: bool = False
) -> Floats:
    """Return values at the instants ``t_us`` (n,), interpolated between the known ones (m,).

    An angle goes the shorter way. NaN outside all that is known, and where the two values around an
    instant are more than ``gap_us`` apart.
    """
    rows = forward(known_us)
    known_us, values = known_us[rows], values[rows]
    if len(known_us) < 2:
        return np.full(len(t_us), np.nan)
    turned = np.unwrap(values) if is_angle else values
    found = np.interp(t_us, known_us, turned, np.nan, np.nan)
    after = np.clip(np.searchsorted(known_us, t_us), 1, len(known_us) - 1)
    found[known_us[after] - known_us[after - 1] > gap_us] = np.nan
    return found


def angles_at(
    t_us: Ints, known_us: Ints, roll: Floats, pitch: Floats, yaw: Floats
) -> dict[str, Floats]:
    """Return roll, pitch and yaw in rad (n,) at the instants ``t_us`` (n,): see :func:`between`.

    They are NaN where two attitudes (m,) are more than a second apart.
    """
    of = t_us, known_us
    level = {"roll": roll, "pitch": pitch}
    found = {name: between(*of, angle, ANGLES_GAP_US) for name, angle in level.items()}
    turned = between(*of, yaw, ANGLES_GAP_US, is_angle=True)
    return found | {"yaw": (turned + np.pi) % (2.0 * np.pi) - np.pi}
