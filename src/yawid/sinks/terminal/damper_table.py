"""The gains of a yaw damper as a table, and what to fly next."""

from collections.abc import Iterable
from textwrap import fill, indent
from typing import TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from yawid.answers.damper_report import DamperAt, DamperReport
from yawid.sinks.door import page_console
from yawid.sinks.words import NEXT


def print_damper(report: DamperReport, stream: TextIO) -> None:
    """Print the report of a damper: the gains, the band, what to look for; or why there is none."""
    console = page_console(stream)
    console.print(Text(report.log, style="bold"))
    if not report.verdict.usable:
        console.print(Text("no gain can be given", style="bold red"))
        _indented(console, map(str, report.verdict.reasons))
        if report.verdict.next:
            _indented(console, [f"{NEXT} {report.verdict.next}"])
        _print_mix(console, report)
        return
    found = report.recommended
    text = "none is recommended" if found is None else (
        f"aim at {found.low:g} to {found.high:g}, fly {found.next:g} next"
    )  # fmt: skip
    name = f"{report.parameter}  " if report.parameter else ""
    console.print(Text(f"{name}{text}", style="bold"))
    _indented(console, [*report.says, *map(str, report.verdict.reasons)])
    if not report.gains:
        _print_mix(console, report)
        return
    table = Table(box=None, pad_edge=False)
    heads = (report.parameter, "V m/s", "wn rad/s", "zeta", "GM dB", "PM deg", "")
    for heading in heads:
        table.add_column(heading or "", justify="right")
    for gain in report.gains:
        marks = [name for name, value in _named(report) if value == gain.value]
        for at in gain.at:
            table.add_row(
                f"{gain.value:g}", f"{at.airspeed_m_s:.1f}", *_cells(at), ", ".join(marks)
            )
    console.print(table)
    _print_mix(console, report)
    means = (
        "± is one sigma; GM, PM: margins of the open loop at the 95 % bound, - where nothing "
        "crosses or the model is not known"
    )
    console.print(Text(means))


def _indented(console: Console, texts: Iterable[str]) -> None:
    """Print texts of one or more lines, each line two columns from the left."""
    for text in texts:
        lines = fill(text, console.width - 2, break_on_hyphens=False, break_long_words=False)
        console.print(Text(indent(lines, "  ")), soft_wrap=True)


def _print_mix(console: Console, report: DamperReport) -> None:
    if report.mix is not None:
        console.print(Text("mix  ", style="bold") + Text(report.mix.text))


def _named(report: DamperReport) -> list[tuple[str, float | None]]:
    found = report.recommended
    named: list[tuple[str, float | None]] = [("flown", report.flown)]
    if found is not None:
        named += [("low", found.low), ("high", found.high), ("next", found.next)]
    return named


def _cells(at: DamperAt) -> list[str]:
    margins = (at.gain_margin_db, at.phase_margin_deg)
    return [
        _with_sigma(at.wn_rad_s, at.wn_std, ".2f"),
        _with_sigma(at.zeta, at.zeta_std, ".3f"),
        *("-" if each is None else f"{each:.0f}" for each in margins),
    ]


def _with_sigma(value: float | None, std: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}} ± {std or 0.0:{form}}"
