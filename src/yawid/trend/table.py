"""Prints the results of ``yawid trend`` and ``yawid diff`` for people."""

from collections.abc import Iterable
from textwrap import fill
from typing import Final, TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from yawid.answers.damper_report import Decay, FlownGain
from yawid.quantities.table import QUANTITIES
from yawid.quantities.vehicles import AIRFRAME, WITH_ROLL_LOOP
from yawid.sinks.door import page_console
from yawid.sinks.words import LATIN
from yawid.trend import words
from yawid.trend.diff import CANNOT_TELL, DamperDiff, Diff
from yawid.trend.history import BARE_AIRFRAME, ORDINARY_FLIGHT, shown
from yawid.trend.trend import Followed, Trend

MOST_ROWS: Final = 60
"""Most histories without a change that are printed; ``--json`` has all."""
MOST_OUTLIERS: Final = 20
"""Most outliers that are printed; ``--json`` has all."""


def print_trend(report: Trend, stream: TextIO) -> None:
    """Print a data set's trends: first what changed, then the histories and outliers."""
    console = page_console(stream)
    console.print(Text(report.dataset, "bold"), soft_wrap=True)
    changed = [each for each in report.followed if each.change is not None]
    if changed:
        word = Text(f"{len(changed)} CHANGED", "bold red")
    elif report.judged:
        word = Text("steady", "bold green")
    else:
        word = Text(words.not_tested(report), "bold yellow")
    console.print(Text("verdict  ") + word)
    for each in changed:
        assert each.change is not None
        _say(console, f"{each.vehicle} ({each.loop}) {_name(each.quantity)} "
             f"{words.change_line(each.change)}", "red")  # fmt: skip
        for line in each.change.measured_otherwise:
            _say(console, f"the measurement changed there too: {line}", "yellow")
    for each in report.followed:
        if each.may_be_season is not None:
            _say(console, f"{each.vehicle} ({each.loop}) {_name(each.quantity)} "
                 f"{words.season_line(each.may_be_season)}", "yellow")  # fmt: skip
    for warning in report.warnings:
        _say(console, f"warning {warning.id}: {warning.text}", "yellow")
    _say(console, words.flights_line(report))
    steady = {id(each) for each in [e for e in report.followed if e.change is None][:MOST_ROWS]}
    rows = [each for each in report.followed if each.change is not None or id(each) in steady]
    if rows:
        console.print(_histories(rows))
    outliers = [(each, one) for each in report.followed for one in each.outliers]
    for each, one in outliers[:MOST_OUTLIERS]:
        _say(console, f"outlier: {each.vehicle} {_name(each.quantity)} {words.outlier_line(one)}")
    notes = [
        "± is one sigma; now: after the last change; a year: slope of a straight line; "
        "between: scatter of flights beyond their own sigmas" + _units(e.quantity for e in rows),
        *([words.rate_line(report)] if report.judged else []),
    ]
    left = len(report.followed) - len(rows), len(outliers) - MOST_OUTLIERS
    for count, what in zip(left, ("histories", "outliers"), strict=True):
        if count > 0:
            notes.append(f"{count} more {what} are in --json")
    console.print(Text(fill("; ".join(notes), console.width, break_on_hyphens=False), "dim"))


def _histories(rows: list[Followed]) -> Table:
    table = _table("n", "now", "a year", "between")
    last = ("", "")
    for each in rows:
        whose = (each.vehicle, each.loop)
        table.add_row(
            "" if whose == last else _named(*whose),
            _name(each.quantity),
            str(each.flights),
            words.spread(each.now),
            words.spread(each.slope_per_year),
            "-" if each.between_std is None else f"{each.between_std:.2g}",
            words.result(each),
            style="" if each.change is None else "red",
        )
        last = whose
    return table


def _name(quantity: str) -> str:
    """Return a quantity's name for the terminal."""
    return words.name_of(quantity, LATIN)


def _units(quantities: Iterable[str]) -> str:
    """Return the units of the numbers in a table, as a note under it."""
    units = {_name(each): QUANTITIES[each].unit_for() for each in quantities}
    return "".join(f"; {name} in {unit}" for name, unit in units.items() if unit)


