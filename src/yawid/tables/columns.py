"""A run's blocks as columns: which field has which name, and its unit as the MCAP's table has it.

The names are those of records (DESIGN: ``t``, ``rudder``, ``r``, ...), so that a run's samples
stand under the same names in Python, in what is exported, and in what can be replayed.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from yawid.airspeed import name_of
from yawid.blocks import FIRST_DATE_NS, Bools, EstimateBlock, Noted, SampleBlock, Status
from yawid.config.run import RunConfig
from yawid.physics.derivatives import NAMES
from yawid.results.run_summary import Manoeuvre, RunSummary
from yawid.sinks.base import HALF_TRAVEL as HALF
from yawid.sinks.base import Grid
from yawid.sinks.mcap.messages import RunRows, manoeuvre_fields
from yawid.sinks.mcap.schemas import MODE_VALUES, TABLE, units
from yawid.sources.records.columns import BY_GROUND, COLUMNS, HALF_TRAVEL, held_text
from yawid.tables.table import Column

_UNIT: Final = re.compile(r"(1|s|m|rad|m/s|rad/s|1/s|1/s\^2|percent|half.travel)( per .+)?")
_UNKNOWN: Final = re.compile("[,;]? NaN .*")
"""Of a schema's text, what says when a number is unknown: that differs from file to file."""
OUTPUTS: Final = {
    "yaw-rate": ("r", "yaw rate"),
    "heading-rate": ("heading_rate", "rate of the heading, by Euler's formula"),
    "yaw": ("mean_heading_rate", "change of yaw over the interval before, by its length"),
}
"""Name and meaning of what the model's output is: of --output yaw-rate alone it is r."""
_GROUND: Final = -1.0
"""In place of a kind of airspeed: it is the ground speed."""
_TYPES: Final[Mapping[str, type]] = {"double": float, "bool": bool, "fixed32": int}
"""Of protobuf's, those that are numbers: all else becomes text."""


class Units:
    """Unit and meaning of each field of a run, as its MCAP would have them."""

    def __init__(self, grid: Grid, config: RunConfig) -> None:
        self._units = units(grid.rudder_unit.replace(HALF, HALF_TRAVEL))
        self.grid, self.config = grid, config
        name, says = OUTPUTS[config.output]
        if config.turn == "remove":
            name, says = f"{name}_less_turn", f"{says}, less the turn's"
        if config.band is not None:
            says += f", within {config.band[0]:g} to {config.band[1]:g} Hz, as the inputs are"
        self.output, self.output_says = name, says

    def column(self, field: str, name: str, values: NDArray[Any]) -> Column:
        """Return a column of a field, ``Message.field``."""
        unit, says = unit_in(self._units.get(field, ""))
        return Column(name, values, unit, says)

    def surface(self, name: str) -> str:
        """Return the unit of an input."""
        return self.grid.unit_of(name).replace(HALF, HALF_TRAVEL)


def unit_in(text: str) -> tuple[str, str]:
    """Return the unit at the start of a schema's text, empty if there is none, and the rest."""
    first = re.split("[,;]", text, maxsplit=1)[0]
    if _UNIT.fullmatch(first) is None:
        return "", _UNKNOWN.sub("", text)
    return first, _UNKNOWN.sub("", text.removeprefix(first)).lstrip(",; ")


def sample_columns(samples: SampleBlock, known: Units) -> Iterator[Column]:
    """Yield what was measured, a row per sample: a record's columns that come first."""
    grid = known.grid
    yield _kept("t", samples.boot_us / 1e6)
    mean = f"mean deflection over [t, t + {grid.sample_time_s:g} s), positive nose right"
    rudder = samples.u[:, grid.inputs.index("rudder")]
    yield Column("rudder", rudder, known.surface("rudder"), mean)
    yield Column(known.output, samples.y, COLUMNS["r"].unit, known.output_says)
    yield _kept("roll", samples.roll)
    yield _kept("aileron", samples.aileron)
    yield _kept("airspeed", np.where(_is_ground(samples), np.nan, samples.airspeed))
    yield _kept("yaw", samples.yaw)
    yield _kept("altitude", samples.altitude)
    yield _kept("on_ground", samples.on_ground)
    yield _kept("mode", texts(samples.mode, lambda mode: _mode_name(grid, mode)))
    yield _kept("held", texts(samples.held, held_text))


def further_columns(samples: SampleBlock) -> Iterator[Column]:
    """Yield the rest of a record's columns, and what is noted."""
    yield _kept("turn_rate", samples.turn)
    by_ground = _is_ground(samples)
    yield _kept("ground_speed", np.where(by_ground, samples.airspeed, samples.ground_speed))
    kind = np.where(by_ground, _GROUND, samples.airspeed_kind)
    yield _kept("airspeed_kind", texts(np.nan_to_num(kind), _kind))
    time = samples.unix_ns.astype("datetime64[ns]")
    time = np.where(samples.unix_ns < FIRST_DATE_NS, np.datetime64("NaT"), time)
    yield _kept("time", time)
    yield Column("noted", texts(samples.noted, _noted), says="what is to be known of it beside")


def _kept(name: str, values: NDArray[Any]) -> Column:
    return Column(name, values, COLUMNS[name].unit, COLUMNS[name].says)


def _is_ground(samples: SampleBlock) -> Bools:
    """Tell of which samples (n,) the airspeed is the ground speed."""
    found: Bools = samples.noted & Noted.GROUND_SPEED != 0
    return found


