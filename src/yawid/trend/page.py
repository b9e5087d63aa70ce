"""The page of ``yawid trend``: one HTML file in the report's style."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from yawid.quantities.table import QUANTITIES
from yawid.report.html import Cell, head, listed, note, page, pictures, sheet
from yawid.report.picture import Picture, band
from yawid.sinks.palette import BAD, DATA, NEUTRAL
from yawid.system.part_file import written_whole
from yawid.trend import words
from yawid.trend.days import FAR, alike
from yawid.trend.history import FOLLOWED
from yawid.trend.trend import Followed, Studied, Trend

MOST_VEHICLES: Final = 12
"""Most vehicles that get a picture of their own: those that changed come first."""
MOST_COMPARED: Final = 60
"""Most vehicles in the picture that compares them."""
SIGMAS: Final = 2.0
"""Length of an error bar and half width of a band, in sigmas."""
LEAST_DAYS: Final = 2.0
"""Least length of the axis of dates in days."""


def write_page(
    report: Trend, studied: Sequence[Studied], path: Path, *, force: bool = False
) -> None:
    """Write the page of a data set's trends to ``path``.

    Raises:
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """
    title = f"{Path(report.dataset).name} - yawid trend"
    with written_whole(path, force=force) as stream:
        stream.write(page(title, _sections(report, studied)).encode("utf-8", "replace"))


def _sections(report: Trend, studied: Sequence[Studied]) -> Iterator[str]:
    changed = [each for each in report.followed if each.change is not None]
    sentence = f"{len(changed)} of {len(report.followed)} histories changed." if changed else (
        "Nothing changed beyond chance."
    )  # fmt: skip
    if not report.judged:
        sentence = f"{words.not_tested(report).capitalize()}."
    name, origin = Path(report.dataset).name, f"{report.dataset} · {words.flights_line(report)}"
    yield head(name, origin, sentence, listed(_changes(report)),
               usable=not changed and report.judged > 0)  # fmt: skip
    if studied:
        by_vehicle = alike(studied, lambda each: (each.history.vehicle, each.history.loop))
        first = sorted(by_vehicle, key=lambda some: all(e.change is None for e in some))
        shown = [_picture(i, some) for i, some in enumerate(first[:MOST_VEHICLES])]
        yield pictures("Over the flights", shown)
        more = len(first) - len(shown)
        yield note(
            "",
            "Bars are 2 sigma of each flight, the line is the level and what changed, the band 2 "
            "sigma with the scatter between flights. Grey: too far off to count; a triangle: "
            "outside the picture."
            + (f" {more} more vehicles are only in the table." if more else ""),
        )
        if len(by_vehicle) > 1:
            yield pictures("The vehicles next to each other", list(_compared(studied)))
    heading = (
        "vehicle", "", "flights", "now", "a year", "season", "a flight",
        "between flights", "next to others", "result",
    )  # fmt: skip
    yield sheet(
        "Every history", heading, [(_row(each), not each.tested) for each in report.followed]
    )
    yield note(
        "",
        "± is one sigma. Now: the level after the last change. A year, a flight: slope of a "
        "straight line. Between flights: their scatter beyond their own sigmas. Next to others: "
        "its distance in sigmas from the median of the vehicles of its type."
        + (f" {words.rate_line(report)}." if report.judged else ""),
    )
    yield note("What this cannot do", " ".join(words.LIMITS))


def _changes(report: Trend) -> Iterator[tuple[str, str, str, str]]:
    """Yield weight, name, text and advice of each change, then of each possible season."""
    for each in report.followed:
        if each.change is not None:
            otherwise = "; ".join(each.change.measured_otherwise)
            advice = f"The measurement changed there too: {otherwise}." if otherwise else (
                "Look at the flights on both sides of it, and at what was done to the aircraft."
            )  # fmt: skip
            yield "fatal", _whose(each), words.change_line(each.change), advice
    for warning in report.warnings:
        yield warning.weight, f"warning {warning.id}", warning.text, ""
    for each in report.followed:
        if each.may_be_season is not None:
            yield "", _whose(each), words.season_line(each.may_be_season), ""


def _whose(each: Followed) -> str:
    return f"{each.vehicle} {words.name_of(each.quantity)}"


def _row(each: Followed) -> Iterator[Cell]:
    yield each.vehicle, each.loop.replace("_", " ")
    yield words.name_of(each.quantity), each.unit
    yield str(each.flights), f"{each.first_date[:10]} to {each.last_date[:10]}"
    yield words.spread(each.now), ""
    yield words.spread(each.slope_per_year), ""
    yield ("–", "") if (season := each.season) is None else (
        words.spread(season.amplitude), f"highest on {season.peak}"
    )  # fmt: skip
    yield words.spread(each.slope_per_flight), ""
    yield "–" if each.between_std is None else f"{each.between_std:.2g}", ""
    yield "–" if each.beside is None else f"{each.beside.sigmas:+.1f}", ""
    yield words.result(each), "; ".join(words.outlier_line(one) for one in each.outliers)


def _picture(i: int, some: Sequence[Studied]) -> Picture:
    """Return the histories of one vehicle, one above the other."""
    vehicle, loop = some[0].history.vehicle, some[0].history.loop

    def draw(canvas: Figure) -> None:
        axes = canvas.subplots(len(some), 1, sharex=True, squeeze=False)[:, 0]
        for ax, each in zip(axes, some, strict=True):
            _draw_history(ax, each)
        first, last = axes[-1].get_xlim()  # in days
        if last - first < LEAST_DAYS:  # the locator cannot divide an axis of one hour
            axes[-1].set_xlim(first - LEAST_DAYS / 2.0, last + LEAST_DAYS / 2.0)
        locator = AutoDateLocator(minticks=3, maxticks=8)  # type: ignore[no-untyped-call]  # matplotlib's own
        axes[-1].xaxis.set_major_locator(locator)
        formatter = ConciseDateFormatter(locator)  # type: ignore[no-untyped-call]  # likewise
        axes[-1].xaxis.set_major_formatter(formatter)

    look = "; ".join(
        f"{words.name_of(each.history.quantity)}: {words.result(each.followed)}" for each in some
    )
    size_in = 5.6, 1.2 + 1.35 * len(some)
    return Picture(f"trend{i}", f"{vehicle} ({loop.replace('_', ' ')})", look, draw, size_in)


def _draw_history(ax: Axes, each: Studied) -> None:
    track, level = each.history.track, each.level
    when: Any = track.dates.astype("datetime64[us]")
    far = ~level.kept
    for rows, shade in ((~far, DATA), (far, NEUTRAL)):
        if rows.any():
            ax.errorbar(
                when[rows], track.value[rows], SIGMAS * track.sigma[rows], linestyle="none",
                marker="o", markersize=3.0, elinewidth=0.7, color=shade,
            )  # fmt: skip
    shade = BAD if each.change is not None else "#444444"
    ax.plot(when, level.fitted, color=shade, linewidth=1.3, zorder=3)
    reach = SIGMAS * each.fitted.std
    band(ax, when, level.fitted - reach, level.fitted + reach, NEUTRAL)
    # The axis ends before flights far off, which would flatten all others.
    room = FAR * 1.5 * float(np.median(each.fitted.std))
    low, high = float(level.fitted.min()) - room, float(level.fitted.max()) + room
    if high > low:
        ax.set_ylim(low, high)
        for rows, place, marker in ((track.value > high, high, "^"), (track.value < low, low, "v")):
            if rows.any():
                at = np.full(rows.sum(), place)
                ax.plot(when[rows], at, marker, color=NEUTRAL, markersize=4)
    unit = QUANTITIES[each.history.quantity].unit_for().split(" ")[0]
    ax.set_ylabel(f"{words.name_of(each.history.quantity)}{f' [{unit}]' if unit else ''}")


def _compared(studied: Sequence[Studied]) -> Iterator[Picture]:
    for quantity in FOLLOWED:
        some = [each for each in studied if each.history.quantity == quantity]
        some = sorted(some, key=lambda each: each.level.value)
        if len(some) < 2:
            continue
        if len(some) > MOST_COMPARED:  # keep both ends, and evenly chosen vehicles between them
            rows = np.unique(np.linspace(0, len(some) - 1, MOST_COMPARED).astype(int))
            some = [some[i] for i in rows]
        yield _compared_picture(quantity, some)


def _compared_picture(quantity: str, some: Sequence[Studied]) -> Picture:
    def draw(canvas: Figure) -> None:
        ax = canvas.subplots()
        for i, each in enumerate(some):
            shade = BAD if each.change is not None else DATA
            ax.errorbar([each.level.value], [i], xerr=[SIGMAS * each.level.std], marker="o",
                        markersize=4, elinewidth=0.9, color=shade)  # fmt: skip
        ax.set_yticks(range(len(some)), [each.history.vehicle[:24] for each in some], fontsize=7)
        ax.axvline(float(np.median([each.level.value for each in some])), color=NEUTRAL, zorder=0)
        ax.set_xlabel(f"{words.name_of(quantity)} {QUANTITIES[quantity].unit_for()}".rstrip())

    look = "Present levels with 2 sigma; red: changed; the line is the median."
    size_in = 5.6, 1.0 + 0.17 * max(len(some), 6)
    return Picture(f"beside-{quantity}", words.name_of(quantity), look, draw, size_in)
