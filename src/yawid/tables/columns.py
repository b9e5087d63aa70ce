"""A run's blocks as columns, each with its unit and words from the table of quantities.

The names are those of records (``t``, ``rudder``, ``r``, ...), so that samples have the same names
in Python, in exported files, and in files that can be replayed.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import numpy as np

from yawid.answers.model_parts import Row, flat, flat_answer, with_sigmas
from yawid.answers.run_summary import Bare, RunSummary
from yawid.blocks import (
    FIRST_DATE_NS,
    Array,
    Bools,
    EstimateBlock,
    Floats,
    Held,
    MotionBlock,
    Noted,
    SampleBlock,
    StampedRows,
    Status,
    flag_names,
)
from yawid.config.run import RunConfig
from yawid.quantities.airspeed import name_of
from yawid.quantities.table import BY_GROUND, CHANNELS, OF_NOISE, RUDDER, YAW_CHANNEL, quantity
from yawid.quantities.units import unit_of_derivative
from yawid.sinks.base import Grid, RunRows
from yawid.sinks.mcap.answers import row_of, row_shapes
from yawid.sinks.mcap.schemas import MODE_VALUES
from yawid.tables.table import Column

OUTPUTS: Final = {
    "yaw-rate": ("r", "yaw rate"),
    "yaw": ("mean_heading_rate", "change of yaw over the interval before, by its length"),
}
"""The name and the meaning of the model's output, by ``--output``; only the yaw rate is ``r``."""
_GROUND: Final = -1.0
"""The code that stands for the ground speed among the kinds of airspeed."""
_TYPES: Final[Mapping[str, type]] = {"number": float, "boolean": bool, "integer": int}
"""Python's types for JSON's numbers; values of all other types become text."""


class Units:
    """The units and the words of a run's columns; ``output`` is the name of the model's output."""

    def __init__(self, grid: Grid, config: RunConfig) -> None:
        self.grid, self.config = grid, config
        name, says = OUTPUTS[config.output]
        if config.turn == "remove":
            name, says = f"{name}_less_turn", f"{says}, less the turn's"
        if config.band is not None:
            says += f", within {config.band[0]:g} to {config.band[1]:g} Hz, as the inputs are"
        self.output, self.output_says = name, says

    def column(self, name: str, values: Array, says: str = "", of: str = "") -> Column:
        """Return the column ``of`` a quantity, with its words unless ``says`` is given."""
        row = quantity(of or name)
        unit = row.unit.replace(RUDDER, self.grid.rudder_unit)
        return Column(name, values, unit, says or row.words)


def sample_columns(samples: SampleBlock, known: Units) -> Iterator[Column]:
    """Yield the measured columns, a row for each sample: the first columns of a record."""
    grid = known.grid
    mean = f"mean deflection over [t, t + {grid.sample_time_s:g} s), positive nose right"
    yield _channel("t", samples, known)
    rudder = samples.u[:, grid.inputs.index("rudder")]
    yield Column("rudder", rudder, grid.rudder_unit, mean)
    yield Column(known.output, samples.y, quantity("r").unit, known.output_says)
    for name in _FIRST[3:]:
        yield _channel(name, samples, known)


def further_columns(samples: SampleBlock, known: Units) -> Iterator[Column]:
    """Yield the remaining columns of a record, and the notes of each sample."""
    for name in (each for each in CHANNELS if CHANNELS[each].kept and each not in _FIRST):
        yield _channel(name, samples, known)
    yield Column(
        "noted",
        texts(samples.noted, lambda bits: flag_names(Noted(bits))),
        says="further notes on the sample",
    )


def motion_columns(
    samples: SampleBlock, motion: MotionBlock | None, known: Units
) -> Iterator[Column]:
    """Yield the lateral motion at the samples, on lines between its own times, if it was kept."""
    if motion is None:
        return
    for rows, names in ((motion.attitude, MOTION), (motion.acceleration, {"ay": 0})):
        for name, place in names.items():
            yield known.column(name, _between(samples, rows, place))