def estimate_columns(
    samples: SampleBlock, estimate: EstimateBlock, known: Units
) -> Iterator[Column]:
    """Yield an estimator's rows: theta by the names of its parameters, each with its sigma."""
    grid = known.grid
    yield _kept("t", samples.boot_us / 1e6)
    kinds = (("", estimate.theta, "parameter"), ("_std", estimate.theta_std, "its sigma, of noise"))
    for suffix, values, says in kinds:
        for i, name in enumerate(grid.parameters):
            yield Column(name + suffix, values[:, i], theta_unit(name, known), says)
    yield from fit_columns(estimate, known)
    yield _kept("held", texts(samples.held, held_text))


def fit_columns(estimate: EstimateBlock, known: Units) -> Iterator[Column]:
    """Yield how the model tells the output, and what the estimator says of itself."""
    said = f"{known.output} as predicted one step ahead"
    yield Column(f"{known.output}_hat", estimate.y_hat, "rad/s", said)
    for name in ("innovation", "residual", "noise_std"):
        yield known.column(f"Estimate.{name}", name, getattr(estimate, name))
    status = texts(estimate.status, lambda code: Status(int(code)).name.lower())
    yield Column("status", status, says="of the estimator")


def mode_columns(rows: RunRows, known: Units) -> Iterator[Column]:
    """Yield the first method's Dutch roll, its poles and the numbers of eq. 22-23, sigma beside."""
    modes = rows.modes
    yield _kept("t", rows.samples.boot_us / 1e6)
    yield from dutch_roll_columns(rows, known)
    for i in range(modes.poles.shape[1]):
        for part, values in (("re", modes.poles.real), ("im", modes.poles.imag)):
            yield known.column(f"Modes.pole_{part}", f"pole{i + 1}_{part}", values[:, i])
    for i, name in enumerate(NAMES[: modes.yaw.shape[1]]):
        yield known.column(f"Modes.{name}", name, modes.yaw[:, i])
        yield known.column(f"Modes.{name}_std", f"{name}_std", modes.yaw_std[:, i])


def dutch_roll_columns(rows: RunRows, known: Units) -> Iterator[Column]:
    """Yield wn and zeta, their sigmas (of noise) beside."""
    for i, name in enumerate(MODE_VALUES):
        yield known.column(f"Modes.dutch_roll_{name}", name, rows.modes.dutch_roll[:, i])


def record_columns(rows: RunRows, known: Units) -> list[Column]:
    """Return what is exported: the columns of a record, then the results, then what is left."""
    columns = [*sample_columns(rows.samples, known)]
    for estimate in list(rows.estimates.values())[:1]:  # the first; without a grid there is none
        *fit, _, status = fit_columns(estimate, known)
        columns += [*fit, *dutch_roll_columns(rows, known), status]
    return [*columns, *further_columns(rows.samples)]


def manoeuvre_columns(summary: RunSummary, known: Units) -> Iterator[Column]:
    """Yield a row per manoeuvre: conditions, answer, and the theta that answers."""
    found = summary.manoeuvres or []
    fields = [manoeuvre_fields(each) for each in found]
    types = {name: _TYPES.get(kind, object) for name, kind, _ in TABLE["Manoeuvre"]}
    for name in dict.fromkeys(("n", "usable", "reasons", *types)):
        values = [_one(each[name]) for each in fields]
        yield known.column(f"Manoeuvre.{name}", name, np.array(values, types[name]))
        if name == "usable":
            used = () if summary.flight is None else summary.flight.used
            says = "whether the flight's answer rests on it"
            yield Column("used", np.array([each.n in used for each in found], bool), says=says)
    kinds = (("theta", "", "parameter"), ("theta_std", "_std", "its sigma, of noise"))
    for name in _parameters(found):
        for field, suffix, says in kinds:
            values = [_parameter(each, field, name) for each in found]
            unit = theta_unit(name, known)
            yield Column(name + suffix, np.array(values, float), unit, says)


def theta_unit(name: str, known: Units) -> str:
    """Return the unit of a parameter by its name."""
    if name == "bias":
        return "rad/s"
    if not name.startswith("b"):
        return "1"
    return f"rad/s per {known.surface(name.partition('_')[2] or known.grid.inputs[0])}"


def texts(codes: NDArray[Any], word: Callable[[Any], str | None]) -> NDArray[Any]:
    """Return codes (n,) as texts (n,), None where there is none."""
    kinds, which = np.unique(codes, return_inverse=True)
    return np.array([word(code) or None for code in kinds.tolist()], object)[which]


def _mode_name(grid: Grid, mode: float) -> str | None:
    """Return a flight mode's name, its number where it has none."""
    if mode != mode:  # NaN
        return None
    name = grid.mode_name(mode)
    return f"{mode:.0f}" if name == f"mode {mode:.0f}" else name


def _kind(code: float) -> str | None:
    return BY_GROUND if code == _GROUND else name_of(code or np.nan)


def _noted(bits: int) -> str:
    return " ".join(str(flag.name).lower() for flag in Noted if flag.value & bits)


def _one(value: Any) -> Any:
    """Return a field's value for a cell: of several the names, of none None."""
    if isinstance(value, list):
        return " ".join(each["id"] if isinstance(each, dict) else each for each in value) or None
    return None if value == "" else value


def _parameters(found: Iterable[Manoeuvre]) -> list[str]:
    """Return the names in the models that answer, each once."""
    names: dict[str, None] = {}
    for each in found:
        names |= dict.fromkeys(() if each.answer is None else each.answer.theta)
    return list(names)


def _parameter(each: Manoeuvre, field: str, name: str) -> float:
    values = {} if each.answer is None else getattr(each.answer, field)
    return float(values.get(name, np.nan))
