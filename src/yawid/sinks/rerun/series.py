"""The lines that the viewer draws: names, colours and values of each entity."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from yawid.answers.run_summary import DutchRoll
from yawid.blocks import EstimateBlock, Floats, ModesBlock, SampleBlock, Status
from yawid.quantities.flying_qualities import LEVELS
from yawid.sinks.base import Grid
from yawid.sinks.palette import BAD, BARE, DATA, INPUTS, LINES, METHODS, MODEL, NEUTRAL, Rgba, rgba

PALE_ALPHA, UNDER_ALPHA, BAR_ALPHA = 90, 130, 190
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


def manoeuvre_styles(method: str) -> dict[str, Style]:
    """Return the styles of what :func:`manoeuvre_rows` draws next to the lines of the stream.

    ``method`` is the answering method; bars of answers that are not usable all have one colour.
    """
    names = {"wn": "wn of a manoeuvre [rad/s]", "zeta": "zeta of a manoeuvre"}
    bar = rgba(METHODS.get(method, NEUTRAL), BAR_ALPHA)  # lines are visible through the bar
    styles = {}
    for entity, name in names.items():
        used, refused = (f"dutch_roll/{entity}/{kind}" for kind in (USABLE, REFUSED))
        styles[used] = _banded(name, bar, BAR_WIDTH, BAND_OF_MANOEUVRE)
        styles[refused] = Style([f"{name}, not usable"], [rgba(BAD, BAR_ALPHA)], [BAR_WIDTH])
    return styles


def bare_styles() -> dict[str, Style]:
    """Return the styles of the bars of the bare airframe."""
    names = {"wn": "wn of the bare airframe [rad/s]", "zeta": "zeta of the bare airframe"}
    bar = rgba(BARE, BAR_ALPHA)
    return {
        f"dutch_roll/{entity}/{OF_BARE}": _banded(name, bar, BAR_WIDTH, BAND_OF_MANOEUVRE)
        for entity, name in names.items()
    }


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
