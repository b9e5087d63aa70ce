"""What the viewer draws: the lines of each entity, their names, colours and values."""

from typing import Any, Final

import numpy as np

from yawid.blocks import EstimateBlock, Floats, ModesBlock, SampleBlock, Status
from yawid.physics.flying_qualities import LEVELS
from yawid.results.run_summary import DutchRoll
from yawid.sinks.base import Grid
from yawid.sinks.palette import (
    DATA,
    INPUTS,
    LINES,
    METHODS,
    MODEL,
    NEUTRAL,
    RML,
    Rgba,
    rgba,
)

PALE_ALPHA: Final = 90
LINE_WIDTH, BAND_WIDTH, BAR_WIDTH = 1.5, 0.7, 4.0
# Of one name, so that the legend has one entry for all bounds.
BAND: Final = "± 2 sigma of noise"
BAND_OF_MANOEUVRE: Final = "± 2 sigma"
"""Not of noise alone, unless the file is of an older version."""
ZETA_LEVELS: Final = {
    f"level {level}: {zeta:.2f}": zeta for level, (zeta, *_) in enumerate(LEVELS[:2], start=1)
}
"""Least damping ratios of MIL-F-8785C, category B: indicative for an unmanned aircraft."""


def _pale(colour: Rgba) -> Rgba:
    return (*colour[:3], PALE_ALPHA)


def _style(names: list[str], colours: list[Rgba], widths: list[float]) -> dict[str, Any]:
    return {"names": names, "colors": colours, "widths": widths}


def _banded(
    name: str, colour: Rgba, width: float = LINE_WIDTH, bound: str = BAND
) -> dict[str, Any]:
    """Style of a line with its lower and upper 2 sigma bound."""
    return _style(
        [name, bound, bound],
        [colour, _pale(colour), _pale(colour)],
        [width, BAND_WIDTH, BAND_WIDTH],
    )


def series_styles(grid: Grid) -> dict[str, dict[str, Any]]:
    """Return names, colours and widths of the lines of every entity, in column order."""
    p = len(grid.parameters)
    colours = [rgba(LINES[i % len(LINES)]) for i in range(p)]
    first = rgba(METHODS.get(grid.methods[0], MODEL))
    return {
        "input": _style(
            [f"{name} [{grid.unit_of(name)}]" for name in grid.inputs],
            [rgba(INPUTS.get(name, NEUTRAL)) for name in grid.inputs],
            [LINE_WIDTH] * len(grid.inputs),
        ),
        "yaw_rate": _style(
            ["measured [rad/s]", "predicted [rad/s]"], [rgba(DATA), rgba(MODEL)], [LINE_WIDTH] * 2
        ),
        "innovation": _banded("innovation [rad/s]", rgba(MODEL)),
        "parameters/theta": _style(list(grid.parameters), colours, [LINE_WIDTH] * p),
        "parameters/band": _style(
            [BAND] * (2 * p), [_pale(colour) for colour in colours] * 2, [BAND_WIDTH] * (2 * p)
        ),
        "dutch_roll/wn": _banded("wn [rad/s]", first),
        "dutch_roll/zeta": _banded("zeta", first),
        "dutch_roll/zeta/level": _style(list(ZETA_LEVELS), [rgba(NEUTRAL)] * 2, [BAND_WIDTH] * 2),
    }


def manoeuvre_styles() -> dict[str, dict[str, Any]]:
    """Return the style of what :func:`manoeuvre_rows` draws over the lines of the stream."""
    return {
        f"dutch_roll/{entity}/manoeuvre": _banded(name, rgba(RML), BAR_WIDTH, BAND_OF_MANOEUVRE)
        for entity, name in (("wn", "wn of a manoeuvre [rad/s]"), ("zeta", "zeta of a manoeuvre"))
    }


def manoeuvre_rows(roll: DutchRoll) -> dict[str, Floats]:
    """Return the values (3, 3) of every entity: at a manoeuvre's begin, at its end, none after."""
    pairs = (roll.wn_rad_s, roll.wn_std), (roll.zeta, roll.zeta_std)
    rows = {}
    for entity, (value, std) in zip(manoeuvre_styles(), pairs, strict=True):
        bar = np.array([value, np.nan if std is None else std])
        rows[entity] = np.full((3, 3), np.nan)
        rows[entity][:2] = _with_band(bar[:1], 2.0 * bar[1:])
    return rows


def _two_sigma(std: Floats, limit: Floats | float) -> Floats:
    """Return 2 std, NaN beyond ``limit``: such a band says "unknown" and squeezes the axis."""
    return 2.0 * np.where(std <= limit, std, np.nan)


def _with_band(value: Floats, two_sigma: Floats) -> Floats:
    """Return value, lower and upper bound (n, 3)."""
    return np.column_stack([value, value - two_sigma, value + two_sigma])


def group_rows(
    samples: SampleBlock, estimate: EstimateBlock, modes: ModesBlock
) -> dict[str, Floats]:
    """Return the values (n, m) of every entity of :func:`series_styles`; NaN leaves a line open."""
    live = estimate.status != Status.WARMING_UP
    theta = np.where(live[:, None], estimate.theta, np.nan)
    band = _two_sigma(estimate.theta_std, np.maximum(np.abs(estimate.theta), 1.0))
    noise = 2.0 * estimate.noise_std
    wn, wn_std, zeta, zeta_std = modes.dutch_roll.T
    return {
        "input": samples.u,
        "yaw_rate": np.column_stack([samples.y, np.where(live, estimate.y_hat, np.nan)]),
        "innovation": np.column_stack([estimate.innovation, -noise, noise]),
        "parameters/theta": theta,
        "parameters/band": np.hstack([theta - band, theta + band]),
        "dutch_roll/wn": _with_band(wn, _two_sigma(wn_std, wn)),
        "dutch_roll/zeta": _with_band(zeta, _two_sigma(zeta_std, 0.5)),
        "dutch_roll/zeta/level": np.tile(list(ZETA_LEVELS.values()), (len(samples), 1)),
    }
