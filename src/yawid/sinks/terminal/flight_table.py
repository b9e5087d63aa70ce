"""The terminal's part on a flight: its answer, its manoeuvres, and what they were flown in.

It keeps within 80 columns: of many manoeuvres the first and the last stand there.
"""

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from typing import Final, NamedTuple

from rich.table import Table

from yawid.results.run_summary import DutchRoll, Flight, Manoeuvre, RunSummary, VehicleSeen
from yawid.sinks.answers import (
    conditions,
    counted,
    kappa,
    no_manoeuvre,
    noise_spreads,
    outcome,
    sigma_means,
    utc,
    whose,
    with_sigma,
)
from yawid.sources.mavlink.enums import AUTOPILOT_NAMES, TYPE_NAMES

MOST_ROWS: Final = 20
"""The manoeuvres between the first and the last ten are left to --json."""
MOST_BOOTS: Final = 4
SAME_BOOT: Final = timedelta(seconds=10)
"""Within which the boots of two manoeuvres, by date and seconds, are one and the same."""
LOOP_WORDS: Final = {"airframe": "bare", "with_roll_loop": "roll"}
_MEANS: Final = {
    "bare": "bare is the airframe",
    "roll": "roll is the aircraft with its roll loop",
    "?": "? where no flight mode is known",
}
_GROUND: Final = "ground speed"
_FINE: Final = 0.05
"""A sigma of wn in rad/s below which there is room for another digit."""
_AS_GIVEN: Final = ("calibrated", "indicated")
"""Kinds of airspeed that are taken for the equivalent one."""
_MODE_WIDTH: Final = 10
_LARGEST: Final = 1000.0
"""Larger numbers, of estimates that diverged, keep three digits."""


class Row(NamedTuple):
    """One row of the terminal: its name, its text, and rich's style of it."""

    name: str
    text: str
    style: str = ""


def flight_rows(summary: RunSummary) -> Iterator[Row]:
    """Yield each row that tells the flight's answer."""
    flight = summary.flight
    if flight is None:
        if summary.manoeuvres is not None:
            yield Row("flight", no_manoeuvre(summary))
        return
    manoeuvres = summary.manoeuvres or []
    mode, count = flight.dutch_roll, counted(flight, manoeuvres)
    if mode is None:
        yield Row("flight", f"no answer, {count}")
    else:
        wn = " ".join(filter(None, with_sigma(mode.wn_rad_s, mode.wn_std)))
        zeta = " ".join(filter(None, with_sigma(mode.zeta, mode.zeta_std)))
        yield Row("flight", f"wn {wn} rad/s, zeta {zeta}")
        if noise := noise_spreads(mode):
            yield Row("", f"of it noise: wn {noise[0]}, zeta {noise[1]}", "dim")
        yield Row("", ", ".join(filter(None, (conditions(flight), count))))
        yield Row("", f"this is {whose(flight.loop)}")
    if slope := kappa(flight):
        kind = flight.airspeed_kind if flight.airspeed_kind in _AS_GIVEN else "equivalent"
        yield Row("", f"wn = {slope}, V the {kind} airspeed")
    yield Row("flown", ", ".join(_flown(flight, manoeuvres, summary.vehicle)))


def _flown(
    flight: Flight, manoeuvres: Sequence[Manoeuvre], vehicle: VehicleSeen | None
) -> Iterator[str]:
    dates = [date for date in (flight.date, *(each.date for each in manoeuvres)) if date]
    if dates:
        yield utc(dates[0])
    told = [each for each in manoeuvres if each.n in flight.used] or manoeuvres
    modes = dict.fromkeys(each.mode for each in told if each.mode is not None)
    if modes:
        yield f"in {' and '.join(modes)}"
    if vehicle is not None:
        kind = TYPE_NAMES.get(vehicle.type, f"type {vehicle.type}")
        autopilot = AUTOPILOT_NAMES.get(vehicle.autopilot, f"autopilot {vehicle.autopilot}")
        yield f"vehicle {vehicle.sysid}/{vehicle.compid}, {kind} on {autopilot}"
    if flight.method is not None and flight.orders is not None:
        yield f"answered by {flight.method.upper()}, orders {flight.orders}"