def _named(vehicle: str, loop: str) -> str:
    """Return a vehicle's name with its loop; an empty loop, as of two runs, has none."""
    loops = {AIRFRAME: "", "": "", WITH_ROLL_LOOP: " roll", BARE_AIRFRAME: " bare",
             ORDINARY_FLIGHT: " ordinary"}  # fmt: skip
    return vehicle + loops.get(loop, " ?")


def print_diff(report: Diff, stream: TextIO) -> None:
    """Print what changed between two sides: numbers, verdict, channels, configuration."""
    console = page_console(stream)
    console.print(Text(f"A {report.a}\nB {report.b}", "bold"), soft_wrap=True)
    if report.changed:
        word = Text("CHANGED", "bold red")
    elif report.judged:
        word = Text("no change", "bold green")
    elif any((each.not_judged or "").startswith(CANNOT_TELL) for each in report.numbers):
        word = Text(CANNOT_TELL, "bold yellow")
    else:
        word = Text("nothing could be compared", "bold yellow")
    console.print(Text("verdict  ") + word)
    table = _table("A", "B", "B - A", "sigmas")
    for each in report.numbers:
        result = each.not_judged or "agrees"
        if each.not_judged and not each.not_judged.startswith(CANNOT_TELL):
            result = f"not judged: {result}"
        result = "CHANGED" if each.changed else result
        table.add_row(
            _named(each.vehicle, each.loop).strip(), _name(each.quantity),
            words.spread(each.a), words.spread(each.b),
            f"{each.difference:+.3g}", "-" if each.sigmas is None else f"{each.sigmas:+.1f}",
            result, style="red" if each.changed else "",
        )  # fmt: skip
    if report.numbers:
        console.print(table)
    if report.damper is not None:
        _print_damper(console, report.damper)
    for fact in report.facts:
        style = "red" if fact.changed else "yellow"
        _say(console, f"{fact.what}: {fact.a} in A, {fact.b} in B", style)
    for line in report.notes:
        _say(console, line)
    notes = "± is one total sigma"
    if report.judged:
        rate = 100.0 * report.false_alarm_rate
        notes += (
            f"; changed: beyond what both sigmas explain, at {rate:g} % false alarms over all "
            f"{report.judged} numbers judged"
        )
    notes += _units(each.quantity for each in report.numbers)
    console.print(Text(fill(notes, console.width, break_on_hyphens=False), "dim"))


def _print_damper(console: Console, report: DamperDiff) -> None:
    if report.unchanged is None:
        said, style = "not judged whether it changed", "yellow"
    elif report.unchanged:
        said, style = "unchanged", "green"
    else:
        said, style = f"CHANGED in {', '.join(map(_name, report.differ))}", "red"
    console.print(Text("the aircraft without its yaw damper  ") + Text(said, style))
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    heads = ("", report.parameter, "pair predicted", "decay predicted", "decay flown", "")
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for each in report.flown:
        result = {True: "agrees", False: "DIFFERS", None: "-"}[each.agrees]
        modes = (_damped(found) for found in (each, each.decay_predicted, each.decay))
        table.add_row(each.flight, f"{each.gain:g}", *modes, result)
    if report.flown:
        console.print(table)
        text = (
            "wn in rad/s / zeta. Pair: the Dutch roll with that gain, predicted from the other "
            "flight. Decay: a damped sine fitted to the free decays, which near a servo's lag is "
            "not the pair: compare the two fits"
        )
        console.print(Text(fill(text, console.width, break_on_hyphens=False), "dim"))
    for line in report.notes:
        _say(console, line)


def _damped(found: Decay | FlownGain | None) -> str:
    if found is None or found.wn_rad_s is None or found.zeta is None:
        return "-"
    std = "" if found.zeta_std is None else f" ± {found.zeta_std:.2f}"
    return f"{found.wn_rad_s:.3g} / {found.zeta:.2f}{std}"


def _table(*numbers: str) -> Table:
    """Return an empty table with columns for vehicle, quantity, ``numbers`` and result."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("vehicle", overflow="ellipsis", max_width=18, no_wrap=True)
    table.add_column("", no_wrap=True)
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("result", overflow="fold")
    return table


def _say(console: Console, text: str, style: str = "") -> None:
    indented = fill(shown(text), console.width, subsequent_indent="  ", break_on_hyphens=False)
    console.print(Text(indented, style))
