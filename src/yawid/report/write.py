"""``yawid report``: one HTML file that a flight-test engineer can read, print and pass on."""

from collections.abc import Iterator
from pathlib import Path

from yawid.physics.names import OF_YAW_CHANNEL, PAPER, Name
from yawid.report.data import ReportData, gather
from yawid.report.html import first_screen, grid, note, page, pictures, table, tables
from yawid.report.manoeuvres import flight_section
from yawid.report.model_pictures import bode_picture, poles_picture, residuals_picture, step_picture
from yawid.report.time_pictures import fit_picture, link_picture, modes_picture, parameters_picture
from yawid.results.run_summary import Fit, MethodSummary, RunSummary
from yawid.sinks.answers import cards, headline, percent, utc
from yawid.sinks.base import HALF_TRAVEL, Grid
from yawid.sinks.mcap.reader import McapRun, open_run
from yawid.sinks.part_file import check_free, write_whole


def write_report(mcap: Path, out: Path | None = None, *, force: bool = False) -> Path:
    """Write the report of a finished run and return its path, ``out`` or beside the MCAP.

    The same run gives the same bytes.

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not a run's.
        SinkError: the report exists and ``force`` is not set, or it cannot be written.
    """
    run = open_run(mcap)
    path = mcap.with_suffix(".html") if out is None else out
    check_free(path, force=force)
    write_whole({path: report(run).encode("utf-8", "replace")}, force=force)
    return path.absolute()


def report(run: McapRun) -> str:
    """Return the report as HTML.

    Raises:
        SourceError: the file is damaged.
    """
    name = Path(run.summary.log).name
    sections = _sections(run, name, gather(run, run.summary.answering))
    return page(f"{name} - yawid report", sections)


def _sections(run: McapRun, name: str, data: ReportData | None) -> Iterator[str]:
    summary = run.summary
    yield first_screen(name, _origin(run), headline(summary), cards(summary), summary.deciding)
    yield from flight_section(summary, HALF_TRAVEL if run.grid is None else run.grid.rudder_unit)
    if summary.flight is not None:
        yield _stream(summary)
    if data is not None and run.grid is not None and summary.answer is not None:
        mode, fit = summary.dutch_roll, summary.answer.fit
        yield pictures(
            "Does the model tell what was measured?",
            [fit_picture(data, fit, run.grid), residuals_picture(data.judged, fit.whiteness_p)],
        )
        yield pictures(
            "What was learnt, and when",
            [
                modes_picture(data, summary.answering or "", summary.others),
                parameters_picture(data, run.grid),
            ],
        )
        yield pictures(
            "What the model says of the aircraft",
            [
                bode_picture(data, mode, run.grid),
                poles_picture(data.model),
                step_picture(data.model, mode, run.grid),
            ],
        )
        yield tables("Numbers", _numbers(summary, summary.answer, run.grid))
    yield tables("Channels and link", _link(summary, data))
    if data is not None:
        yield pictures("", [link_picture(data)])
    yield tables("Configuration and provenance", _provenance(run, data))
    yield _folded(run)


def _origin(run: McapRun) -> str:
    vehicle, answer, flight = run.summary.vehicle, run.summary.answer, run.summary.flight
    parts = [f"{run.summary.duration_s:.0f} s of log"]
    if vehicle is not None:
        parts.append(f"vehicle {vehicle.sysid}/{vehicle.compid}")
    if flight is not None and flight.date is not None:
        parts.append(utc(flight.date))
    if answer is not None:
        rate = f"{1.0 / answer.sample_time_s:.3g} Hz"
        told = answer if flight is None else flight
        if told.method is None:  # a flight of which no manoeuvre is usable
            parts.append(f"at {rate}")
        else:
            name = told.method.upper()
            parts.append(f"{name}, orders na,nb,nc,nk = {told.orders} at {rate}")
    return " · ".join(parts)


def _stream(summary: RunSummary) -> str:
    """Return what stands between the flight's answer and the stream's."""
    word = "usable" if summary.verdict.usable else "not usable"
    ids = ", ".join(reason.id.replace("_", " ") for reason in summary.verdict.reasons)
    return note(
        "The stream, sample by sample",
        "From here on everything is of the estimates as they ran through the log, and of where "
        "they stood at its end: not of the flight's answer above. By themselves they would be "
        f"{word}{f' ({ids})' if ids else ''}.",
    )


