"""``yawid report``: one HTML file for a flight-test engineer to read, print and pass on."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from yawid.answers.run_summary import RunSummary
from yawid.quantities.units import HALF_TRAVEL
from yawid.report.airspeed_picture import airspeed_picture
from yawid.report.bare import bare_section, ordinary_section, spectra_picture
from yawid.report.data import Drawn, ReportData, gather
from yawid.report.html import first_screen, note, page, pictures, tables
from yawid.report.lateral_picture import lateral_picture
from yawid.report.manoeuvres import flight_numbers, flight_section
from yawid.report.model_pictures import (
    bode_picture,
    likelihood_picture,
    poles_picture,
    residuals_picture,
    step_picture,
)
from yawid.report.picture import Picture
from yawid.report.run_tables import (
    channel_tables,
    folded,
    is_of,
    provenance,
    stream_numbers,
)
from yawid.report.time_pictures import (
    manoeuvre_picture,
    modes_picture,
    whole_picture,
)
from yawid.sinks.answers import cards, headline
from yawid.sinks.mcap.reader import McapRun, open_answered
from yawid.sinks.words import method_words, next_step, sigma_means, utc
from yawid.system.part_file import check_free, write_whole


def write_report(mcap: Path, out: Path | None = None, *, force: bool = False) -> Path:
    """Write the report of a finished run to ``out``, else next to the MCAP; return its path.

    Equal runs give equal bytes. A report of the same log with the same options is replaced.

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not the file of a run.
        SinkError: another file exists and ``force`` is not set, or it cannot be written.
    """
    run = open_answered(mcap)
    path = mcap.with_suffix(".html") if out is None else out
    force = force or (path.is_file() and is_of(path, run))
    check_free(path, force=force)
    write_whole({path: report(run).encode("utf-8", "replace")}, force=force)
    return path.absolute()


def report(run: McapRun) -> str:
    """Return the report of a run, as a page of HTML.

    Raises:
        SourceError: the file is damaged.
    """
    name = Path(run.summary.log).name
    return page(f"{name} - yawid report", _sections(run, gather(run), name))


def _sections(run: McapRun, data: ReportData | None, name: str) -> Iterator[str]:
    summary, flight, stretch = run.summary, run.summary.flight, (run.config.from_s, run.config.to_s)
    yield first_screen(
        name, _origin(run), headline(summary, stretch), cards(summary), _advised(summary),
        _sigma(summary), next_step(summary.deciding),
    )  # fmt: skip
    unit = HALF_TRAVEL if run.grid is None else run.grid.rudder_unit
    yield from (*flight_section(summary, unit), *bare_section(summary), *ordinary_section(summary))
    yield pictures("", [lateral_picture(run), spectra_picture(summary.ordinary)])
    drawn = () if data is None else data.drawn
    against = [] if summary.deciding.usable else summary.deciding.fatal
    if data is not None:
        fits = [manoeuvre_picture(each, unit) for each in sorted(drawn, key=lambda d: d.found.n)]
        over_airspeed = airspeed_picture(summary.manoeuvres or [], summary.by_loop)
        yield pictures("Measurement and model", [whole_picture(data), over_airspeed, *fits])
    for first in drawn[:1]:  # the best one
        title = f"What the model of manoeuvre {first.found.n} says about the aircraft"
        yield pictures(title, _of_model(first, summary, unit), against)
    if flight is not None:
        yield tables("Numbers of the answer", flight_numbers(summary, drawn, unit), against)
    elif data is not None and summary.answer is not None and summary.answer.updates:
        yield pictures("What was estimated, and when", [modes_picture(data)])
        yield from _stream("Numbers", summary, data)
    yield tables("Channels and link", channel_tables(summary, data), facts=True)
    yield tables("Configuration and provenance", provenance(run), facts=True)
    yield folded(run)
    if flight is not None:
        yield _STREAM
        yield from _stream("Numbers of the stream, at its end", summary, data)


def _stream(title: str, summary: RunSummary, data: ReportData | None) -> Iterator[str]:
    """Yield the section on the numbers of the stream, under this title."""
    if summary.answer is not None and data is not None:
        yield tables(title, stream_numbers(summary, summary.answer, data.grid))


def _of_model(first: Drawn, summary: RunSummary, unit: str) -> list[Picture | None]:
    bare = None if summary.bare is None else summary.bare.dutch_roll
    return [
        likelihood_picture(first),
        bode_picture(first, unit),
        poles_picture(first, bare),
        step_picture(first, unit),
        residuals_picture(first),
    ]


def _sigma(summary: RunSummary) -> str:
    """Return the meaning of ± on this page, "" where it has no answer."""
    mode = summary.dutch_roll if summary.flight is None else summary.flight.dutch_roll
    means = sigma_means([mode])
    return f"± is one sigma{means}. Bands in the pictures are 2 sigma." if means else ""


def _advised(summary: RunSummary) -> Iterator[tuple[str, str, str, str]]:
    """Yield each reason with what to do about it; what to do next is stated once, below them."""
    for each in summary.deciding.reasons:
        to_do = "" if each.to_do == summary.deciding.next else each.to_do
        yield each.weight, each.called, each.text, to_do


def _origin(run: McapRun) -> str:
    vehicle, answer, flight = run.summary.vehicle, run.summary.answer, run.summary.flight
    parts = [f"{run.summary.duration_s:.0f} s of log"]
    if vehicle is not None:
        parts.append(f"vehicle {vehicle.sysid}/{vehicle.compid}")
    if flight is not None and flight.date is not None:
        parts.append(utc(flight.date))
    if answer is not None:
        rate = f"{1.0 / answer.sample_time_s:.3g} Hz"
        best = answer if flight is None else flight
        # A flight without a usable manoeuvre has no method.
        by = "" if best.method is None else f"{method_words(best.method)} "
        parts.append(f"{by}at {rate}")
    return " · ".join(parts)


_STREAM: Final = note(
    "The stream, sample by sample",
    "From here on everything is about the estimates sample by sample and at the end of the log, "
    "not about the flight's answer above. They are not judged, and their σ is of noise alone.",
)
"""The note before the sections on the stream, the page's last."""
