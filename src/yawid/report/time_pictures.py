"""Pictures over time: the fit, parameters, modes, and what the link did."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from yawid.blocks import Floats
from yawid.report.data import Judged, ReportData
from yawid.report.picture import (
    Picture,
    band,
    drawn,
    manoeuvres_note,
    mark_events,
    sensible_limits,
)
from yawid.results.run_summary import Fit, MethodSummary
from yawid.sinks.answers import percent
from yawid.sinks.base import Grid
from yawid.sinks.palette import DATA, LINES, METHODS, MODEL, NEUTRAL, RUDDER

FIT_WINDOW_S = 30.0
OUTSIDE = 10.0
"""A line that is so many heights of the picture above or below it is not drawn on."""
MOST_NAMED = 9
"""Lines of a panel that its legend names: more leave no room for the lines."""
TIME_LABEL = "time since boot [s]"


def fit_picture(data: ReportData, fit: Fit, grid: Grid) -> Picture:
    """Rudder and yaw rate where the rudder moved most: measured, one step ahead, simulated."""
    judged = data.judged
    rows = _most_moved(judged, round(FIT_WINDOW_S / data.model.sample_time_s))
    t, y, y_hat = judged.t[rows], judged.y[rows], judged.y_hat[rows]
    low, high = _limits(y)
    room = OUTSIDE * (high - low)
    # A model that explodes leaves the picture: no axis holds what it becomes.
    simulated, y_hat = (
        np.where((line > low - room) & (line < high + room), line, np.nan)
        for line in (judged.simulated[rows], y_hat)
    )

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1, 2.4])
        upper.plot(t, judged.u[rows, 0], color=RUDDER, drawstyle="steps-post")
        upper.set_ylabel(f"rudder\n[{grid.rudder_unit}]")
        lower.plot(t, y, color=DATA, label="measured")
        lower.plot(t, y_hat, color=NEUTRAL, linewidth=0.9, label="one step ahead")
        lower.plot(t, simulated, color=MODEL, linewidth=0.9, label="simulated")
        lower.set_ylabel("yaw rate [rad/s]")
        lower.set_ylim(low, high)
        lower.set_xlabel(TIME_LABEL)
        figure.legend(*lower.get_legend_handles_labels(), loc="outside upper right", ncols=3)
        mark_events(lower, data.events)

    numbers = [
        f"{name} {percent(value, '.0f')} %"
        for name, value in (("one step ahead", fit.one_step_pct), ("simulated", fit.simulation_pct))
        if value is not None
    ]
    look = (
        "Does the red line, the model run free from the rudder alone, follow the blue one in size "
        "and time? One step ahead flatters every model. "
        f"Fit over all that is judged: {', '.join(numbers) or 'not known'}. "
        "Shown: the 30 s in which the rudder moved most." + manoeuvres_note(data.events)
    )
    return Picture("fit", "Fit: measured, predicted, simulated", look, drawn("fit", draw))


def _limits(y: Floats) -> tuple[float, float]:
    """Return limits of the y axis that leave room around what was measured."""
    known = y[np.isfinite(y)]
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    room = 0.4 * max(high - low, 1e-3)
    return low - room, high + room


def _most_moved(judged: Judged, width: int) -> slice:
    """Return the ``width`` rows with most movement of the rudder."""
    n = len(judged.t)
    if n <= width:
        return slice(0, n)
    moved = np.abs(np.diff(np.nan_to_num(judged.u[:, 0]), prepend=0.0))
    moved[0] = 0.0
    total = np.concatenate([[0.0], np.cumsum(moved)])
    first = int(np.argmax(total[width:] - total[:-width]))
    return slice(first, first + width)


def parameters_picture(data: ReportData, run_grid: Grid) -> Picture:
    """Theta over time with its 2 sigma band, a panel for each polynomial."""
    track, names = data.track, run_grid.parameters
    unit = " or ".join(dict.fromkeys(run_grid.unit_of(name) for name in run_grid.inputs))
    groups = [("A", "a"), (f"B [rad/s per {unit}]", "b"), ("C", "c"), ("bias [rad/s]", "bias")]
    panels = [(title, [i for i, n in enumerate(names) if _group(n) == g]) for title, g in groups]
    panels = [(title, columns) for title, columns in panels if columns]

    def draw(figure: Figure) -> None:
        grid = figure.subplots(-(-len(panels) // 2), 2, sharex=True, squeeze=False)
        for ax, (title, columns) in zip(grid.flat, panels, strict=False):
            lines = []
            for count, i in enumerate(columns):
                shade = LINES[count % len(LINES)]
                theta, spread = track.theta[:, i], 2.0 * track.theta_std[:, i]
                ax.plot(track.t, theta, color=shade, label=names[i] if count < MOST_NAMED else None)
                band(ax, track.t, theta - spread, theta + spread, shade)
                lines += [theta]
            sensible_limits(ax, *lines)
            mark_events(ax, data.events)
            # Above the lines: within so small a panel it would lie on them.
            ax.legend(title=title, loc="lower left", bbox_to_anchor=(0.0, 1.0), alignment="left",
                      ncols=min(len(columns), 3), borderaxespad=0.0)  # fmt: skip
        for ax in list(grid.flat)[len(panels) :]:
            ax.set_axis_off()
        for ax in grid[-1]:
            ax.set_xlabel(TIME_LABEL)

    look = (
        "Do the lines settle and stay within their own bands (2 sigma of noise)? A line that still "
        "drifts says that the aircraft, its speed or the noise changed. Grey: samples held; "
        "dotted: the flight mode changed." + manoeuvres_note(data.events)
    )
    svg = drawn("parameters", draw, (5.6, 4.2))
    return Picture("parameters", "Parameters over time", look, svg)


def _group(name: str) -> str:
    return "bias" if name == "bias" else name[:1]


def modes_picture(data: ReportData, method: str, others: Mapping[str, MethodSummary]) -> Picture:
    """Natural frequency and damping ratio over time; the other methods' final values as levels."""
    track = data.track

    def draw(figure: Figure) -> None:
        axes = figure.subplots(2, 1, sharex=True)
        shade = METHODS.get(method, MODEL)
        names = (("ωn [rad/s]", "wn_rad_s", shade), ("ζ", "zeta", shade))
        for i, (ax, (label, key, shade)) in enumerate(zip(axes, names, strict=True)):
            value, spread = track.dutch_roll[:, 2 * i], 2.0 * track.dutch_roll[:, 2 * i + 1]
            spread = np.where(spread < np.maximum(np.abs(value), 0.5), spread, np.nan)
            ax.plot(track.t, value, color=shade)
            band(ax, track.t, value - spread, value + spread, shade)
            sensible_limits(ax, value - spread, value + spread)
            for other, estimate in others.items():
                if estimate.dutch_roll is not None:
                    level = getattr(estimate.dutch_roll, key)
                    _level(ax, level, f"{other.upper()} at the end: {level:.3g}")
            ax.set_ylabel(label)
            mark_events(ax, data.events)
        axes[-1].set_xlabel(TIME_LABEL)

    look = (
        "Has each line settled long before the end, with a band narrow enough for your purpose? "
        "The band is 2 sigma of noise alone: a line that leaves its earlier band is moved by more "
        "than noise." + manoeuvres_note(data.events)
    )
    return Picture("modes", "Dutch roll over time", look, drawn("modes", draw))


