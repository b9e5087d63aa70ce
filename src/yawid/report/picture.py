"""The report's pictures: matplotlib figures, as SVG within a page, with numbers to zoom in."""

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from yawid.blocks import Floats
from yawid.report.data import Events
from yawid.report.html import NUMBERS
from yawid.report.zoom import SHADE, numbers_of
from yawid.sinks.palette import NEUTRAL, RUDDER

SIZE_IN: Final = (5.6, 4.4)
COLUMNS: Final = 500
"""The number of columns of a long line in a picture: more detail is not visible."""
LEAST_BETWEEN: Final = 0.035
"""The least distance between the numbers of two manoeuvres, as a part of the axis."""
_STYLE: Any = {  # Any: matplotlib's type for it lists every key
    "svg.fonttype": "none",  # text stays text: it can be searched and is drawn sharp
    "svg.hashsalt": "yawid",  # equal pictures have equal bytes
    "text.parse_math": False,  # names come from a log: a dollar sign in them begins no formula
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "legend.handlelength": 1.6,
    "axes.labelcolor": "#222222",
    "text.color": "#222222",
    "figure.constrained_layout.use": True,
}
_FONTS: Final = "'DejaVu Sans', Verdana, sans-serif"  # Verdana has nearly the same widths


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture: its id in the page, its title, what to look for, and how to draw it.

    One that ``zooms`` has lines over ascending x, for which a browser makes charts.
    """

    key: str
    title: str
    look: str
    draw: Callable[[Figure], None]
    size_in: tuple[float, float] = SIZE_IN
    zooms: bool = False

    @property
    def svg(self) -> str:
        """The picture as SVG for a page; all ids in it begin with its key."""
        return self._drawn()[0]

    @property
    def html(self) -> str:
        """The picture as SVG, and its numbers where it zooms."""
        svg, figure = self._drawn()
        return f"{svg}\n{NUMBERS}{numbers_of(figure)}</script>" if self.zooms else svg

    def _drawn(self) -> tuple[str, Figure]:
        out = io.StringIO()
        with mpl.rc_context():
            mpl.rcdefaults()  # not the user's style: equal runs must give equal reports
            mpl.rcParams.update(_STYLE)
            figure = Figure(figsize=self.size_in)
            self.draw(figure)
            figure.set(facecolor="none", edgecolor="none")
            for axes in figure.axes:
                axes.patch.set(facecolor="none", edgecolor="none")
            nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
            canvas = FigureCanvasSVG(figure)  # Figure.savefig would draw twice, once for nothing
            canvas.print_svg(out, metadata=nothing)  # type: ignore[no-untyped-call] # matplotlib's
        svg = out.getvalue()
        svg = svg[svg.index("<svg") :]
        # Many pictures share one page: their ids must differ, and the page sets their size.
        svg = re.sub(r'(\bid="|="#|url\(#)', rf"\g<1>{self.key}-", svg)
        # A hundredth of a point is finer than any printer.
        svg = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), svg)
        svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
        svg = svg.replace("'DejaVu Sans'", _FONTS)
        svg = re.sub(
            r'^<svg ([^>]*?)width="[^"]*" height="[^"]*"', r"<svg \1", svg.strip(), count=1
        )
        return svg, figure


GAP = 3.0
"""Rows that are further apart than so many of the usual distance are not joined by a line."""


def traced(ax: Axes, t: Floats, x: Floats, shade: str) -> None:
    """Draw a long line; where a column holds many samples, shade from their least to greatest.

    Where time goes back, after a reboot, or rows are missing, another line begins.
    """
    step, apart = -(-len(t) // COLUMNS), np.diff(t)
    usual = np.median(apart) if len(apart) else 0.0
    breaks = np.flatnonzero((apart < 0.0) | (apart > GAP * usual)) + 1
    for rows in np.split(np.arange(len(t)), breaks):
        # A long line itself is for zooming.
        ax.plot(t[rows], x[rows], color=shade, linewidth=0.9, visible=step <= 2)
        if step <= 2:
            continue
        starts = np.arange(0, len(rows), step)
        low, high = (each.reduceat(x[rows], starts) for each in (np.fmin, np.fmax))
        ax.fill_between(t[rows][starts], low, high, color=shade, alpha=0.55, linewidth=0.4,
                        label=SHADE)  # fmt: skip


def log_axis(ax: Axes) -> None:
    """Make the frequencies of a picture logarithmic, with numbers at 1, 2 and 5 of each decade."""
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())


def band(ax: Axes, x: Floats, low: Floats, high: Floats, shade: str, alpha: float = 0.2) -> None:
    """Shade the area between two lines."""
    ax.fill_between(x, low, high, color=shade, alpha=alpha, linewidth=0.0)


def mark_events(ax: Axes, events: Events) -> None:
    """Shade manoeuvres and held stretches and mark changes of mode; the axis keeps its limits."""
    low, high = ax.get_xlim()
    _mark_manoeuvres(ax, events, low, high)
    for first, last in events.held[:200]:
        if last > low and first < high:
            ax.axvspan(first, last, color=NEUTRAL, alpha=0.25, linewidth=0.0)
    for instant in events.mode_changes[:200]:
        if low < instant < high:
            ax.axvline(instant, color=NEUTRAL, linewidth=0.8, linestyle=":")
    ax.set_xlim(low, high)


def _mark_manoeuvres(ax: Axes, events: Events, low: float, high: float) -> None:
    """Shade each manoeuvre and number it at the top; one that is not usable is hatched."""
    last_number = -np.inf
    for each in events.manoeuvres[:200]:
        first, last = max(each.from_s, low), min(each.to_s, high)
        if first >= last:
            continue
        if each.verdict.usable:
            ax.axvspan(first, last, color=RUDDER, alpha=0.13, linewidth=0.0)
        else:
            ax.axvspan(first, last, facecolor="none", edgecolor="#cfcfcf", hatch="////", lw=0.0)
        middle = (first + last) / 2.0
        # Closer numbers would hide each other.
        if abs(middle - last_number) > LEAST_BETWEEN * (high - low):
            ax.annotate(str(each.n), (middle, 0.99), xycoords=("data", "axes fraction"),
                        ha="center", va="top", fontsize=7.5, color="#555555")  # fmt: skip
            last_number = middle


def sensible_limits(ax: Axes, *lines: Floats, settled: float = 0.25, least: float = 0.0) -> None:
    """Limit the y axis to the range in which the lines settle, since transients may be large.

    ``settled`` is the first part of each line that may be a transient. The range is at least
    ``least`` times its middle value.
    """
    known = np.concatenate([line[int(settled * len(line)) :] for line in lines])
    known = known[np.isfinite(known)]
    if not len(known):
        return
    low, high = np.percentile(known, [1.0, 99.0] if settled else [0.1, 99.9])
    room = 0.15 * max(high - low, 1e-3 * max(abs(low), abs(high)), 1e-9)
    room = max(room, 0.5 * (least * abs(low + high) / 2.0 - (high - low)))
    ax.set_ylim(low - room, high + room)
