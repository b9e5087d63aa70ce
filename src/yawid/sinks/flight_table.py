"""The table of a flight's manoeuvres, and the notes below it.

In a terminal it is at most 80 columns wide; of many manoeuvres it has the first and the last.
"""

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime, timedelta
from typing import Final

from yawid.answers.run_summary import DutchRoll, Flight, Manoeuvre
from yawid.quantities.airspeed import GROUND_SPEED
from yawid.sinks.pages import Grid, Note, Part
from yawid.sinks.words import (
    loop_of,
    outcome,
    sigma_means,
    utc,
    whose,
)

HEADS: Final = (
    "n", "from-to s", "mode", "loop", "V m/s", "alt m", "wn rad/s", "zeta", "result",
)  # fmt: skip
MOST_ROWS: Final = 20
"""The largest number of rows; manoeuvres between the first and the last ten are in --json."""
MOST_BOOTS: Final = 4
SAME_BOOT: Final = timedelta(seconds=10)
"""Two manoeuvres whose boots, from date and seconds, differ by no more have the same boot."""
_FINE: Final = 0.05
"""A sigma of wn in rad/s below which wn has a third decimal."""
_MODE_WIDTH: Final = 10
_LARGEST: Final = 1000.0
"""Numbers as large as this, from estimates that diverged, have three digits."""


def manoeuvre_parts(
    manoeuvres: Sequence[Manoeuvre],
    flights: Sequence[Flight],
    written: Callable[[DutchRoll | None], tuple[str, str]] | None = None,
) -> Iterator[Part]:
    """Yield a table with a row for each manoeuvre, dim if not usable, and the notes below it.

    A manoeuvre's wn and zeta are those that the answer of its loop, one of ``flights``, uses.
    ``written`` returns them in other words than those that fit 80 columns.
    """
    yield manoeuvre_grid(manoeuvres, flights, written)
    yield Note(table_notes(manoeuvres, flights), "dim")


def manoeuvre_grid(
    manoeuvres: Sequence[Manoeuvre],
    flights: Sequence[Flight],
    written: Callable[[DutchRoll | None], tuple[str, str]] | None = None,
) -> Grid:
    """Return that table."""
    half, left_out = MOST_ROWS // 2, len(manoeuvres) - MOST_ROWS
    shown = list(manoeuvres) if left_out <= 0 else [*manoeuvres[:half], *manoeuvres[-half:]]
    rows = [
        [*_cells(each), *(written or in_columns)(each.dutch_roll), outcome(each, flights)]
        for each in shown
    ]
    styles = ["" if each.verdict.usable else "dim" for each in shown]
    if left_out > 0:
        rows.insert(half, ["..", *[""] * (len(HEADS) - 1)])
        styles.insert(half, "dim")
    return Grid(HEADS, rows, styles, texts=(2, 3, 8))


def _cells(each: Manoeuvre) -> Iterator[str]:
    yield str(each.n)
    yield f"{each.from_s:.0f}-{each.to_s:.0f}"
    mode = each.mode or "-"
    yield mode if len(mode) <= _MODE_WIDTH else f"{mode[: _MODE_WIDTH - 1]}…"
    yield loop_of(each.loop).short
    mark = "*" if each.airspeed_source == GROUND_SPEED else ""
    yield "-" if each.airspeed_m_s is None else f"{each.airspeed_m_s:.1f}{mark}"
    yield "-" if each.altitude_m is None else f"{each.altitude_m:.0f}"


def in_columns(mode: DutchRoll | None) -> tuple[str, str]:
    """Return wn in rad/s and zeta with their sigmas, short enough for 80 columns in all."""
    if mode is None:
        return "none", "none"
    fine = mode.wn_rad_s < 10.0 and (mode.wn_std or 1.0) < _FINE
    return _short(mode.wn_rad_s, mode.wn_std, 3 if fine else 2), _short(mode.zeta, mode.zeta_std, 3)


def _short(value: float, sigma: float | None, digits: int) -> str:
    if abs(value) >= _LARGEST:
        return f"{value:.2e}"
    said = f"{value:.{digits}f}"
    if sigma is None:
        return said
    # So large a sigma needs no decimals, and there is no room for them.
    return f"{said}±{sigma:.{digits}f}" if sigma < 10.0 else f"{said}±{min(sigma, _LARGEST):.0f}"


def table_notes(manoeuvres: Sequence[Manoeuvre], flights: Sequence[Flight]) -> str:
    """Return the meaning of the table's signs, how many rows it leaves out, and the boot's date."""
    notes = [f"± is one sigma{sigma_means(each.dutch_roll for each in manoeuvres)}"]
    sources = dict.fromkeys(each.airspeed_source for each in manoeuvres)
    if GROUND_SPEED in sources:
        notes.append("* V is the ground speed")
    elif any(source is not None for source in sources):
        notes.append("V is the airspeed")
    else:
        notes.append("no airspeed is known")
    loops = {loop_of(each.loop): whose(each) for each in manoeuvres}
    notes.append(f"loop: {', '.join(f'{loop.short} is {of}' for loop, of in loops.items())}")
    notes += _since(manoeuvres)
    if len(manoeuvres) > MOST_ROWS:
        notes.append(f"{len(manoeuvres) - MOST_ROWS} more are in --json")
    return "; ".join(notes)


def _since(manoeuvres: Sequence[Manoeuvre]) -> Iterator[str]:
    """Yield the dates from which the manoeuvres' seconds are counted, one for each boot."""
    boots: list[tuple[datetime, list[int]]] = []
    for each in manoeuvres:
        if each.date is None:
            continue
        try:
            boot = datetime.fromisoformat(each.date) - timedelta(seconds=each.from_s)
        except (ValueError, OverflowError):  # the vehicle's clock may have any value
            continue
        if not boots or abs(boot - boots[-1][0]) > SAME_BOOT:
            boots.append((boot, []))
        boots[-1][1].append(each.n)
    for boot, numbers in boots[:MOST_BOOTS]:
        which = "" if len(boots) == 1 else f" of {_span(numbers)}"
        yield f"seconds{which} since boot at {utc(boot.isoformat())}"


def _span(numbers: Sequence[int]) -> str:
    return f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"
