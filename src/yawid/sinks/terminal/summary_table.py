"""The summary of a run as text and tables on stdout."""

from collections.abc import Iterator, Mapping, Sequence
from textwrap import fill
from typing import TextIO

from msgspec.structs import replace
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from yawid.answers.heard import VehicleSeen
from yawid.answers.reasons import Verdict
from yawid.answers.reports import OrdersReport
from yawid.answers.run_summary import MethodSummary, Origin, RunSummary
from yawid.sinks.door import page_console
from yawid.sinks.terminal.flight_table import manoeuvres_table, table_notes
from yawid.sinks.words import (
    NEXT,
    Row,
    answer_rows,
    next_step,
    numbers,
    percent,
)

NAME_WIDTH = 9
"""The width of the column of names."""
MOST_BOOTS = 4
"""The largest number of boots that are printed; --json has all."""


def print_summary(summary: RunSummary, stream: TextIO, *, verbose: bool = False) -> None:
    """Print the summary of one run: verdict, answer with its sigmas, and the channels and files.

    Where there were manoeuvres the numbers of the stream follow only if ``verbose``.
    """
    console = page_console(stream)
    console.print(Text(summary.log, style="bold"))
    print_verdict(console, summary.deciding)
    for row in answer_rows(summary):
        console.print(Text(hanging(row.name, row.text, console.width), row.style))
    if summary.manoeuvres:
        console.print(manoeuvres_table(summary.manoeuvres, summary.by_loop))
        notes = fill(
            table_notes(summary.manoeuvres, summary.by_loop), console.width, break_on_hyphens=False
        )
        console.print(Text(notes, "dim"))
    if summary.estimates:
        if summary.flight is not None:
            more = ":" if verbose else ": --verbose"
            console.print(Text(f"running estimates at the end of the log{more}", "bold"))
        if summary.flight is None or verbose:
            console.print(_estimates_table(summary.estimates))
    for line in origin(summary):
        console.print(Text(line))
    for kind, path in (summary.files or {}).items():
        # A path is for copying and must not be wrapped.
        console.print(Text(f"{kind:>8}  {path}"), soft_wrap=True)


def print_verdict(console: Console, verdict: Verdict) -> None:
    """Print whether the answer is usable, every reason, and what to do next."""
    word = Text("usable", "bold green") if verdict.usable else Text("NOT USABLE", "bold red")
    if not verdict.usable and not verdict.fatal:
        word = Text(verdict.word, "bold yellow")
    console.print(Text("verdict  ") + word)
    for reason in verdict.reasons:
        style = "red" if reason.weight == "fatal" else "yellow"
        line = Text(f"{reason.id}: ", style) + Text(reason.text, "default")
        console.print(Padding(line, (0, 0, 0, 2), expand=False))
    if (step := next_step(verdict)) is not None:
        line = Text(f"{NEXT} ", "bold") + Text(step, "default")
        console.print(Padding(line, (0, 0, 0, 2), expand=False))


def hanging(name: str, text: str, width: int) -> str:
    """Return one row: its name, and its text next to it, all of whose lines are indented."""
    begin, indent = f"{name:>{NAME_WIDTH - 1}}  ", " " * (NAME_WIDTH + 1)
    return fill(text, width, initial_indent=begin, subsequent_indent=indent, break_on_hyphens=False)