def _level(ax: Axes, level: float, text: str) -> None:
    """Draw and name a level; one that is off the picture is named at its edge."""
    low, high = ax.get_ylim()
    if low < level < high:
        ax.axhline(level, color=NEUTRAL, linewidth=0.9, linestyle="--")
    else:
        text += ", off the picture"
    ax.annotate(
        text, (0.99, min(max(level, low), high)), xycoords=("axes fraction", "data"), ha="right",
        va="top" if level >= high else "bottom", fontsize=8, color="#555555",
    )  # fmt: skip


def link_picture(data: ReportData) -> Picture:
    """How late each sample was complete, and what was held."""
    events = data.events

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        delay_ms = 1e3 * events.delay_s
        ax.plot(events.delay_t, delay_ms, color=DATA, linewidth=0.9)
        ax.set_ylabel("delay of a sample [ms]")
        ax.set_xlabel(TIME_LABEL)
        ax.set_ylim(bottom=min(0.0, float(delay_ms.min())))
        mark_events(ax, events)

    look = (
        "From the instant a sample belongs to until it was complete at the receiver. Flat is a "
        "good link; spikes are stalls, a slope is a drifting clock. The estimates use the "
        "vehicle's own clock, so that delay alone does no harm. Grey: held."
        + manoeuvres_note(data.events)
    )
    return Picture("link", "Link: delay and held samples", look, drawn("link", draw, (5.6, 2.6)))
