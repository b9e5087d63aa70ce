"""The data of the viewer's panels: lines of each entity, lanes of states, the z plane.

Rows of what is derived from blocks are chosen by the grid's index, and the state kept between
blocks does not depend on them: the picture is the same however the stream was cut into blocks.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

import rerun as rr
from yawid.answers.run_summary import DutchRoll
from yawid.blocks import (
    EstimateBlock,
    Floats,
    Held,
    Ints,
    ModesBlock,
    Noted,
    SampleBlock,
    Status,
    words,
)
from yawid.physics.modes import modes, orders_of, poles_of
from yawid.quantities.flying_qualities import LEVELS
from yawid.sinks.base import Grid, RunRows
from yawid.sinks.palette import (
    BAD,
    BARE,
    CARE,
    DATA,
    GOOD,
    INPUTS,
    LINES,
    MANOEUVRE,
    METHODS,
    MODEL,
    NEUTRAL,
    Rgba,
    rgba,
)
from yawid.sinks.rerun.blueprint import points

PALE_ALPHA, UNDER_ALPHA, BAR_ALPHA = 90, 130, 190  # lines are visible through a bar
LINE_WIDTH, BAND_WIDTH, BAR_WIDTH, UNDER_WIDTH = 1.5, 0.7, 4.0, 4.0
# All bounds have the same name, so that the legend has one entry for them.
BAND: Final = "2 sigma of noise"
BAND_OF_MANOEUVRE: Final = "2 sigma"
"""The name of a manoeuvre's bounds, which are of total sigmas."""
USABLE, REFUSED, OF_BARE = "manoeuvre", "refused", "bare"
"""The kinds of bars: of a manoeuvre's answer, of one that is not usable, of the bare airframe."""
UNKNOWN: Final = 0.2
"""The sigma, of wn relative to wn and of zeta, from which on no line is drawn: its values would
stretch the axis."""
GROUPS: Final[Mapping[str, str]] = {"a": "a", "b": "b", "c": "c", "bias": "b"}
"""The panel of a parameter, by its letter; the bias is drawn with b, which is also in rad/s."""
ZETA_LEVELS: Final = {
    f"level {level}: {zeta:.2f}": zeta for level, (zeta, *_) in enumerate(LEVELS[:2], start=1)
}
"""The least damping ratios of MIL-F-8785C, category B; for an unmanned aircraft a rough guide."""


class Style(NamedTuple):
    """The names, colours and widths of an entity's lines, in the order of its columns."""

    names: list[str]
    colours: list[Rgba]
    widths: list[float]


def _pale(colour: Rgba) -> Rgba:
    return (*colour[:3], PALE_ALPHA)


def _banded(name: str, colour: Rgba, width: float = LINE_WIDTH, bound: str = BAND) -> Style:
    """Return the style of a line with its lower and upper 2 sigma bound."""
    return Style(
        [name, bound, bound],
        [colour, _pale(colour), _pale(colour)],
        [width, BAND_WIDTH, BAND_WIDTH],
    )


def groups(parameters: Sequence[str]) -> dict[str, list[int]]:
    """Return the columns of theta that each panel draws, by the panel's letter."""
    found: dict[str, list[int]] = {}
    for column, name in enumerate(parameters):
        letter = name if name in GROUPS else name[0]
        found.setdefault(GROUPS[letter], []).append(column)
    return found


def series_styles(grid: Grid) -> dict[str, Style]:
    """Return the style of every entity's lines, in the order of its columns.

    Later lines are drawn above earlier ones: measured above predicted, which is wider.
    """
    first, *others = grid.methods
    styles = {
        "input": Style(
            [f"{name} [{grid.unit_of(name)}]" for name in grid.inputs],
            [rgba(INPUTS.get(name, NEUTRAL)) for name in grid.inputs],
            [LINE_WIDTH] * len(grid.inputs),
        ),
        "yaw_rate": Style(
            ["predicted [rad/s]", "measured [rad/s]"],
            [rgba(MODEL, UNDER_ALPHA), rgba(DATA)],
            [UNDER_WIDTH, LINE_WIDTH],
        ),
        "innovation": _banded("innovation [rad/s]", rgba(MODEL)),
        "dutch_roll/wn": _banded(f"wn of {first.upper()} [rad/s]", _of_method(first)),
        "dutch_roll/zeta": _banded(f"zeta of {first.upper()}", _of_method(first)),
        "dutch_roll/zeta/level": Style(list(ZETA_LEVELS), [rgba(NEUTRAL)] * 2, [BAND_WIDTH] * 2),
    }
    for method in others:
        for entity, unit in (("wn", " [rad/s]"), ("zeta", "")):
            name = f"{entity} of {method.upper()}{unit}"
            style = Style([name], [_of_method(method)], [LINE_WIDTH])
            styles[f"dutch_roll/{entity}/{method}"] = style
    for letter, columns in groups(grid.parameters).items():
        colours = [rgba(LINES[i % len(LINES)]) for i in range(len(columns))]
        styles[f"parameters/{letter}"] = Style(
            [*(grid.parameters[i] for i in columns), *[BAND] * (2 * len(columns))],
            [*colours, *[_pale(colour) for colour in colours] * 2],
            [*[LINE_WIDTH] * len(columns), *[BAND_WIDTH] * (2 * len(columns))],
        )
    return styles