def _estimates_table(estimates: Mapping[str, MethodSummary]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("± is one sigma of noise")
    for method in estimates:
        table.add_column(method.upper(), justify="right")
    columns = (_estimate_rows(each) for each in estimates.values())
    for rows in zip(*columns, strict=True):
        table.add_row(rows[0].name, *(row.text for row in rows), style=rows[0].style)
    return table


def _estimate_rows(estimate: MethodSummary) -> list[Row]:
    mode, fit = estimate.dutch_roll, estimate.fit
    wn, zeta = numbers(mode)
    return [
        Row("Dutch roll wn, rad/s", wn),
        Row("Dutch roll zeta", zeta),
        Row("fit one step, %", _percent(fit.one_step_pct)),
        Row("fit simulated, %", _percent(fit.simulation_pct)),
        Row("samples used / not used", f"{estimate.updates} / {estimate.held}"),
        Row("na,nb,nc,nk at rate", f"{estimate.orders} at {1.0 / estimate.sample_time_s:.3g} Hz"),
    ]


def _number(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)


def _percent(value: float | None) -> str:
    return "-" if value is None else percent(value)


_PLURAL = ("frames", "skipped_bytes", "reboots", "clock_steps", "gaps")
"""Counts of a link whose name is a plural."""


def origin(summary: Origin) -> Iterator[str]:
    """Yield a line for each channel with its source, then one each for link, vehicles, boots."""
    for name, channel in summary.channels.items():
        rate = "" if channel.rate_hz is None else f" at {channel.rate_hz:.3g} Hz"
        how = "" if channel.how is None else f" ({channel.how})"
        yield f"{name:>8}  {channel.source}{rate}{how}"
    link, leap_s = replace(summary.link, clock_leap_s=None), summary.link.clock_leap_s
    counts = ", ".join(
        f"{count} {(name[:-1] if count == 1 and name in _PLURAL else name).replace('_', ' ')}"
        for name, count in link.to_json().items()
        if count or name == "frames"
    )
    leapt = f"; the vehicle's clock jumped by {leap_s:.0f} s" if leap_s else ""
    if counts or leapt:  # a torn run has neither
        yield f"    link  {counts}{leapt}"
    if summary.vehicles is not None:
        yield f"vehicles  {_vehicles(summary.vehicles, summary.vehicle)}"
    if summary.boots is not None:
        each = [f"{b.boot}: {b.from_s:.0f} to {b.to_s:.0f} s" for b in summary.boots]
        yield f"   boots  {', '.join(each[:MOST_BOOTS])}{', ...' * (len(each) > MOST_BOOTS)}"


def _vehicles(vehicles: Sequence[VehicleSeen], answered: VehicleSeen | None) -> str:
    """Return the names of all vehicles in the log; the one that the answer is about is marked."""
    named = [
        f"{each.sysid}/{each.compid} {each.type_name}"
        + (" (answered)" if answered and each.address == answered.address else "")
        for each in vehicles
    ]
    return f"{', '.join(named)}: choose another by --sysid"


def print_orders(report: OrdersReport, stream: TextIO, most: int = 12) -> None:
    """Print the ``most`` best structures of a log as a table; an arrow marks the recommended one.

    That is printed where it is not among the best by simulation, too.
    """
    console = page_console(stream)
    console.print(Text(report.log, style="bold"))
    table = Table(box=None, pad_edge=False)
    for heading in ("", "na,nb,nc,nk", "simulated %", "BIC", "AIC", "white p", "wn", "zeta"):
        table.add_column(heading, justify="right")
    for place, tried in enumerate(report.candidates):
        roll, is_chosen = tried.dutch_roll, str(tried) == str(report.recommended)
        if place >= most and not is_chosen:
            continue
        table.add_row(
            "->" if is_chosen else "",
            str(tried),
            _percent(tried.simulation_pct),
            _number(tried.bic, ".0f"),
            _number(tried.aic, ".0f"),
            _number(tried.whiteness_p, ".2g"),
            _number(None if roll is None else roll.wn_rad_s, ".3f"),
            _number(None if roll is None else roll.zeta, ".3f"),
            style="bold" if is_chosen else None,
        )
    console.print(table)
    of = f"{report.manoeuvres} manoeuvres'" if report.manoeuvres else "the log's"
    rule = (
        f"Rule: of the structures within 0.5 points of the best simulation, the one with the least "
        f"BIC; estimated from two thirds of {of} samples, simulated over the rest."
    )
    console.print(Text(rule))
    if report.recommended is not None:
        console.print(Text(f"recommended  --orders {report.recommended}", style="bold"))
        return
    console.print(
        Text("no orders are recommended: no replay of this log can be used", style="bold red")
    )
    for reason in report.verdict.fatal:
        console.print(Text(f"  {reason}"))
    if (step := next_step(report.verdict)) is not None:
        console.print(Text(f"  {NEXT} {step}"))
    console.print(Text("yawid inspect says what to record next time"))