def manoeuvres_table(manoeuvres: Sequence[Manoeuvre], flight: Flight | None) -> Table:
    """Return a row for each manoeuvre, those that are not usable dim."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for name in ("n", "from-to s"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("mode", "loop"):
        table.add_column(name, no_wrap=True)
    for name in ("V m/s", "alt m", "wn rad/s", "zeta"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("came of it", overflow="fold")
    half = MOST_ROWS // 2
    left_out = len(manoeuvres) - MOST_ROWS
    shown = list(manoeuvres) if left_out <= 0 else [*manoeuvres[:half], *manoeuvres[-half:]]
    for i, each in enumerate(shown):
        if left_out > 0 and i == half:
            table.add_row("..", style="dim")
        style = "" if each.verdict.usable else "dim"
        table.add_row(*_cells(each), outcome(each, flight), style=style)
    return table


def _cells(each: Manoeuvre) -> Iterator[str]:
    yield str(each.n)
    yield f"{each.from_s:.0f}-{each.to_s:.0f}"
    mode = each.mode or "-"
    yield mode if len(mode) <= _MODE_WIDTH else f"{mode[: _MODE_WIDTH - 1]}…"
    yield _loop(each)
    mark = "*" if each.airspeed_source == _GROUND else ""
    yield "-" if each.airspeed_m_s is None else f"{each.airspeed_m_s:.1f}{mark}"
    yield "-" if each.altitude_m is None else f"{each.altitude_m:.0f}"
    yield from _numbers(each.dutch_roll)


def _numbers(mode: DutchRoll | None) -> tuple[str, str]:
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
    # Sigma of what is that unsure needs no decimals, and there is no room for them.
    return f"{said}±{sigma:.{digits}f}" if sigma < 10.0 else f"{said}±{min(sigma, _LARGEST):.0f}"


def _loop(each: Manoeuvre) -> str:
    return LOOP_WORDS.get(each.loop, "?")


def table_notes(manoeuvres: Sequence[Manoeuvre]) -> str:
    """Return what the table's signs mean, how many rows it leaves out, and when the boot was."""
    notes = [f"± is one sigma{sigma_means(each.dutch_roll for each in manoeuvres)}"]
    sources = dict.fromkeys(each.airspeed_source for each in manoeuvres)
    if _GROUND in sources:
        notes.append("* V is the ground speed")
    elif any(source is not None for source in sources):
        notes.append("V is the airspeed")
    else:
        notes.append("no airspeed is known")
    loops = dict.fromkeys(_loop(each) for each in manoeuvres)
    notes.append(f"loop: {', '.join(_MEANS[loop] for loop in loops)}")
    notes += _since(manoeuvres)
    if len(manoeuvres) > MOST_ROWS:
        notes.append(f"{len(manoeuvres) - MOST_ROWS} more stand in --json")
    return "; ".join(notes)


def _since(manoeuvres: Sequence[Manoeuvre]) -> Iterator[str]:
    """Say when the seconds of the manoeuvres began: with it the date of each is known."""
    boots: list[tuple[datetime, list[int]]] = []
    for each in manoeuvres:
        if each.date is None:
            continue
        try:
            boot = datetime.fromisoformat(each.date) - timedelta(seconds=each.from_s)
        except (ValueError, OverflowError):  # the vehicle's clock may say anything
            continue
        if not boots or abs(boot - boots[-1][0]) > SAME_BOOT:
            boots.append((boot, []))
        boots[-1][1].append(each.n)
    for boot, numbers in boots[:MOST_BOOTS]:
        which = "" if len(boots) == 1 else f" of {_span(numbers)}"
        yield f"seconds{which} since boot at {utc(boot.isoformat())}"


def _span(numbers: Sequence[int]) -> str:
    return f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"