def _between(samples: SampleBlock, rows: StampedRows, place: int) -> Floats:
    """Return a value of rows at the samples (n,), NaN outside and where over two were lost."""
    if len(rows) < 2:
        return np.full(len(samples), np.nan)
    begin_ns = rows.unix_ns[0]  # Unix times, as a reboot does not set them back
    at, times = samples.unix_ns - begin_ns, rows.unix_ns - begin_ns
    after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    apart = times[after] - times[after - 1]
    known = (apart <= MOST_LOST * np.median(np.diff(times))) & (at >= 0) & (at <= times[-1])
    return np.where(known, np.interp(at, times, rows.values[:, place]), np.nan)


def _channel(name: str, samples: SampleBlock, known: Units) -> Column:
    made = _MADE.get(name)
    return known.column(name, getattr(samples, name) if made is None else made(samples, known.grid))


def _is_ground(samples: SampleBlock) -> Bools:
    """Return for each sample (n,) whether its airspeed is the ground speed."""
    return np.asarray(samples.noted & Noted.GROUND_SPEED, bool)


def _dates(samples: SampleBlock) -> Array:
    time = samples.unix_ns.astype("datetime64[ns]")
    return np.where(samples.unix_ns < FIRST_DATE_NS, np.datetime64("NaT"), time)


MOTION: Final[Mapping[str, int]] = {"pitch": 1, "p": 2, "q": 3}
"""The places in an attitude of what samples do not have."""
MOST_LOST: Final = 3.5
"""The longest interval between messages that is bridged, in usual ones: two may be lost."""
_FIRST: Final = tuple(CHANNELS)[: 1 + list(CHANNELS).index("held")]
"""The channels that come before the results in an exported file."""
_MADE: Final[Mapping[str, Callable[[SampleBlock, Grid], Array]]] = {
    "t": lambda s, _: s.boot_us / 1e6,
    "airspeed": lambda s, _: np.where(_is_ground(s), np.nan, s.airspeed),
    "ground_speed": lambda s, _: np.where(_is_ground(s), s.airspeed, s.ground_speed),
    "airspeed_kind": lambda s, _: texts(
        np.nan_to_num(np.where(_is_ground(s), _GROUND, s.airspeed_kind)), _kind
    ),
    "mode": lambda s, grid: texts(s.mode, lambda mode: _mode_name(grid, mode)),
    "held": lambda s, _: texts(s.held, lambda bits: flag_names(Held(bits))),
    "time": lambda s, _: _dates(s),
}
"""The functions that make the channels which a record holds in another form than the samples."""


def estimate_columns(
    samples: SampleBlock, estimate: EstimateBlock, known: Units
) -> Iterator[Column]:
    """Yield an estimator's columns: each parameter of theta, their sigmas, the fit, ``held``."""
    yield _channel("t", samples, known)
    kinds = (("", estimate.theta, "parameter"), ("_std", estimate.theta_std, "its sigma, of noise"))
    for suffix, values, says in kinds:
        for i, name in enumerate(known.grid.parameters):
            yield Column(name + suffix, values[:, i], theta_unit(name, known), says)
    yield from fit_columns(estimate, known)
    yield _channel("held", samples, known)


def fit_columns(estimate: EstimateBlock, known: Units) -> Iterator[Column]:
    """Yield the prediction of the output, its errors and sigma, and the estimator's status."""
    said = f"{known.output} as predicted one step ahead"
    yield Column(f"{known.output}_hat", estimate.y_hat, "rad/s", said)
    for name in ("innovation", "residual", "noise_std"):
        yield known.column(name, getattr(estimate, name))
    status = texts(estimate.status, lambda code: Status(int(code)).name.lower())
    yield Column("status", status, says="of the estimator")


def mode_columns(rows: RunRows, known: Units) -> Iterator[Column]:
    """Yield the primary method's Dutch roll, poles and numbers of eq. 22-23, with their sigmas."""
    modes = rows.modes
    yield _channel("t", rows.samples, known)
    yield from dutch_roll_columns(rows, known)
    for i in range(modes.poles.shape[1]):
        for part, values in (("re", modes.poles.real), ("im", modes.poles.imag)):
            yield known.column(f"pole{i + 1}_{part}", values[:, i], of=f"pole_{part}")
    for name, value, std in zip(YAW_CHANNEL, modes.yaw.T, modes.yaw_std.T, strict=False):
        yield known.column(name, value)
        yield known.column(f"{name}_std", std, OF_NOISE)


