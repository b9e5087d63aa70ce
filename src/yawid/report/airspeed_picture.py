"""The picture of wn and zeta of a flight's manoeuvres over the airspeed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from yawid.answers.run_summary import DutchRoll, Flight, Manoeuvre, Value
from yawid.blocks import Bools, Floats
from yawid.report.picture import Picture, band
from yawid.sinks.palette import BAD, LINES, MANOEUVRE, MODEL, NEUTRAL
from yawid.sinks.words import NOT_USED, loop_of, outcome

MOST_NUMBERED: Final = 12
"""Up to this many points have their numbers: with more, the numbers would hide each other."""
PANEL_PT: Final = np.array([340.0, 110.0])
"""The least width and height of a panel within its axes, in points of 1/72 inch."""
NUMBER_PT: Final = np.array([11.0, 7.5])
"""Width and height of a number of two digits."""
MARKER_PT: Final = 5.0
_PLACES: Final = [
    np.array([side * 9.0, 5.0 * k]) for k in (1, -1, 0, 2, -2, 3, -3, 4, -4) for side in (1, -1)
]
"""Where the number of a point may stand, in points from its marker, the best place first."""
LEAST_SPAN: Final = 0.1
"""The least width of the axis as a part of V: a change of 0.1 m/s must not fill the picture."""
SIGMAS: Final = 2.0
_REFUSED: Final = "not usable"
_LOOKS: Final[dict[str, dict[str, Any]]] = {
    "used": {"marker": "o", "color": MANOEUVRE},
    NOT_USED: {"marker": "o", "color": MANOEUVRE, "fillstyle": "none"},
    "disagrees": {"marker": "D", "color": BAD},
    _REFUSED: {"marker": "x", "color": NEUTRAL, "alpha": 0.8},
}
ALIKE: Final = 0.03
"""A range of airspeeds smaller than this part of V counts as one airspeed: then the manoeuvres are
drawn side by side."""
_COLOURS: Final = (MODEL, LINES[2], LINES[4])
_MARKERS: Final = ("o", "s", "^")
"""The colours of the flight's answers by loop and the markers of their manoeuvres, the headline's
first."""
_TITLES: Final = {False: "The manoeuvres over airspeed", True: "The manoeuvres side by side"}
_PANELS: Final = ("ωn [rad/s]", "ζ")


@dataclass(frozen=True, slots=True)
class _Points:
    """The m manoeuvres whose airspeed and Dutch roll are known.

    n (m,) their numbers; kind (m,) their results in words; speed (m,) in m/s; value (m, 2) wn in
    rad/s and zeta; spread (m, 2) 2 sigma of these, 0 where unknown; within (m, 2) whether a point
    is drawn in each panel; limits (2, 2) of the two panels.
    """

    n: list[int]
    kind: list[str]
    speed: Floats
    value: Floats
    spread: Floats
    within: Bools
    limits: Floats


def airspeed_picture(manoeuvres: Sequence[Manoeuvre], flights: Sequence[Flight]) -> Picture | None:
    """Return wn and zeta over airspeed, None where fewer than two manoeuvres have both."""
    known = [
        (each, each.airspeed_m_s, mode)
        for each in manoeuvres
        if each.airspeed_m_s is not None and (mode := each.dutch_roll) is not None
    ]
    if len(known) < 2:
        return None
    points = _points(known, flights)
    alike = _ends(points.speed)[1] > 0.0 and np.ptp(points.speed) < ALIKE * points.speed.max()
    if alike:  # they are drawn side by side: at one airspeed they would hide each other
        points = replace(points, speed=np.array(points.n, dtype=np.float64))
    sources = sorted({each.airspeed_source or "airspeed" for each, _, _ in known})

    by_loop = {
        _of(flight.loop): {"marker": marker, "color": colour}
        for flight, marker, colour in zip(flights, _MARKERS, _COLOURS, strict=False)
    }
    looks = by_loop | _LOOKS

    def draw(canvas: Figure) -> None:
        axes = canvas.subplots(2, 1, sharex=True)
        for i, ax in enumerate(axes):
            if alike:
                ax.set_xlim(min(points.n) - 0.7, max(points.n) + 0.7)
                ax.xaxis.set_major_locator(MaxNLocator(integer=True))
            else:
                ax.set_xlim(*_ends(points.speed))
            ax.set(ylim=points.limits[i], ylabel=_PANELS[i])
            for flight, colour in zip(flights, _COLOURS, strict=False):
                name = f", {loop_of(flight.loop).name}" if len(flights) > 1 else ""
                _draw_flight(ax, flight, i, colour, name, alike=alike)
            _draw_points(ax, points, i, looks)
            if not alike and len(points.n) <= MOST_NUMBERED:
                _draw_numbers(ax, points, i)
        axes[1].set_xlabel("manoeuvre" if alike else f"{' or '.join(sources)} [m/s]")
        canvas.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=3)

    if alike:
        look = "All at one airspeed: do they agree? Bars, and bands of the flight: 2 sigma."
    else:
        grows = any(each.kappa_rad_m for each in flights)
        line = "along the line ωn = κV" if grows else "in proportion"
        look = f"Does ωn grow with the airspeed, {line}, and does ζ stay? Bars and bands: 2 sigma."
    if hidden := int(np.sum(~points.within.all(axis=1))):
        look += f" Off the picture: {hidden} that cannot be used."
    return Picture("airspeed", _TITLES[alike], look, draw)


def _points(known: list[tuple[Manoeuvre, float, DutchRoll]], flights: Sequence[Flight]) -> _Points:
    kind = [_kind(m, flights) for m, _, _ in known]
    value = np.array([_values(mode) for _, _, mode in known])
    spread = SIGMAS * np.array([_sigmas(mode) for _, _, mode in known])
    sure = np.array([each != _REFUSED for each in kind])
    # Answers that are not usable may have any value: the others set the limits of the picture.
    shown = sure if sure.any() else np.full(len(kind), fill_value=True)
    reach = np.minimum(spread, 0.5 * np.abs(value))
    ends = np.concatenate([(value - reach)[shown], (value + reach)[shown]])
    for roll in (each.dutch_roll for each in flights if each.dutch_roll is not None):
        middle, reach = np.array(_values(roll)), np.array(_sigmas(roll))
        ends = np.vstack([ends, middle - SIGMAS * reach, middle + SIGMAS * reach])
    low, high = ends.min(axis=0), ends.max(axis=0)
    room = np.maximum(high - low, 0.05 * np.abs(high))
    within = shown[:, None] | ((value > low - room) & (value < high + room))
    drawn_ends = np.where(within, value, low)
    low, high = np.minimum(low, drawn_ends.min(axis=0)), np.maximum(high, drawn_ends.max(axis=0))
    limits = np.column_stack([low - 0.15 * room, high + 0.15 * room])
    speed = np.array([v for _, v, _ in known])
    return _Points([m.n for m, _, _ in known], kind, speed, value, spread, within, limits)


def _kind(manoeuvre: Manoeuvre, flights: Sequence[Flight]) -> str:
    if not manoeuvre.verdict.usable:
        return _REFUSED
    result = outcome(manoeuvre, flights)
    return _of(manoeuvre.loop) if result == "used" and len(flights) > 1 else result


def _of(loop: str | None) -> str:
    return f"used, {loop_of(loop).name}"


def _values(mode: DutchRoll) -> tuple[float, float]:
    return mode.wn_rad_s, mode.zeta


def _sigmas(mode: DutchRoll) -> tuple[float, float]:
    return mode.wn_std or 0.0, mode.zeta_std or 0.0


def _ends(speed: Floats) -> Floats:
    """Return the limits (2,) of the axis of airspeeds."""
    low, high = float(speed.min()), float(speed.max())
    width = max(1.2 * (high - low), LEAST_SPAN * abs(high), 1e-3)
    return (low + high) / 2.0 + np.array([-0.5, 0.5]) * width


def _draw_points(ax: Axes, points: _Points, i: int, looks: Mapping[str, Mapping[str, Any]]) -> None:
    tall = float(np.diff(points.limits[i])[0])
    for kind, look in looks.items():
        rows = points.within[:, i] & np.array([each == kind for each in points.kind])
        if rows.any():
            bars = np.minimum(points.spread[rows, i], 10.0 * tall)  # longer bars leave it anyway
            ax.errorbar(
                points.speed[rows], points.value[rows, i], bars, linestyle="none", markersize=5,
                elinewidth=0.9, label=kind, **look,
            )  # fmt: skip


def _draw_numbers(ax: Axes, points: _Points, i: int) -> None:
    """Write the number of each point in the first place that hides no point and no number."""
    shown = np.flatnonzero(points.within[:, i])
    at = np.column_stack([points.speed, points.value[:, i]])[shown]
    markers = at * PANEL_PT / [np.ptp(ax.get_xlim()), np.ptp(points.limits[i])]
    taken = markers
    for j, place, marker in zip(shown, at, markers, strict=True):
        free = (each for each in _PLACES if _is_free(marker + each, taken, len(markers)))
        offset = next(free, _PLACES[0])
        taken = np.vstack([taken, marker + offset])
        ax.annotate(
            str(points.n[j]), tuple(place), tuple(offset), textcoords="offset points",
            ha="center", va="center", fontsize=NUMBER_PT[1],
        )  # fmt: skip


def _is_free(place: Floats, taken: Floats, markers: int) -> bool:
    """Return whether a number at ``place`` hides none of the ``taken`` places, the markers first.

    ``place`` (2,) and ``taken`` (m, 2) are in points of 1/72 inch.
    """
    least = np.where(
        np.arange(len(taken))[:, None] < markers, (NUMBER_PT + MARKER_PT) / 2, NUMBER_PT
    )
    return bool((np.abs(taken - place) >= least).any(axis=1).all())


def _draw_flight(ax: Axes, flight: Flight, i: int, colour: str, name: str, *, alike: bool) -> None:
    """Draw the line of kappa or that of a constant, and the point of the flight's answer."""
    mode, kappa = flight.dutch_roll, flight.kappa_rad_m
    x = np.array(ax.get_xlim())
    if i == 0 and not alike and kappa is not None and kappa.value is not None:
        _line(ax, x, kappa, x, colour, f"ωn = {kappa.value:.3g} V{name}")
    if mode is None:
        return
    value, sigma = _values(mode)[i], _sigmas(mode)[i]
    if i == 1 or alike:
        label = f"the flight{name}" if alike else None
        _line(ax, x, Value(value, sigma), np.ones(2), colour, label)
    if not alike and flight.airspeed_m_s is not None:
        ax.errorbar(
            [flight.airspeed_m_s], [value], [SIGMAS * sigma], marker="*", markersize=11,
            color=colour, elinewidth=1.6, linestyle="none", label=f"the flight{name}", zorder=1.9,
        )  # fmt: skip


def _line(ax: Axes, x: Floats, slope: Value, along: Floats, colour: str, label: str | None) -> None:
    value, spread = (slope.value or 0.0) * along, SIGMAS * (slope.std or 0.0) * along
    first = colour == _COLOURS[0]
    dark = "#444444" if first else colour
    ax.plot(x, value, color=dark, linestyle="--", linewidth=1.0, label=label, zorder=1.5)
    band(ax, x, value - spread, value + spread, NEUTRAL if first else colour)
