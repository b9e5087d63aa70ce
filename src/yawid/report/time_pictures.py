"""Pictures over time: the whole flight, a fit, and the running estimate."""

import math
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from yawid.blocks import Floats
from yawid.models.flown import Flown
from yawid.report.data import Drawn, ReportData
from yawid.report.picture import (
    Picture,
    band,
    mark_events,
    sensible_limits,
    traced,
)
from yawid.sinks.palette import DATA, METHODS, MODEL, NEUTRAL, RUDDER
from yawid.sinks.words import percent

PERIODS_SHOWN: Final = 12.0
"""Periods of the Dutch roll in the picture of a fit: with more, each is too narrow to compare."""
LEAST_SHOWN_S, MOST_SHOWN_S = 8.0, 40.0
OUTSIDE = 10.0
"""A simulated value more than this many heights of the picture outside it is not drawn."""
TIME_LABEL = "time since boot [s]"


def whole_picture(data: ReportData) -> Picture:
    """Return the picture of rudder and yaw rate over the whole flight, with the manoeuvres."""
    t, rudder, y = data.samples.boot_us / 1e6, data.samples.u[:, 0], data.samples.y
    used = t[np.isfinite(y)] if np.isfinite(y).sum() > 1 else t
    margin = 0.02 * np.ptp(used)

    def draw(figure: Figure) -> None:
        axes = figure.subplots(2, 1, sharex=True)
        axes[0].set_ylabel(f"rudder\n[{data.grid.rudder_unit}]")
        axes[1].set(xlabel=TIME_LABEL, ylabel="yaw rate\n[rad/s]")
        for ax, line, shade in zip(axes, (rudder, y), (RUDDER, DATA), strict=True):
            traced(ax, t, line, shade)
            ax.set_xlim(used.min() - margin, used.max() + margin)
            sensible_limits(ax, line, settled=0.0)
            mark_events(ax, data.events)

    look = "Where does the rudder move on its own? Grey: samples held. Dotted: change of mode."
    look += " Green: manoeuvres, by number; hatched: not usable." if data.events.manoeuvres else ""
    return Picture("whole", "The whole flight", look, draw, zooms=True)


def manoeuvre_picture(drawn: Drawn, rudder_unit: str) -> Picture:
    """Return a manoeuvre as measured, and as simulated by its answer's model."""
    found, judged = drawn.found, drawn.measured
    refused = "" if found.verdict.usable else ", not usable"
    title = f"Manoeuvre {found.n}{refused}: measured, and the model"
    rows = _shown(judged, drawn.wn_rad_s)
    whole = rows.stop - rows.start >= len(judged.t)
    low, high = _limits(judged.y[rows])
    room = OUTSIDE * (high - low)
    # A diverging model leaves the picture: no axis could show its values.
    inside = (judged.simulated > low - room) & (judged.simulated < high + room)
    simulated = np.where(inside, judged.simulated, np.nan)

    def draw(figure: Figure) -> None:
        panels = [(0.7, "overview")] * (not whole) + [(0.9, "u"), (2.2, "y"), (1.0, "left")]
        axes = figure.subplots(len(panels), 1, height_ratios=[share for share, _ in panels])
        if not whole:
            _overview(axes[0], judged, rows)
        rudder, yaw, left = axes[-3:]
        t = judged.t  # all of it, which zooms; the axes' limits are those of the rows shown
        rudder.plot(t, judged.u[:, 0], color=RUDDER, drawstyle="steps-post")
        rudder.set(ylabel=f"rudder\n[{rudder_unit}]", ylim=_limits(judged.u[rows, 0]))
        yaw.plot(t, judged.y, color=DATA, linewidth=2.4, label="measured")
        yaw.plot(t, simulated, color=MODEL, linewidth=1.1, label="model, from the rudder")
        yaw.set(ylabel="yaw rate\n[rad/s]", ylim=(low, high))
        left.plot(t, judged.y - simulated, color=NEUTRAL, linewidth=1.0)
        left.axhline(0.0, color=MODEL, linewidth=0.8)
        most = np.nanmax(np.abs((judged.y - simulated)[rows]), initial=0.02 * (high - low))
        left.set(xlabel=TIME_LABEL, ylabel="measured\n− model", ylim=(-1.1 * most, 1.1 * most))
        for ax in (rudder, yaw, left):
            ax.set_xlim(t[rows][0], t[rows][-1])
        for ax in (rudder, yaw):
            ax.tick_params(labelbottom=False)
        figure.align_ylabels(axes)
        figure.legend(*yaw.get_legend_handles_labels(), loc="outside upper right", ncols=2)

    share = None if found.answer is None else found.answer.fit.simulation_pct
    known = "an unknown share" if share is None else f"{percent(share, '.0f')} %"
    look = f"Run free from the rudder, the model explains {known} of the yaw rate."
    if not whole:
        look += (
            " The box above marks the stretch where the model swings most; the fit is of the whole "
            "record."
        )
    size_in = (5.6, 4.4 if whole else 4.9)
    return Picture(f"manoeuvre{found.n}", title, look, draw, size_in, zooms=True)