def dutch_roll_columns(rows: RunRows, known: Units) -> Iterator[Column]:
    """Yield wn and zeta, each followed by its sigma of noise."""
    for i, name in enumerate(MODE_VALUES):
        says = OF_NOISE if name.endswith("_std") else ""
        yield known.column(name, rows.modes.dutch_roll[:, i], says)


def record_columns(rows: RunRows, known: Units, motion: MotionBlock | None = None) -> list[Column]:
    """Return the exported columns: the first ones of a record, the results, the remaining ones.

    ``motion`` is that of the whole run.
    """
    columns = [*sample_columns(rows.samples, known)]
    for estimate in list(rows.estimates.values())[:1]:  # the primary one; without a grid none
        *fit, _, status = fit_columns(estimate, known)
        columns += [*fit, *dutch_roll_columns(rows, known), status]
    motions = motion_columns(rows.samples, motion, known)
    return [*columns, *further_columns(rows.samples, known), *motions]


def manoeuvre_columns(summary: RunSummary, known: Units) -> Iterator[Column]:
    """Yield columns with a row for each manoeuvre: its conditions and its answer.

    Then the numbers of eq. 22-23 with total sigma, and those of the bare airframe if it is known.
    """
    found = summary.manoeuvres or []
    rows = [flat_answer(each.answer) | _bare(each.lateral) | row_of(each) for each in found]
    types = {name: _TYPES.get(shape["type"], object) for name, shape in row_shapes().items()}
    for name in dict.fromkeys(("n", "usable", "reasons", *types)):
        values = [_one(row.get(name)) for row in rows]
        column: Array = np.array(values, types[name])
        yield known.column(name, column) if name != "reasons" else Column(name, column)
        if name == "usable":
            says = "whether the flight's answer for its loop rests on it"
            used = np.array([each.n in summary.used for each in found], bool)
            yield Column("used", used, says=says)

    def numbers(name: str) -> Floats:
        return np.array([row.get(name) for row in rows], float)

    for name in (f"{each}{std}" for each in YAW_CHANNEL if each != "K" for std in ("", "_std")):
        yield known.column(name, numbers(name))
    if not any(each.lateral for each in found):
        return
    for name in ("wn_rad_s", "wn_std", "zeta", "zeta_std"):
        says, bare = f"of the bare airframe: {quantity(name).words}", f"bare_{name}"
        yield known.column(bare, numbers(bare), says, of=name)
    for name in Bare.NAMES:
        unit = unit_of_derivative(name, known.grid.rudder_unit)
        for each in (name, f"{name}_std"):
            yield Column(each, numbers(each), unit, "of the bare airframe, Ixz folded in")


def _bare(bare: Bare | None) -> Row:
    """Return the mode and the derivatives of a bare airframe; none where it is not known."""
    if not bare:
        return {}
    row = flat(bare.dutch_roll, "bare_")
    for name, value in (bare.derivatives or {}).items():
        row |= with_sigmas(name, value)
    return row


def theta_unit(name: str, known: Units) -> str:
    """Return the unit of a parameter of theta by its name."""
    if name == "bias":
        return "rad/s"
    if not name.startswith("b"):
        return "1"
    return f"rad/s per {known.grid.unit_of(name.partition('_')[2] or known.grid.inputs[0])}"


def texts(codes: Array, word: Callable[[Any], str | None]) -> Array:
    """Return codes (n,) as texts (n,), None where ``word`` returns no text."""
    kinds, which = np.unique(codes, return_inverse=True)
    return np.array([word(code) or None for code in kinds.tolist()], object)[which]


def _mode_name(grid: Grid, mode: float) -> str | None:
    """Return a flight mode's name, its number where it has no name, None where it is unknown."""
    return None if math.isnan(mode) else grid.mode_name(mode).removeprefix("mode ")


def _kind(code: float) -> str | None:
    return BY_GROUND if code == _GROUND else name_of(code or np.nan)


def _one(value: Any) -> Any:
    """Return a field's value for a cell: names of a list joined by spaces, None for []."""
    if isinstance(value, list):
        return " ".join(each["id"] if isinstance(each, dict) else each for each in value) or None
    return value