def _numbers(summary: RunSummary, answer: MethodSummary, run_grid: Grid) -> Iterator[str]:
    estimates, others = summary.estimates or {}, summary.others
    answers = " answers" if others and summary.verdict.usable and summary.flight is None else ""
    methods = [m.upper() + ("" if m in others else answers) for m in estimates]
    rows = [
        (name, *(_value(e.theta.get(name), e.theta_std.get(name)) for e in estimates.values()))
        for name in run_grid.parameters
    ]
    yield grid("Parameters, ± σ of noise", ("", *methods), rows)
    fits = (
        ("fit one step ahead, %", "one_step_pct"), ("fit simulated, %", "simulation_pct"),
        ("fit on held-back data, %", "simulation_held_back_pct"),
        ("innovation σ, rad/s", "innovation_std"), ("residual σ, rad/s", "residual_std"),
        ("whiteness p", "whiteness_p"), ("SPR margin (ELS: > 0 is sure)", "spr_margin"),
    )  # fmt: skip
    rows = [(text, *(_fit(e.fit, key) for e in estimates.values())) for text, key in fits]
    # What is held is also each sample whose lags are not known: the first ones, and after a break.
    names = {"updates": "samples learnt from", "held": "others: held, or too few before them"}
    counts = [
        (text, *(str(getattr(e, key)) for e in estimates.values())) for key, text in names.items()
    ]
    yield grid("Fit", ("", *methods), [*rows, *counts])
    modes = [
        (m.kind, *(_number(value) for value in (m.wn_rad_s, m.wn_std, m.zeta, m.zeta_std)))
        for m in answer.modes or ()
    ]
    yield grid("All modes, σ of noise", ("", "ωn, rad/s", "σ", "ζ", "σ"), modes)
    if answer.physics:
        keys = ["value", "std", "std_noise"]
        if all(entry.std_noise is None for entry in answer.physics.values()):
            keys = keys[:2]
        heading = ("value", "σ", "of it noise") if len(keys) == 3 else ("value", "σ of noise")
        rows = [
            (
                _named(OF_YAW_CHANNEL.get(name) or Name("", "", name, ""), run_grid.rudder_unit),
                *(_number(getattr(entry, key)) for key in keys),
            )
            for name, entry in answer.physics.items()
        ]
        told = "Names before = are a flight-test engineer's, with wind from the right positive."
        named = note("", f"{told} The others are the paper's: {PAPER}.")
        yield f"{grid('Yaw channel', ('', *heading), rows)}\n{named}"


def _named(name: Name, rudder_unit: str) -> str:
    symbols = f" {name.symbols}" if name.symbols else ""
    unit = f", {name.unit.format(rudder=rudder_unit)}" if name.unit else ""
    return f"{name.text}{symbols}{unit}"


def _value(value: float | None, sigma: float | None) -> str:
    spread = "" if value is None or sigma is None else f" ± {sigma:.2g}"
    return f"{_number(value)}{spread}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _fit(fit: Fit, name: str) -> str:
    value: float | None = getattr(fit, name)
    if value is not None and name.endswith("_pct"):
        return percent(value, ".4g")
    return _number(value)


def _link(summary: RunSummary, data: ReportData | None) -> Iterator[str]:
    for name, channel in summary.channels.items():
        yield table(name, {key: _text(value) for key, value in channel.to_json().items()})
    counts = summary.link.to_json().items()
    yield table("link", {key.replace("_", " "): _text(count) for key, count in counts})
    if data is not None:
        for title, held in (("held", data.events.counts), ("noted", data.events.notes)):
            said = {name: f"{count} samples" for name, count in held.items()}
            yield table(f"samples {title}, by reason", said or {"any": "no sample"})


def _provenance(run: McapRun, data: ReportData | None) -> Iterator[str]:
    origin, source = run.summary.own_source.to_json(), run.summary.source
    if source is not None:
        origin |= {f"samples from, {key}": value for key, value in source.to_json().items()}
    if data is not None:
        origin["reproduced"] = (
            "yes: estimated again from the samples in the file, to the bit"
            if data.model.same
            else "no: estimating again gives other numbers (another version or machine); "
            "bands and model pictures are of the new estimate"
        )
    yield table("source", origin | {"signs": run.metadata.get("sign", {}).get("text", "")})
    settings = run.metadata["configuration"].items()
    given = {name.replace("_", " "): value for name, value in settings if value != "null"}
    yield table("configuration", given)
    yield table("versions", run.metadata.get("versions", {}))


def _folded(run: McapRun) -> str:
    lines = run.attachments.get("parameters.txt", b"").decode("utf-8", "replace").splitlines()
    seen = dict(line.rsplit(" ", 1) for line in lines if " " in line)
    log = {f"{i + 1}. {line.level}": line.text for i, line in enumerate(run.log)}
    shown = (("parameters seen", seen), ("log of the run", log),
             ("units of the MCAP's fields", run.metadata.get("units", {})))  # fmt: skip
    return "\n".join(table(title, rows, folded=True) for title, rows in shown if rows)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
