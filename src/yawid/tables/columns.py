"""A run's blocks as columns, each with its unit and words from the table of quantities.

The names are those of records (``t``, ``rudder``, ``r``, ...), so that samples have the same names
in Python, in exported files, and in files that can be replayed.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from yawid.answers.run_summary import Bare, Manoeuvre, RunSummary, Value
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

    def column(self, name: str, values: Array, says: str = "") -> Column:
        """Return the column of a quantity, with the quantity's words unless ``says`` is given."""
        row = quantity(name)
        return Column(
            name, values, row.unit.replace(RUDDER, self.grid.rudder_unit), says or row.words
        )


def sample_columns(samples: SampleBlock, known: Units) -> Iterator[Column]:
    """Yield the measured columns, a row for each sample: the first columns of a record."""
    grid = known.grid
    mean = f"mean deflection over [t, t + {grid.sample_time_s:g} s), positive nose right"
    yield _channel("t", samples, grid)
    rudder = samples.u[:, grid.inputs.index("rudder")]
    yield Column("rudder", rudder, grid.rudder_unit, mean)
    yield Column(known.output, samples.y, quantity("r").unit, known.output_says)
    for name in _FIRST[3:]:
        yield _channel(name, samples, grid)


def further_columns(samples: SampleBlock, known: Units) -> Iterator[Column]:
    """Yield the remaining columns of a record, and the notes of each sample."""
    for name in (each for each in CHANNELS if CHANNELS[each].kept and each not in _FIRST):
        yield _channel(name, samples, known.grid)
    yield Column(
        "noted",
        texts(samples.noted, lambda bits: flag_names(Noted(bits))),
        says="further notes on the sample",
    )


def motion_columns(samples: SampleBlock, motion: MotionBlock | None) -> Iterator[Column]:
    """Yield the lateral motion at the samples, on lines between its own times, if it was kept."""
    if motion is None:
        return
    for rows, names in ((motion.attitude, MOTION), (motion.acceleration, {"ay": 0})):
        for name, place in names.items():
            row = quantity(name)
            values = _between(samples, rows, place)
            yield Column(name, values, row.unit, row.words)


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


def _channel(name: str, samples: SampleBlock, grid: Grid) -> Column:
    row, made = quantity(name), _MADE.get(name)
    values = getattr(samples, name) if made is None else made(samples, grid)
    return Column(name, values, row.unit, row.words)


def _is_ground(samples: SampleBlock) -> Bools:
    """Return for each sample (n,) whether its airspeed is the ground speed."""
    found: Bools = samples.noted & Noted.GROUND_SPEED != 0
    return found


def _kinds(samples: SampleBlock) -> Array:
    kind = np.where(_is_ground(samples), _GROUND, samples.airspeed_kind)
    return texts(np.nan_to_num(kind), _kind)


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
    "airspeed_kind": lambda s, _: _kinds(s),
    "mode": lambda s, grid: texts(s.mode, lambda mode: _mode_name(grid, mode)),
    "held": lambda s, _: texts(s.held, lambda bits: flag_names(Held(bits))),
    "time": lambda s, _: _dates(s),
}
"""The functions that make the channels which a record holds in another form than the samples."""


def estimate_columns(
    samples: SampleBlock, estimate: EstimateBlock, known: Units
) -> Iterator[Column]:
    """Yield an estimator's columns: each parameter of theta, their sigmas, the fit, ``held``."""
    grid = known.grid
    yield _channel("t", samples, grid)
    kinds = (("", estimate.theta, "parameter"), ("_std", estimate.theta_std, "its sigma, of noise"))
    for suffix, values, says in kinds:
        for i, name in enumerate(grid.parameters):
            yield Column(name + suffix, values[:, i], theta_unit(name, known), says)
    yield from fit_columns(estimate, known)
    yield _channel("held", samples, grid)


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
    yield _channel("t", rows.samples, known.grid)
    yield from dutch_roll_columns(rows, known)
    for i in range(modes.poles.shape[1]):
        for part, values in (("re", modes.poles.real), ("im", modes.poles.imag)):
            row = quantity(f"pole_{part}")
            yield Column(f"pole{i + 1}_{part}", values[:, i], row.unit, row.words)
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
    motions = motion_columns(rows.samples, motion)
    return [*columns, *further_columns(rows.samples, known), *motions]


def manoeuvre_columns(summary: RunSummary, known: Units) -> Iterator[Column]:
    """Yield columns with a row for each manoeuvre: its conditions and its answer."""
    found = summary.manoeuvres or []
    fields = [row_of(each) for each in found]
    types = {name: _TYPES.get(shape["type"], object) for name, shape in row_shapes().items()}
    for name in dict.fromkeys(("n", "usable", "reasons", *types)):
        values = [_one(each.get(name)) for each in fields]
        column: Array = np.array(values, types[name])
        yield known.column(name, column) if name != "reasons" else Column(name, column)
        if name == "usable":
            says = "whether the flight's answer for its loop rests on it"
            used = np.array([each.n in summary.used for each in found], bool)
            yield Column("used", used, says=says)
    yield from _derivative_columns(found, known)


def _derivative_columns(found: Sequence[Manoeuvre], known: Units) -> Iterator[Column]:
    """Yield the numbers of eq. 22-23 with total sigma, and those of the bare airframe if known."""
    answers = [(each.answer and each.answer.physics) or {} for each in found]
    for name in (each for each in YAW_CHANNEL if each != "K"):
        for suffix, column in _values([each.get(name) for each in answers]):
            yield known.column(f"{name}{suffix}", column)
    bare = [each.lateral for each in found]
    if not any(bare):
        return
    rolls = [None if each is None else each.dutch_roll for each in bare]
    for name in ("wn_rad_s", "wn_std", "zeta", "zeta_std"):
        column = np.array([getattr(each, name, None) or np.nan for each in rolls], float)
        row = quantity(name)
        yield Column(f"bare_{name}", column, row.unit, f"of the bare airframe: {row.words}")
    for name in Bare.NAMES:
        unit = unit_of_derivative(name, known.grid.rudder_unit)
        values = [(each.derivatives or {}).get(name) if each else None for each in bare]
        for suffix, column in _values(values):
            yield Column(name + suffix, column, unit, "of the bare airframe, Ixz folded in")


def _values(values: Iterable[Value | None]) -> Iterator[tuple[str, Array]]:
    """Yield ("", values) and ("_std", total sigmas), NaN where unknown."""
    some = [Value() if each is None else each for each in values]
    yield "", np.array([np.nan if v.value is None else v.value for v in some], float)
    yield "_std", np.array([np.nan if v.std is None else v.std for v in some], float)


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
    if mode != mode:  # NaN
        return None
    name = grid.mode_name(mode)
    return f"{mode:.0f}" if name == f"mode {mode:.0f}" else name


def _kind(code: float) -> str | None:
    return BY_GROUND if code == _GROUND else name_of(code or np.nan)


def _one(value: Any) -> Any:
    """Return a field's value for a cell: names of a list joined by spaces, None for []."""
    if isinstance(value, list):
        return " ".join(each["id"] if isinstance(each, dict) else each for each in value) or None
    return value