def _of_method(method: str) -> Rgba:
    return rgba(METHODS.get(method, NEUTRAL))


def bar_style(name: str, kind: str) -> Style:
    """Return the style of the bars that :func:`manoeuvre_rows` draws, of wn or of zeta."""
    what = "the bare airframe" if kind == OF_BARE else "a manoeuvre"
    text = f"{name} of {what}{' [rad/s]' if name == 'wn' else ''}"
    if kind == REFUSED:
        return Style([f"{text}, not usable"], [rgba(BAD, BAR_ALPHA)], [BAR_WIDTH])
    colour = BARE if kind == OF_BARE else MANOEUVRE
    return _banded(text, rgba(colour, BAR_ALPHA), BAR_WIDTH, BAND_OF_MANOEUVRE)


def manoeuvre_rows(roll: DutchRoll, kind: str) -> dict[str, Floats]:
    """Return the values (3, m) of every entity: at a manoeuvre's begin, its end, and NaN after it.

    ``kind`` is USABLE, REFUSED or OF_BARE; a refused one has no band, as its sigma means nothing.
    """
    pairs = (roll.wn_rad_s, roll.wn_std), (roll.zeta, roll.zeta_std)
    rows = {}
    for name, (value, std) in zip(("wn", "zeta"), pairs, strict=True):
        bar = np.array([value, np.nan if std is None else std])
        line = bar[None, :1] if kind == REFUSED else _with_band(bar[:1], 2.0 * bar[1:])
        rows[f"dutch_roll/{name}/{kind}"] = np.vstack([line, line, np.full_like(line, np.nan)])
    return rows


def _with_band(value: Floats, two_sigma: Floats) -> Floats:
    """Return values with their lower and upper bounds (n, 3)."""
    return np.column_stack([value, value - two_sigma, value + two_sigma])


def is_known(modes: ModesBlock) -> NDArray[np.bool_]:
    """Return for each row (n,) whether the Dutch roll is known well enough for a line."""
    wn, wn_std, _, zeta_std = modes.dutch_roll.T
    known: NDArray[np.bool_] = (wn_std < UNKNOWN * wn) & (zeta_std < UNKNOWN)
    return known


def group_rows(
    parameters: Sequence[str], samples: SampleBlock, estimate: EstimateBlock, modes: ModesBlock
) -> dict[str, Floats]:
    """Return the values (n, m) of every entity with a value per sample; NaN makes a gap."""
    live = estimate.status != Status.WARMING_UP
    theta = np.where(live[:, None], estimate.theta, np.nan)
    noise = 2.0 * estimate.noise_std
    wn, wn_std, zeta, zeta_std = modes.dutch_roll.T
    drawn = is_known(modes)
    rows = {
        "input": samples.u,
        "yaw_rate": np.column_stack([np.where(live, estimate.y_hat, np.nan), samples.y]),
        "innovation": np.column_stack([estimate.innovation, -noise, noise]),
        "dutch_roll/wn": _with_band(np.where(drawn, wn, np.nan), 2.0 * wn_std),
        "dutch_roll/zeta": _with_band(np.where(drawn, zeta, np.nan), 2.0 * zeta_std),
        "dutch_roll/zeta/level": np.tile(list(ZETA_LEVELS.values()), (len(samples), 1)),
    }
    for letter, columns in groups(parameters).items():
        std, size = estimate.theta_std[:, columns], np.abs(theta[:, columns])
        # A sigma larger than all values means "unknown", and would stretch the axis.
        known = std <= size.max(axis=1, keepdims=True)
        value, band = np.where(known, theta[:, columns], np.nan), 2.0 * std
        rows[f"parameters/{letter}"] = np.hstack([value, value - band, value + band])
    return rows


PLANE_S = 2.0
OTHERS_S = 0.5
# The cross is one line: along one arm, back to the middle, and along the other arm.
CROSS = 0.035 * np.array([[-1.0, -1.0], [1.0, 1.0], [0.0, 0.0], [-1.0, 1.0], [1.0, -1.0]])
USED = "used"
_STATUS = {
    Status.WARMING_UP: CARE,
    Status.TRACKING: GOOD,
    Status.HELD: NEUTRAL,
    Status.DIVERGED: BAD,
}
_NOTED = {
    Noted.SATURATED: "rudder at its stop",
    Noted.AIRSPEED_CHANGED: "airspeed changed",
    Noted.NOT_EXCITED: "not excited",
}


