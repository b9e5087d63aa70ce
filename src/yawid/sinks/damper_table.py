"""The gains of a yaw damper as a table, and what to fly next."""

from collections.abc import Iterator
from typing import Final, TextIO

from yawid.answers.damper_report import DamperAt, DamperReport
from yawid.sinks.pages import Grid, Note, Part, Said, to_terminal
from yawid.sinks.words import NEXT

MEANS: Final = (
    "± is one sigma; GM, PM: margins of the open loop at the 95 % bound, - where nothing crosses "
    "or the model is not known"
)


def print_damper(report: DamperReport, stream: TextIO) -> None:
    """Print the report of a damper: the gains, the band, what to look for; or why there is none."""
    to_terminal(damper_parts(report), stream)


def damper_parts(report: DamperReport) -> Iterator[Part]:
    """Yield the parts of that page."""
    yield Note(report.log, "bold")
    mix = [] if report.mix is None else [Note(f"mix  {report.mix.text}")]
    reasons = [Said("", str(reason)) for reason in report.verdict.reasons]
    if not report.verdict.usable:
        yield Note("no gain can be given", "bold red")
        yield from reasons
        if report.verdict.next:
            yield Said("", f"{NEXT} {report.verdict.next}")
        yield from mix
        return
    found = report.recommended
    text = "none is recommended" if found is None else (
        f"aim at {found.low:g} to {found.high:g}, fly {found.next:g} next"
    )  # fmt: skip
    name = f"{report.parameter}  " if report.parameter else ""
    yield Note(f"{name}{text}", "bold")
    yield from (Said("", said) for said in report.says)
    yield from reasons
    if report.gains:
        yield gains_grid(report)
    yield from mix
    if report.gains:
        yield Note(MEANS)


def gains_grid(report: DamperReport) -> Grid:
    """Return the table of every gain at every airspeed."""
    heads = (report.parameter or "", "V m/s", "wn rad/s", "zeta", "GM dB", "PM deg", "")
    return Grid(heads, list(_gains(report)), texts=(6,))


def _gains(report: DamperReport) -> Iterator[list[str]]:
    for gain in report.gains or ():
        marks = ", ".join(name for name, value in _named(report) if value == gain.value)
        for at in gain.at:
            yield [f"{gain.value:g}", f"{at.airspeed_m_s:.1f}", *_cells(at), marks]


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
