"""The values that travel: frozen structs of arrays, one row per message or sample.

A block may have any length >= 1. A replay block holds thousands of rows, a live block often one,
and no result depends on how the stream was cut into blocks.
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
"""An array of whatever type, rows with named columns too."""

FIRST_DATE_US = 10**15
"""Unix time of September 2001: what is earlier is a time since boot, as no flight is as early."""
FIRST_DATE_NS = 1000 * FIRST_DATE_US


def runs_of(good: Bools) -> Ints:
    """Return where each run of True in ``good`` (n,) begins and ends, (runs, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    return edges.reshape(-1, 2)


def shifted(x: Floats, count: int) -> Floats:
    """Return x (n,) ``count`` samples later, earlier where negative; NaN beyond the ends."""
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
    """Return the samples in a window of excitation."""
    return max(2, round(WINDOW_S / sample_time_s))


def strokes(u: Floats, window: int, before: Floats | None = None) -> Floats:
    """Return how far ``u`` (n,) moved within the last ``window`` samples, at each of them (n,).

    ``before`` (m,) are the values that came before; where there are fewer than a window, the first
    is taken to have lasted.
    """
    carried = u[:0] if before is None else before[-(window - 1) :]
    known = np.concatenate([carried, u])
    padded = np.concatenate([np.full(window - 1 - len(carried), known[0]), known])
    return extremes(np.maximum, padded, window) - extremes(np.minimum, padded, window)


def extremes(of_two: np.ufunc, x: Floats, window: int) -> Floats:
    """Return the extreme of each ``window`` values of x (n,), (n - window + 1,), by doubling."""
    width = 1
    while 2 * width <= window:
        x, width = of_two(x[:-width], x[width:]), 2 * width
    rest = window - width
    found: Floats = of_two(x[: len(x) - rest], x[rest:])
    return found


class Columns:
    """A struct of arrays, a row each; what is no array is common to all rows."""

    __slots__: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(getattr(self, self.__slots__[-1]))

    def select(self, rows: Array | slice) -> Self:
        """Return the rows chosen by a mask (n,), an index array (m,) or a slice."""
        if (
            isinstance(rows, np.ndarray)
            and rows.dtype == bool
            and np.count_nonzero(rows) == len(rows)
        ):
            return self  # the usual case of a live block, which is too short to pay for copies
        values = [getattr(self, name) for name in self.__slots__]
        return type(self)(
            *[v[rows] if isinstance(v, np.ndarray) else _select(v, rows) for v in values]
        )

    @classmethod
    def joined(cls, blocks: Sequence[Self]) -> Self:
        """Return the rows of several blocks (at least one), one after the other."""
        first = blocks[0]
        if len(blocks) == 1:
            return first
        columns = [[getattr(block, name) for block in blocks] for name in cls.__slots__]
        return cls(*[np.concatenate(c) if isinstance(c[0], np.ndarray) else c[0] for c in columns])


def _select(value: Any, rows: Array | slice) -> Any:
    return value.select(rows) if isinstance(value, Columns) else value


class Status(IntEnum):
    """What an estimator says of its own estimate."""

    WARMING_UP = 0
    TRACKING = 1
    HELD = 2
    DIVERGED = 3


class Held(IntFlag):
    """Why a sample must not update the estimators; several may hold at once."""

    NONE = 0
    GAP = 1
    REBOOT = 2
    RUDDER_INVALID = 4
    YAW_INVALID = 8
    RUDDER_CHANGED = 16
    ON_GROUND = 32
    NO_AIRSPEED = 64
    HOVER = 128
    LIFT_MOTORS = 256
    STEEP = 512


class Noted(IntFlag):
    """What is worth knowing of a sample that updates the estimators all the same."""

    NONE = 0
    SATURATED = 1
    MODE_CHANGED = 2
    AIRSPEED_CHANGED = 4
    NOT_EXCITED = 8
    GROUND_SPEED = 16


AIRSPEED_SHARE: Final = 0.1
"""An airspeed that differs by more than this from its mean is another one."""
LEAST_TRAVEL: Final = 0.02
"""A rudder that stays within this part of half its travel has not been moved."""
WINDOW_S: Final = 5.0
"""... in this time."""


def words(member: IntEnum | IntFlag) -> str:
    """Return the name of a status or of one flag as a person reads it: ``on ground``."""
    return str(member.name).lower().replace("_", " ")


def flag_names(flags: IntFlag) -> str:
    """Return the names of the flags that are set, by spaces: ``on_ground steep``."""
    return " ".join(str(flag.name).lower() for flag in flags)


def finite(values: dict[str, Any]) -> dict[str, Any]:
    """Return the entries that are finite, as floats: in JSON absent means not applicable."""
    return {name: float(value) for name, value in values.items() if np.isfinite(value)}


@dataclass(frozen=True, slots=True)
class MessageBlock(Columns):
    """Messages of one type, in the order received.

    ``order`` (n,) is the byte at which the record starts in the stream: it sorts messages of all
    types. ``received_us`` (n,) is the receive stamp in microseconds of Unix time, ``sysid`` and
    ``compid`` (n,) the sender, ``fields`` (n,) a structured array with one column per MAVLink field
    under its own name.
    """

    name: str
    order: Ints
    received_us: Ints
    sysid: Bytes
    compid: Bytes
    fields: Array


@dataclass(frozen=True, slots=True)
class FrameBlock:
    """The wanted messages of one stretch of the stream.

    ``messages`` has a block of (n,) rows, n >= 1, by message name; a name that is absent had none.
    """

    messages: Mapping[str, MessageBlock]


@dataclass(frozen=True, slots=True)
class RecordBlock(Columns):
    """Rows of a record that never was MAVLink, in order: see ``quantities/table.py``.

    Of each row, (n,), unknown values being NaN: ``order``, its place; ``t_us`` since the record's
    beginning and ``received_us`` of Unix time, the same where no date is known; whether it
    ``has_yaw`` and ``has_surfaces``. A row without either says that something begins anew after it:
    its ``held`` says why. ``rudder`` is in half travels or in rad, signed as in the file,
    ``aileron`` in half travels; rates in rad/s, angles in rad, the yaw not unwrapped; airspeed in
    m/s, ``by_ground`` 1 where it is the ground speed, ``airspeed_kind`` and ``ground_speed`` as in
    :class:`SampleBlock`. ``held`` has the bits of :class:`Held`, all
    of them, or is -1 where the record does not say.

    Common to all rows: what each channel is called there, and by whom its flight modes are named
    (autopilot and vehicle type), and of which columns the unit was ``assumed``.
    """

    called: Mapping[str, str]
    modes_of: tuple[int, int]
    assumed: tuple[str, ...]
    order: Ints
    received_us: Ints
    t_us: Ints
    has_yaw: Bools
    has_surfaces: Bools
    held: Ints
    rudder: Floats
    aileron: Floats
    r: Floats
    q: Floats
    roll: Floats
    pitch: Floats
    yaw: Floats
    turn_rate: Floats
    airspeed: Floats
    by_ground: Floats
    altitude: Floats
    on_ground: Floats
    mode: Floats
    ground_speed: Floats
    airspeed_kind: Floats


@dataclass(frozen=True, slots=True)
class SampleBlock(Columns):
    """Samples on the uniform grid ``t_k = k * sample_time_s`` of vehicle time.

    Of each row, (n,) unless another shape is given; unknown values are NaN:

    - ``sample_time_s``, one number: the grid's Ts in s;
    - ``k``: the instant's number on the grid; ``boot_us``: the same as us since boot; ``unix_ns``:
      mapped to ns of Unix time, never decreasing;
    - ``received_us``: receive stamp (us of Unix time) of the message that completed the sample;
    - ``u`` (n, n_inputs): mean deflection over ``[t_k, t_k+1)`` in units of half the travel, the
      rudder's in rad with ``--rudder-max-deg``; NaN where held;
    - ``y``: the output at ``t_k``, yaw rate or heading rate in rad/s; NaN where held;
    - ``yaw`` (unwrapped) and ``roll`` in rad at ``t_k``;
    - ``turn_rate``: that in rad/s which bank and airspeed imply; ``airspeed`` in m/s;
    - ``noted``, ``held``: bits of :class:`Noted` and of :class:`Held`, which is 0 for what updates;
    - ``epoch``: how often the meaning of ``u`` has changed; with each the estimators start again;
    - ``aileron``: mean deflection in units of half its travel, whether it is an input or not;
    - ``mode``: HEARTBEAT.custom_mode; ``on_ground``: 1 or 0; ``altitude`` in m above the sea;
    - ``ground_speed`` in m/s; ``airspeed_kind``: number of :class:`yawid.quantities.airspeed.Kind`.
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
    ground_speed: Floats
    airspeed_kind: Floats

    def epochs(self) -> "Iterator[SampleBlock]":
        """Yield the stretches of one epoch each, none where there is no row."""
        edges = [0, *(np.flatnonzero(np.diff(self.epoch)) + 1).tolist(), len(self)]
        return (self.select(slice(a, b)) for a, b in pairwise(edges) if b > a)


Y_HAT, INNOVATION, RESIDUAL, NOISE_STD, STATUS, SCALARS = range(6)
"""Where the scalars stand in a row of an :class:`EstimateBlock` after theta and theta_std."""


def estimate_width(p: int, covariance: bool) -> int:
    """Return the columns of such a row for p parameters."""
    return 2 * p + SCALARS + (p * p if covariance else 0)


@dataclass(frozen=True, slots=True)
class EstimateBlock:
    """What one estimator made of a block of samples, a row each.

    The fields are columns of ``rows`` (n, 2 p + 5), or (n, 2 p + 5 + p p) with the covariance, as
    the recursion writes them: a live block is too short to pay for cutting what nobody reads. ``p``
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
        """Return the block of these fields: (n, p), (n, p), (n, p, p) or None, and five of (n,)."""
        n, p = theta.shape
        last = () if covariance is None else (covariance.reshape(n, p * p),)
        columns = (theta, theta_std, y_hat, innovation, residual, noise_std, status, *last)
        return cls(np.column_stack(columns).astype(np.float64, copy=False), p)

    @property
    def theta(self) -> Floats:
        """Parameters (n, p) in the user's units."""
        return self.rows[:, : self.p]

    @property
    def theta_std(self) -> Floats:
        """Their standard deviations (n, p)."""
        return self.rows[:, self.p : 2 * self.p]

    @property
    def covariance(self) -> Floats | None:
        """The covariance (n, p, p) of theta, or None where it was not asked for."""
        rest = self.rows[:, 2 * self.p + SCALARS :]
        return rest.reshape(-1, self.p, self.p) if rest.size else None

    @property
    def y_hat(self) -> Floats:
        """One-step prediction (n,) of y."""
        return self.rows[:, 2 * self.p + Y_HAT]

    @property
    def innovation(self) -> Floats:
        """The error (n,) a priori, y - y_hat."""
        return self.rows[:, 2 * self.p + INNOVATION]

    @property
    def residual(self) -> Floats:
        """The error (n,) a posteriori."""
        return self.rows[:, 2 * self.p + RESIDUAL]

    @property
    def noise_std(self) -> Floats:
        """Standard deviation (n,) of the innovation."""
        return self.rows[:, 2 * self.p + NOISE_STD]

    @property
    def status(self) -> Bytes:
        """See :class:`Status` (n,)."""
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

    ``poles`` (n, na) in rad/s (complex), ``wn``, ``wn_std`` (n, na) in rad/s and ``zeta``,
    ``zeta_std`` (n, na) without unit of each pole; ``dutch_roll`` (n, 4) holds wn and wn_std in
    rad/s, zeta and zeta_std of the Dutch roll. ``yaw`` and ``yaw_std`` (n, 9) are the numbers of
    paper eq. 22-23 and the servo's lag, in the order and units of
    :data:`yawid.physics.derivatives.NAMES`; both empty (n, 0) where nobody worked them out.
    """

    poles: NDArray[np.complex128]
    wn: Floats
    wn_std: Floats
    zeta: Floats
    zeta_std: Floats
    dutch_roll: Floats
    yaw: Floats
    yaw_std: Floats