Change = tuple[str, int, str, str]
"""A change of state: its lane, the row of the block from which on it holds, the state, its colour.
"""
Panel = tuple[str, Ints, Any]
"""An entity, rows (n,) of the block, and the entity's columns for Rerun there."""


class Marks:
    """The derivation of these panels' data for one run, block after block."""

    def __init__(self, grid: Grid) -> None:
        self._mode_name = grid.mode_name
        self._orders = orders_of(grid.parameters)
        self._na, [self._nb] = self._orders.na, self._orders.nb
        self._sample_time_s = grid.sample_time_s
        self._rolls_step = max(1, round(OTHERS_S / grid.sample_time_s))
        self._plane_step = max(1, round(PLANE_S / grid.sample_time_s))
        self._states: dict[str, str] = {}

    def changes(self, samples: SampleBlock, estimate: EstimateBlock) -> Iterator[Change]:
        """Yield the changes of every lane within the block; the run's first row is always one."""
        # An unknown mode is NaN, which is never equal to itself.
        modes = np.nan_to_num(samples.mode, nan=-1.0)
        codes = np.column_stack([samples.held, estimate.status, samples.noted, modes])
        for row in [0, *(np.flatnonzero((codes[1:] != codes[:-1]).any(axis=1)) + 1).tolist()]:
            held, status, noted = (int(code) for code in codes[row, :3])
            text = _sample_text(held, noted)
            noted_colour = GOOD if text == USED else CARE
            now = {
                "estimator": (words(Status(status)), _STATUS[Status(status)]),
                "samples": (text, NEUTRAL if held else noted_colour),
                "flight_mode": (self._mode_name(samples.mode[row]), NEUTRAL),
            }
            for lane, (state, colour) in now.items():
                if self._states.get(lane) != state:
                    self._states[lane] = state
                    yield lane, row, state, colour

    def panels(self, block: RunRows) -> Iterator[Panel]:
        """Yield the z plane every ``PLANE_S``, and the other methods' modes every ``OTHERS_S``."""
        samples, estimates, primary_modes = block
        primary, *others = estimates.items()
        if len(rows := self._rows(samples, primary[1], self._plane_step)):
            yield from self._plane(rows, primary[1].theta[rows])
        known = is_known(primary_modes)
        for method, estimate in others:
            if len(rows := self._rows(samples, estimate, self._rolls_step)):
                yield from self._rolls(rows, method, estimate, known)

    def _rows(self, samples: SampleBlock, estimate: EstimateBlock, step: int) -> Ints:
        return np.flatnonzero((samples.k % step == 0) & (estimate.status != Status.WARMING_UP))

    def _plane(self, rows: Ints, theta: NDArray[np.float64]) -> Iterator[Panel]:
        """Yield poles and zeros of the first input, none where there is none."""
        b = theta[:, self._na : self._na + self._nb]
        with np.errstate(divide="ignore", invalid="ignore"):
            monic = b[:, 1:] / b[:, :1]
        poles, zeros = (poles_of(each, 1.0).z for each in (theta[:, : self._na], monic))
        crosses = rr.LineStrips2D.columns(strips=crosses_at(poles[np.isfinite(poles)]))
        yield "z_plane/poles", rows, crosses.partition(np.isfinite(poles).sum(axis=1))
        dots = rr.Points2D.columns(positions=points(zeros[np.isfinite(zeros)]))
        yield "z_plane/zeros", rows, dots.partition(np.isfinite(zeros).sum(axis=1))

    def _rolls(
        self, rows: Ints, method: str, estimate: EstimateBlock, known: NDArray[np.bool_]
    ) -> Iterator[Panel]:
        """Yield the Dutch roll of a method other than the primary one.

        Its sigma is not computed. Therefore it is given where the primary method's Dutch roll is
        ``known`` (n,), else it is NaN, which leaves a gap in the line.
        """
        there = EstimateBlock(estimate.without_covariance[rows], estimate.p)
        found = modes(there, self._orders, self._sample_time_s).dutch_roll[:, ::2]
        for name, line in zip(("wn", "zeta"), np.where(known[rows, None], found, np.nan).T,
                              strict=True):  # fmt: skip
            yield f"dutch_roll/{name}/{method}", rows, rr.Scalars.columns(scalars=line)


def crosses_at(z: NDArray[np.complex128]) -> list[NDArray[np.float64]]:
    """Return a cross at each point of the plane."""
    return list(points(z)[:, None, :] + CROSS)


def _sample_text(held: int, noted: int) -> str:
    if held:
        return f"held: {', '.join(words(flag) for flag in Held if held & flag)}"
    return ", ".join([USED, *(text for flag, text in _NOTED.items() if noted & flag)])