def _overview(ax: Axes, judged: Flown, rows: slice) -> None:
    traced(ax, judged.t, judged.u[:, 0], RUDDER)
    ax.axvspan(judged.t[rows.start], judged.t[rows.stop - 1], facecolor="none",
               edgecolor="#222222", linewidth=1.0)  # fmt: skip
    ax.set_xlim(judged.t[0], judged.t[-1])
    ax.set_yticks([])
    ax.set_ylabel("all of it", rotation=0, ha="right", va="center")


def _shown(judged: Flown, wn_rad_s: float) -> slice:
    """Return the rows, some periods of the Dutch roll long, in which the model swings most."""
    n = len(judged.t)
    seconds = min(max(PERIODS_SHOWN * 2.0 * math.pi / wn_rad_s, LEAST_SHOWN_S), MOST_SHOWN_S)
    step = float(np.median(np.diff(judged.t))) if n > 1 else 1.0
    width = round(seconds / step) if step > 0.0 else n
    if n <= 1.3 * width:
        return slice(0, n)
    y = np.where(np.isfinite(judged.simulated), judged.simulated, judged.y)
    limit = np.nanmax(np.abs(judged.y), initial=1e-9)
    y = np.clip(np.nan_to_num(y), -limit, limit)
    sums, squares = (np.concatenate([[0.0], np.cumsum(x)]) for x in (y, y * y))
    mean = (sums[width:] - sums[:-width]) / width
    first = int(np.argmax((squares[width:] - squares[:-width]) / width - mean**2))
    return slice(first, first + width)


def _limits(y: Floats) -> tuple[float, float]:
    """Return limits of the y axis that leave room around the measured values."""
    known = y[np.isfinite(y)]
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    room = 0.15 * max(high - low, 1e-3)
    return low - room, high + room


def modes_picture(data: ReportData) -> Picture:
    """Return the picture of the running estimate's wn and zeta over time."""
    (t, *columns), method = data.track.T, data.grid.methods[0]
    shade = METHODS.get(method, MODEL)

    def draw(figure: Figure) -> None:
        axes = figure.subplots(2, 1, sharex=True)
        for ax, label, value, std in zip(
            axes, ("ωn [rad/s]", "ζ"), columns[::2], columns[1::2], strict=True
        ):
            spread = np.where(2.0 * std < np.maximum(np.abs(value), 0.5), 2.0 * std, np.nan)
            ax.plot(t, value, color=shade)
            band(ax, t, value - spread, value + spread, shade)
            sensible_limits(ax, value, value - spread, value + spread, least=0.5)
            ax.set_ylabel(label)
            mark_events(ax, data.events)
        axes[-1].set_xlabel(TIME_LABEL)

    look = (
        f"The estimates of {method.upper()} sample by sample. Has each line settled before the "
        "end? Band: 2 sigma of noise alone; a line that leaves its earlier band is moved by more "
        "than noise. What lies far outside is cut off."
    )
    return Picture("modes", "Dutch roll over time", look, draw, zooms=True)
