"""The blocks that the stages exchange: frozen structs of arrays, one row per message or sample.

A block may have any length >= 1. A block of a replay has thousands of rows, a live one often a
single row, and no result depends on where the stream was cut into blocks.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from itertools import pairwise
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Bools = NDArray[np.bool_]
Array = NDArray[Any]
"""An array of any type, also of rows with named columns."""

FIRST_DATE_US = 10**15
"""The Unix time of September 2001 in us: an earlier time counts from boot."""
FIRST_DATE_NS = 1000 * FIRST_DATE_US


def runs_of(good: Bools) -> Ints:
    """Return where each run of True in ``good`` (n,) begins and ends, (runs, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    return edges.reshape(-1, 2)


def shifted(x: Floats, count: int) -> Floats:
    """Return x (n,) shifted by ``count`` samples, later if positive; NaN beyond the ends."""
    found = np.full(len(x), np.nan)
    if 0 <= count < len(x):
        found[count:] = x[: len(x) - count]
    elif -len(x) < count < 0:
        found[:count] = x[-count:]
    return found


def euler(w: Floats, x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
    """Return roll, pitch and yaw in rad (n,) of unit quaternions (n,) each, from body to north."""
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw


def window_of(sample_time_s: float) -> int:
    """Return the number of samples in 5 s, the window of excitation; 2 at least."""
    return max(2, round(WINDOW_S / sample_time_s))


def strokes(u: Floats, window: int, before: Floats | None = None) -> Floats:
    """Return how far ``u`` (n,) moved within the last ``window`` samples, at each of them (n,).

    ``before`` (m,) has the values before them. If these are fewer than a window, the first known
    value counts for the time before it.
    """
    carried = u[:0] if before is None else before[-(window - 1) :]
    known = np.concatenate([carried, u])
    padded = np.concatenate([np.full(window - 1 - len(carried), known[0]), known])
    return extremes(np.maximum, padded, window) - extremes(np.minimum, padded, window)


def extremes(of_two: np.ufunc, x: Floats, window: int) -> Floats:
    """Return the extreme of each ``window`` values of x (n,), (n - window + 1,).

    ``of_two`` is ``np.maximum`` or ``np.minimum``; the width is doubled until it is reached.
    """
    width = 1
    while 2 * width <= window:
        x, width = of_two(x[:-width], x[width:]), 2 * width
    rest = window - width
    found: Floats = of_two(x[: len(x) - rest], x[rest:])
    return found


class Columns:
    """A struct of arrays with equal rows; a field that is no array is common to all rows."""

    __slots__: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(getattr(self, self.__slots__[-1]))

    def select(self, rows: Array | slice) -> Self:
        """Return the rows chosen by a mask (n,), an index array (m,) or a slice."""
        if isinstance(rows, np.ndarray) and rows.dtype == bool:
            count, rows = len(rows), np.flatnonzero(rows)
            if len(rows) == count:
                return self  # a live block is usually taken as a whole: copies would cost too much
        values = [getattr(self, name) for name in self.__slots__]
        for i, v in enumerate(values):
            if isinstance(v, np.ndarray):
                values[i] = v[rows]
            elif isinstance(v, Columns):
                values[i] = v.select(rows)
        return type(self)(*values)

    @classmethod
    def joined(cls, blocks: Sequence[Self]) -> Self:
        """Return the rows of several blocks (at least one) as one block, in their order."""
        first = blocks[0]
        if len(blocks) == 1:
            return first
        columns = [[getattr(block, name) for block in blocks] for name in cls.__slots__]
        return cls(
            *(
                np.concatenate(each) if isinstance(each[0], np.ndarray)
                else type(each[0]).joined(each) if isinstance(each[0], Columns)
                else each[0]
                for each in columns
            )
        )  # fmt: skip


class Status(IntEnum):
    """The state that an estimator reports of its estimate."""

    WARMING_UP = 0
    TRACKING = 1
    HELD = 2
    DIVERGED = 3


class Held(IntFlag):
    """Why a sample must not update the estimators; several reasons may apply at once."""

    NONE = 0
    GAP = 1  # a gap in the messages or a silence ends
    REBOOT = 2  # the clock has stepped back
    RUDDER_INVALID = 4  # the value is missing or absurd
    YAW_INVALID = 8
    RUDDER_CHANGED = 16  # the output or the scale of the rudder changes here
    ON_GROUND = 32  # the aircraft does not fly, or still rolls
    NO_AIRSPEED = 64  # --turn remove needs an airspeed and has none
    HOVER = 128  # a VTOL hovers
    LIFT_MOTORS = 256  # motors that only lift are driven
    STEEP = 512  # bank or pitch beyond 60 degrees


class Noted(IntFlag):
    """Notes on a sample that updates the estimators all the same."""

    NONE = 0
    SATURATED = 1  # the rudder is at its stop
    MODE_CHANGED = 2  # the flight mode changes
    AIRSPEED_CHANGED = 4  # it differs from its mean over a minute
    NOT_EXCITED = 8  # the rudder has rested for 5 s
    GROUND_SPEED = 16  # the ground speed stands in for the airspeed


AIRSPEED_SHARE: Final = 0.1
"""An airspeed has changed if it differs by more than this part from its mean."""
LEAST_TRAVEL: Final = 0.02
"""A rudder that stays within this part of half its travel for ``WINDOW_S`` has not moved."""
WINDOW_S: Final = 5.0
"""The window in s within which the rudder's movement counts."""


def words(member: IntEnum | IntFlag) -> str:
    """Return the name of a status or of one flag in words: ``on ground``."""
    return str(member.name).lower().replace("_", " ")


def flag_names(flags: IntFlag) -> str:
    """Return the names of the flags that are set, separated by spaces: ``on_ground steep``."""
    return " ".join(str(flag.name).lower() for flag in flags)


def finite(values: dict[str, Any]) -> dict[str, Any]:
    """Return the entries that are finite as floats: in JSON a missing entry does not apply."""
    return {name: float(value) for name, value in values.items() if np.isfinite(value)}


@dataclass(frozen=True, slots=True)
class MessageBlock(Columns):
    """Messages of one type, in the order received.

    ``order`` (n,), the place, is the byte at which the record starts in the stream; messages of all
    types are sorted by it. ``received_us`` (n,) is the receive stamp in us of Unix time, ``sysid``
    and ``compid`` (n,) are the sender, and ``fields`` (n,) is a structured array with a column for
    each MAVLink field, under its own name.
    """

    name: str
    order: Ints
    received_us: Ints
    sysid: Bytes
    compid: Bytes
    fields: Array


@dataclass(frozen=True, slots=True)
class FrameBlock:
    """The wanted messages of one stretch by name, each a block of (n,) rows, n >= 1."""

    messages: Mapping[str, MessageBlock]


@dataclass(frozen=True, slots=True)
class RecordBlock(Columns):
    """Rows of a record that never was MAVLink, in order: see ``quantities/table.py``.

    Each row has, (n,), with NaN for unknown values:

    - ``order``: its place; ``t_us``: time since the record's beginning in us; ``received_us``: Unix
      time in us, the same as ``t_us`` where no date is known;
    - ``has_yaw`` and ``has_surfaces``. A row with neither marks a new beginning after it, and its
      ``held`` says why;
    - ``rudder`` in half travels or in rad, signed as in the file; ``aileron`` in half travels;
    - rates in rad/s and angles in rad, the yaw not unwrapped; ``ay`` in m/s^2;
    - ``airspeed`` in m/s; ``by_ground``: 1 where it is the ground speed; ``airspeed_kind``,
      ``ground_speed`` and ``rudder_moves`` (only of a run's export) as in :class:`SampleBlock`;
    - ``held``: all bits of :class:`Held` that apply, or -1 where the record does not have them.

    Common to all rows: ``called`` has the record's names of the channels, ``modes_of`` the
    autopilot and vehicle type that name the flight modes, ``assumed`` the columns with an assumed
    unit, ``measured`` the surfaces that follow straight lines between rows; the others are held.
    """

    called: Mapping[str, str]
    modes_of: tuple[int, int]
    assumed: tuple[str, ...]
    measured: tuple[str, ...]
    order: Ints
    received_us: Ints
    t_us: Ints
    has_yaw: Bools
    has_surfaces: Bools
    held: Ints
    rudder: Floats
    aileron: Floats
    r: Floats
    p: Floats
    q: Floats
    roll: Floats
    pitch: Floats
    yaw: Floats
    ay: Floats
    turn_rate: Floats
    airspeed: Floats
    by_ground: Floats
    altitude: Floats
    on_ground: Floats
    mode: Floats
    rudder_moves: Floats
    ground_speed: Floats
    airspeed_kind: Floats


@dataclass(frozen=True, slots=True)
class SampleBlock(Columns):
    """Samples on the uniform grid ``t_k = k * sample_time_s`` of vehicle time.

    Each row has, (n,) unless another shape is given, with NaN for unknown values:

    - ``sample_time_s``, one number: the grid's Ts in s;
    - ``k``: the instant's number on the grid; ``boot_us``: the instant in us since boot;
      ``unix_ns``: the instant in ns of Unix time, never decreasing;
    - ``received_us``: receive stamp (us of Unix time) of the message that completed the sample;
    - ``u`` (n, n_inputs): mean deflection over ``[t_k, t_k+1)`` in units of half the travel, the
      rudder's in rad with ``--rudder-max-deg``; NaN where held;
    - ``y``: the output at ``t_k``, yaw rate or heading rate in rad/s; NaN where held;
    - ``yaw`` (unwrapped) and ``roll`` in rad at ``t_k``;
    - ``turn_rate``: the turn rate in rad/s implied by bank and airspeed; ``airspeed`` in m/s;
    - ``noted``, ``held``: bits of :class:`Noted` and :class:`Held`; ``held`` is 0 if it updates;
    - ``epoch``: how often the meaning of ``u`` has changed; the estimators start again each time;
    - ``aileron``: mean deflection in units of half its travel, whether it is an input or not;
    - ``mode``: HEARTBEAT.custom_mode; ``on_ground``: 1 or 0; ``altitude`` in m above the sea;
    - ``rudder_moves``: 1 where an input moved within the sample, so that ``u`` lies in between;
    - ``ground_speed`` in m/s; ``airspeed_kind``: a :class:`yawid.quantities.airspeed.Kind`.
    """

    sample_time_s: float
    k: Ints
    boot_us: Ints
    unix_ns: Ints
    received_us: Ints
    u: Floats
    y: Floats
    yaw: Floats
    roll: Floats
    turn_rate: Floats
    airspeed: Floats
    noted: Ints
    held: Ints
    epoch: Ints
    aileron: Floats
    mode: Floats
    on_ground: Floats
    altitude: Floats
    rudder_moves: Floats
    ground_speed: Floats
    airspeed_kind: Floats

    def epochs(self) -> "Iterator[SampleBlock]":
        """Yield the stretches with one epoch each; nothing where there is no row."""
        edges = [0, *(np.flatnonzero(np.diff(self.epoch)) + 1).tolist(), len(self)]
        return (self.select(slice(a, b)) for a, b in pairwise(edges) if b > a)


@dataclass(frozen=True, slots=True)
class StampedRows(Columns):
    """Rows of one kind of message at their own times: not on a grid, and not filtered.

    ``t_us`` (n,) is the time since boot in us, ``unix_ns`` (n,) that in ns of Unix time, which
    never decreases; ``values`` (n, m) has a column for each name in :class:`MotionBlock`.
    """

    t_us: Ints
    unix_ns: Ints
    values: Floats


@dataclass(frozen=True, slots=True)
class MotionBlock(Columns):
    """The lateral motion as it was measured and commanded, next to the samples.

    - ``attitude``: roll and pitch in rad, p, q and r in rad/s, always finite;
    - ``commands``: rudder and aileron in the units of :class:`SampleBlock`, NaN where unknown, the
      ``epoch``, and 1 where the times are those of messages, 0 where they are a record's rows;
    - ``acceleration``: ay in m/s^2, and the time in us of the next attitude received after it.
    """

    attitude: StampedRows
    commands: StampedRows
    acceleration: StampedRows

    def __len__(self) -> int:
        return len(self.attitude) + len(self.commands) + len(self.acceleration)


Y_HAT, INNOVATION, RESIDUAL, NOISE_STD, STATUS, SCALARS = range(6)
"""The places of the scalars in a row of an :class:`EstimateBlock`, after theta and theta_std."""


def estimate_width(p: int, covariance: bool) -> int:
    """Return the number of columns of such a row for p parameters."""
    return 2 * p + SCALARS + (p * p if covariance else 0)


@dataclass(frozen=True, slots=True)
class EstimateBlock:
    """The estimates of one estimator for a block of samples, a row each.

    The fields are columns of ``rows`` (n, 2 p + 5), or (n, 2 p + 5 + p p) with the covariance, as
    the recursion writes them: cutting them apart would cost too much for a short live block. ``p``
    is the number of parameters. Units are those of u and y: see :class:`SampleBlock`.
    """

    rows: Floats
    p: int

    @classmethod
    def of(
        cls,
        theta: Floats,
        theta_std: Floats,
        covariance: Floats | None,
        y_hat: Floats,
        innovation: Floats,
        residual: Floats,
        noise_std: Floats,
        status: Array,
    ) -> "EstimateBlock":
        """Return the block with these fields: (n, p), (n, p), (n, p, p) or None, then (n,) each."""
        n, p = theta.shape
        last = () if covariance is None else (covariance.reshape(n, p * p),)
        columns = (theta, theta_std, y_hat, innovation, residual, noise_std, status, *last)
        return cls(np.column_stack(columns).astype(np.float64, copy=False), p)

    def row(self, at: int) -> "EstimateBlock":
        """Return the estimate of one sample as a block."""
        return EstimateBlock(self.rows[at : at + 1], self.p)

    @property
    def theta(self) -> Floats:
        """The parameters (n, p) in the user's units."""
        return self.rows[:, : self.p]

    @property
    def theta_std(self) -> Floats:
        """The standard deviations (n, p) of theta."""
        return self.rows[:, self.p : 2 * self.p]

    @property
    def covariance(self) -> Floats | None:
        """The covariance (n, p, p) of theta, None where it was not asked for."""
        rest = self.rows[:, 2 * self.p + SCALARS :]
        return rest.reshape(-1, self.p, self.p) if rest.size else None

    @property
    def y_hat(self) -> Floats:
        """The one-step prediction (n,) of y."""
        return self.rows[:, 2 * self.p + Y_HAT]

    @property
    def innovation(self) -> Floats:
        """The a priori error (n,), y - y_hat."""
        return self.rows[:, 2 * self.p + INNOVATION]

    @property
    def residual(self) -> Floats:
        """The a posteriori error (n,)."""
        return self.rows[:, 2 * self.p + RESIDUAL]

    @property
    def noise_std(self) -> Floats:
        """The standard deviation (n,) of the innovation."""
        return self.rows[:, 2 * self.p + NOISE_STD]

    @property
    def status(self) -> Bytes:
        """The numbers (n,) of :class:`Status`."""
        return self.rows[:, 2 * self.p + STATUS].astype(np.uint8)

    @property
    def without_covariance(self) -> Floats:
        """The columns before the covariance (n, 2 p + 5)."""
        return self.rows[:, : 2 * self.p + SCALARS]

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, slots=True)
class ModesBlock(Columns):
    """The continuous poles of each estimate and the Dutch roll among them; NaN where there is none.

    ``poles`` (n, na) are complex, in rad/s. By pole there are ``wn``, ``wn_std`` (n, na) in rad/s
    and ``zeta``, ``zeta_std`` (n, na) without unit. ``dutch_roll`` (n, 4) has wn and wn_std in
    rad/s, zeta and zeta_std. ``yaw`` and ``yaw_std`` (n, 9) are the numbers of paper eq. 22-23 and
    the servo's lag, in the order and units of :data:`yawid.physics.derivatives.NAMES`; both are
    empty, (n, 0), where they were not computed.
    """

    poles: NDArray[np.complex128]
    wn: Floats
    wn_std: Floats
    zeta: Floats
    zeta_std: Floats
    dutch_roll: Floats
    yaw: Floats
    yaw_std: Floats
