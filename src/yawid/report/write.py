"""``yawid report``: one HTML file for a flight-test engineer to read, print and pass on."""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

from yawid.answers.reasons import Reason
from yawid.answers.run_summary import RunSummary
from yawid.quantities.units import HALF_TRAVEL
from yawid.report.airspeed_picture import airspeed_picture
from yawid.report.bare import bare_section, ordinary_section, spectra_picture
from yawid.report.data import Drawn, gather
from yawid.report.html import first_screen, note, numbers, page, pictures, tables
from yawid.report.lateral_picture import lateral_picture
from yawid.report.likelihood_picture import likelihood_picture
from yawid.report.manoeuvres import flight_numbers, flight_section
from yawid.report.model_pictures import bode_picture, poles_picture, residuals_picture, step_picture
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
    write_whole({path: Report(run).html().encode("utf-8", "replace")}, force=force)
    return path.absolute()


class Report:
    """The report of a run.

    Raises:
        SourceError: the file is damaged.
    """

    def __init__(self, run: McapRun) -> None:
        self._run, self._summary = run, run.summary
        self._data = gather(run)

    def html(self) -> str:
        """Return the page."""
        name = Path(self._summary.log).name
        return page(f"{name} - yawid report", self._sections(name))

    def _sections(self, name: str) -> Iterator[str]:
        summary, run = self._summary, self._run
        stretch = (run.config.from_s, run.config.to_s)
        sentence = headline(summary, stretch)
        yield first_screen(
            name, _origin(run), sentence, cards(summary), _advised(summary), _sigma(summary),
            next_step(summary.deciding),
        )  # fmt: skip
        unit = HALF_TRAVEL if run.grid is None else run.grid.rudder_unit
        yield from flight_section(summary, unit)
        yield from bare_section(summary)
        yield from ordinary_section(summary)
        yield pictures("", self._of_airframe)
        yield pictures("Measurement and model", self._of_flight())
        against = [] if summary.deciding.usable else summary.deciding.fatal
        of = f" of manoeuvre {self._first.found.n}" if self._first is not None else ""
        yield pictures(f"What the model{of} says about the aircraft", self._of_model(), against)
        if summary.flight is not None:
            shown = flight_numbers(summary, self._drawn, unit)
            yield numbers("Numbers of the answer", shown, against)
        else:
            yield pictures("What was estimated, and when", self._of_stream())
            yield from self._stream("Numbers")
        yield tables("Channels and link", channel_tables(summary, self._data), facts=True)
        yield tables("Configuration and provenance", provenance(run), facts=True)
        yield folded(run)
        if summary.flight is not None:
            yield _stream_note(summary)
            yield from self._stream("Numbers of the stream, at its end")

    def _stream(self, title: str) -> Iterator[str]:
        """Yield the section on the numbers of the stream, under this title."""
        summary, grid = self._summary, self._run.grid
        if grid is not None and summary.answer is not None and self._data is not None:
            yield numbers(title, stream_numbers(summary, summary.answer, grid), [])

    @property
    def _drawn(self) -> tuple[Drawn, ...]:
        return () if self._data is None else self._data.drawn

    @property
    def _first(self) -> Drawn | None:
        """The best manoeuvre, whose model is shown as the answer's; None where there is none."""
        return self._drawn[0] if self._drawn else None

    def _of_flight(self) -> list[Picture]:
        data, grid, summary = self._data, self._run.grid, self._summary
        if data is None or grid is None:
            return []
        over_airspeed = airspeed_picture(summary.manoeuvres or [], summary.by_loop)
        in_order = sorted(data.drawn, key=lambda each: each.found.n)
        fits = [manoeuvre_picture(each, grid) for each in in_order]
        shown = [whole_picture(data, grid)]
        return [*shown, *([over_airspeed] if over_airspeed is not None else []), *fits]

    @cached_property
    def _of_airframe(self) -> list[Picture]:
        shown = lateral_picture(self._run)
        spectra = spectra_picture(self._summary.ordinary)
        return [each for each in (shown, spectra) if each is not None]

    def _of_model(self) -> list[Picture]:
        first, grid, bare = self._first, self._run.grid, self._summary.bare
        if first is None or grid is None:
            return []
        known = likelihood_picture(first)
        return [
            *([] if known is None else [known]),
            bode_picture(first, grid),
            poles_picture(first, None if bare is None else bare.dutch_roll),
            step_picture(first, grid),
            residuals_picture(first),
        ]

    def _of_stream(self) -> list[Picture]:
        if self._data is None or self._run.grid is None:
            return []
        return [modes_picture(self._data, self._run.grid.methods[0])]


def _sigma(summary: RunSummary) -> str:
    """Return the meaning of ± on this page, "" where it has no answer."""
    mode = summary.dutch_roll if summary.flight is None else summary.flight.dutch_roll
    means = sigma_means([mode])
    return f"± is one sigma{means}. Bands in the pictures are 2 sigma." if means else ""


def _advised(summary: RunSummary) -> list[tuple[Reason, str]]:
    """Return each reason with what to do about it; what to do next is stated once, below them."""
    reasons, step = summary.deciding.reasons, summary.deciding.next
    advice = [reason.to_do for reason in reasons]
    return list(zip(reasons, ("" if each == step else each for each in advice), strict=True))


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
        if best.method is None:  # a flight without a usable manoeuvre
            parts.append(f"at {rate}")
        else:
            parts.append(f"{method_words(best.method)} at {rate}")
    return " · ".join(parts)


def _stream_note(summary: RunSummary) -> str:
    """Return the note before the sections on the stream, the page's last."""
    return note(
        "The stream, sample by sample",
        "From here on everything is about the estimates sample by sample and at the end of the "
        "log, not about the flight's answer above. They are not judged, and their σ is of noise "
        "alone.",
    )
