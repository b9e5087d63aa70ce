"""The numbers of a drawn picture, from which ``zoom.js`` makes charts that zoom in its place.

They are read from matplotlib's figure after it was drawn, so that chart and picture cannot differ.
"""

import json
import math
import re
from collections.abc import Iterator
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation

from yawid.blocks import Floats, Ints

MOST_POINTS: Final = 5000
"""The largest number of points of a line; of more, the least and the greatest of each bin stay."""
SHADE: Final = "_shade"
"""The label of a shade that stands for a long line in a picture: the chart has the line itself."""
FINE_X, FINE_Y = 6, 4
"""A number is a multiple of its panel's range over ten to this power, or of up to ten times less:
zoomed in a thousand times an instant still has its pixel, and a value one of ten steps."""
_FARTHEST: Final = 1e12
_DASHES: Final = {"--": [6, 4], ":": [1.5, 3]}
Part = dict[str, object]


def numbers_of(figure: Figure) -> str:
    """Return the numbers of a figure that was drawn, as JSON that may stand in a page's script.

    A list of numbers begins with its unit, whose multiples follow, or 0 before plain numbers; null
    is a gap. Of an instant its step from the one before is kept. Lines share the lists ``xs``.
    """
    named = [
        pair for ax in figure.axes for pair in zip(*ax.get_legend_handles_labels(), strict=True)
    ]
    names = {
        to_hex(line.get_color()): label
        for handle, label in named
        if isinstance(line := handle[0] if isinstance(handle, tuple) else handle, Line2D)
    }
    width, height = figure.get_size_inches()
    xs: list[list[float | None]] = []
    panels = [_panel(ax, names, xs) for ax in figure.axes]
    for ax, panel in zip(figure.axes, panels, strict=True):
        panel["tall"] = round(float(ax.get_position().height * height / width), 3)
    known = {"label": figure.axes[-1].get_xlabel(), "xs": xs, "panels": panels}
    text = json.dumps(known, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e")


def thinned(y: Floats, most: int = MOST_POINTS) -> Ints:
    """Return the rows that a line through ``y`` (n,) needs: the least and greatest of each bin."""
    if len(y) <= most:
        return np.arange(len(y))
    step = -(-len(y) // (most // 2))
    bins = np.pad(y, (0, -len(y) % step), constant_values=np.nan).reshape(-1, step)
    unknown, firsts = ~np.isfinite(bins), np.arange(len(bins)) * step
    ends = [np.where(unknown, far, bins) for far in (np.inf, -np.inf)]
    rows = [firsts + ends[0].argmin(axis=1), firsts + ends[1].argmax(axis=1)]
    return np.unique(np.concatenate(rows)).astype(np.int64)


def _panel(ax: Axes, names: dict[str, str], xs: list[list[float | None]]) -> Part:
    """Return one panel: its axes, and the lines, shapes, levels, spans and numbers in it."""
    lines = [each for each in ax.lines if len(np.atleast_1d(each.get_xdata()))]
    across = [each.get_transform().contains_branch_seperately(ax.transData) for each in lines]
    return {
        "label": re.sub(r"\s+", " ", ax.get_ylabel()),
        "x": [float(end) for end in ax.get_xlim()],
        "y": [float(end) for end in ax.get_ylim()],
        "logX": ax.get_xscale() == "log",
        "logY": ax.get_yscale() == "log",
        "lines": [
            part
            for line, data in zip(lines, across, strict=True)
            if all(data)
            for part in _pieces(ax, line, names, xs)
        ],
        "levels": [
            _level(line, upright=data[0])
            for line, data in zip(lines, across, strict=True)
            if not all(data)
        ],
        "shapes": [part for each in ax.collections for part in _shapes(ax, each)],
        "spans": [_span(each) for each in ax.patches if isinstance(each, Rectangle)],
        "numbers": [
            [float(each.xy[0]), each.get_text()]
            for each in ax.texts
            if isinstance(each, Annotation)
        ],
    }


def _pieces(
    ax: Axes, line: Line2D, names: dict[str, str], xs: list[list[float | None]]
) -> Iterator[Part]:
    """Yield a line, in pieces where its x goes back, as a chart needs it to ascend."""
    colour, (x, y) = to_hex(line.get_color()), np.asarray(line.get_xydata(), np.float64).T
    for piece in np.split(np.arange(len(x)), np.flatnonzero(np.diff(x) < 0.0) + 1):
        rows = piece[thinned(y[piece])]
        along = _multiples(ax, x[rows], "x")
        if along[0]:
            along[1:] = [along[1], *np.diff(np.array(along[1:], np.int64)).tolist()]
        if along not in xs:
            xs.append(along)
        yield {
            "name": names.get(colour, ""),
            "colour": colour,
            "width": round(float(line.get_linewidth()), 2),
            "dash": _DASHES.get(str(line.get_linestyle())),
            "steps": line.get_drawstyle() == "steps-post",
            "dots": line.get_linestyle() == "None",
            "x": xs.index(along),
            "y": _multiples(ax, y[rows], "y"),
        }


def _shapes(ax: Axes, drawn: Collection) -> Iterator[Part]:
    """Yield the areas and the bars of a collection."""
    if drawn.get_label() == SHADE or not isinstance(drawn, PolyCollection | LineCollection):
        return
    fill = isinstance(drawn, PolyCollection)
    colours = drawn.get_facecolor() if fill else drawn.get_edgecolor()
    for path in drawn.get_paths():
        x, y = np.asarray(path.vertices, np.float64).T
        colour = to_hex(np.asarray(colours)[0].tolist(), keep_alpha=True)
        along, up = _multiples(ax, x, "x"), _multiples(ax, y, "y")
        yield {"colour": colour, "fill": fill, "x": along, "y": up}


def _level(line: Line2D, *, upright: bool) -> Part:
    at = np.asarray(line.get_xdata() if upright else line.get_ydata(), np.float64)
    look = {"colour": to_hex(line.get_color()), "dash": _DASHES.get(str(line.get_linestyle()))}
    return {"at": float(at[0]), "upright": upright, **look}


def _span(drawn: Rectangle) -> Part:
    fill, edge = (
        to_hex(each, keep_alpha=True) for each in (drawn.get_facecolor(), drawn.get_edgecolor())
    )
    ends = drawn.get_x(), drawn.get_x() + drawn.get_width()
    return {"x": [*map(float, ends)], "fill": fill, "edge": edge, "hatch": bool(drawn.get_hatch())}


def _multiples(ax: Axes, values: Floats, axis: str) -> list[float | None]:
    """Return a unit and the multiples of it that the values are; 0 and themselves on a log axis."""
    log = (ax.get_xscale() if axis == "x" else ax.get_yscale()) == "log"
    low, high = ax.get_xlim() if axis == "x" else ax.get_ylim()
    known = np.isfinite(values)
    if log:
        plain = [float(f"{each:.6g}") for each in values.tolist()]
        return [0, *(each if ok else None for each, ok in zip(plain, known.tolist(), strict=True))]
    unit = 10.0 ** (math.floor(math.log10(high - low)) - (FINE_X if axis == "x" else FINE_Y))
    whole = np.rint(np.clip(np.where(known, values, 0.0) / unit, -_FARTHEST, _FARTHEST))
    multiples = whole.astype(np.int64).tolist()
    return [unit, *(each if ok else None for each, ok in zip(multiples, known, strict=True))]
