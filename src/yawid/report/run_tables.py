"""The report's tables: the numbers of the models, the channels, the link, and their origin."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from yawid.answers.heard import PARAMETERS
from yawid.answers.model_parts import Fit
from yawid.answers.run_summary import MethodSummary, RunSummary, Value
from yawid.blocks import Held, Noted, words
from yawid.physics.derivatives import LARGEST_ERROR
from yawid.quantities.table import QUANTITIES, REDUCTION_ERROR, YAW_CHANNEL
from yawid.report.data import ReportData
from yawid.report.html import grid, note, symbol, table
from yawid.sinks.base import Grid
from yawid.sinks.mcap.reader import McapRun, log_sha256_of, reading_of
from yawid.sinks.words import NONE, of_value, percent, plus_minus

PAPER: Final = (
    "M. T. Vu, Development of a kinematic identification framework for the directional motion of a "
    "fixed-wing aircraft based on an ARMAX model, eq. 22-23"
)
NO_YAW_CHANNEL: Final = (
    f"the model has no yaw mode, or differs from eq. 23 by more than {100 * LARGEST_ERROR:.0f} % "
    "over 0.3 to 3 ωn when its other poles are divided out"
)
"""Why a model has no numbers of eq. 22-23."""
LEAST_P: Final = 0.0001
"""The smallest p of a test that is printed: still smaller values mean the same."""


def stream_numbers(summary: RunSummary, answer: MethodSummary, run_grid: Grid) -> Iterator[str]:
    """Yield the tables of every method's estimates at the end of the stream."""
    estimates = summary.estimates or {}
    methods = [method.upper() for method in estimates]
    thetas = [(e.theta or {}, e.theta_std or {}) for e in estimates.values()]
    rows = [
        (name, *(plus_minus(theta.get(name), std.get(name)) for theta, std in thetas))
        for name in run_grid.parameters
    ]
    yield grid("Parameters, ± one σ of noise", ("", *methods), rows)
    fits = (
        ("fit one step ahead, %", "one_step_pct"), ("fit simulated, %", "simulation_pct"),
        ("innovation σ, rad/s", "innovation_std"), ("residual σ, rad/s", "residual_std"),
        ("whiteness p", "whiteness_p"), ("SPR margin (ELS: > 0 is sure)", "spr_margin"),
    )  # fmt: skip
    rows = [(text, *(_fit(e.fit, key) for e in estimates.values())) for text, key in fits]
    # Samples whose lags are unknown also count as held: the first ones, and those after a break.
    names = {"updates": "samples used", "held": "not used: held, or too few before them"}
    counts = [
        (text, *(str(getattr(e, key)) for e in estimates.values())) for key, text in names.items()
    ]
    yield grid("Fit", ("", *methods), [*rows, *counts])
    modes = [
        (m.kind, plus_minus(m.wn_rad_s, m.wn_std), plus_minus(m.zeta, m.zeta_std))
        for m in answer.modes or ()
    ]
    yield grid(
        f"All modes of {answer.method.upper()}, ± one σ of noise", ("", "ωn, rad/s", "ζ"), modes
    )
    if summary.flight is None and answer.physics:
        yield yaw_channel({answer.method.upper(): answer.physics}, run_grid.rudder_unit)
    elif summary.flight is None:
        yield note("", f"Derivatives are absent: {NO_YAW_CHANNEL}.")


def yaw_channel(columns: Mapping[str, Mapping[str, Value]], rudder_unit: str) -> str:
    """Return the table of the numbers of eq. 22-23, a column for each source, and the citation."""
    rows = []
    for row in (*YAW_CHANNEL.values(), QUANTITIES[REDUCTION_ERROR]):
        found = [numbers.get(row.name, Value()) for numbers in columns.values()]
        if any(each.value is not None for each in found):
            text = ", ".join(filter(None, (row.words, row.unit_for(rudder_unit))))
            label = symbol(row.symbol, text)
            rows.append((label, *map(of_value, found)))
    total = any(each.std_noise is not None for some in columns.values() for each in some.values())
    sigma = "± one σ, in brackets of noise alone" if total else "± one σ, of noise alone"
    cited = note(
        "",
        "Left of = the usual name, sideslip positive with wind from the right; right of it the "
        f"paper's: {PAPER}.",
    )
    return f"{grid(f'Yaw channel, {sigma}', ('', *columns), rows)}\n{cited}"


def _fit(fit: Fit, name: str) -> str:
    value: float | None = getattr(fit, name)
    if value is not None and name == "whiteness_p" and value < LEAST_P:
        return f"< {LEAST_P}"
    if value is not None and name.endswith("_pct"):
        return percent(value, ".4g")
    return NONE if value is None else f"{value:.4g}"


def channel_tables(summary: RunSummary, data: ReportData | None) -> Iterator[str]:
    """Yield the tables of the channels' sources, the link, and the held and noted samples."""
    for name, channel in summary.channels.items():
        yield table(name, {key: _text(value) for key, value in channel.to_json().items()})
    link = summary.link.to_json().items()
    yield table("link", {key.replace("_", " "): _text(count) for key, count in link})
    if data is not None:
        for flags, codes in ((Held, data.samples.held), (Noted, data.samples.noted)):
            counts = {words(flag): np.sum(codes & flag.value != 0) for flag in flags}
            said = {name: f"{count} samples" for name, count in counts.items() if count}
            title = f"samples {flags.__name__.lower()}, by reason"
            yield table(title, said or {"any": "no sample"})


def provenance(run: McapRun) -> Iterator[str]:
    """Yield the tables of the run's source, its configuration and its versions."""
    origin, source = run.summary.own_source.to_json(), run.summary.source
    if source is not None:
        origin |= {f"samples from, {key}": value for key, value in source.to_json().items()}
    yield table("source", origin | {"signs": run.metadata.get("sign", {}).get("text", "")})
    yield _configuration(run)
    yield table("versions", run.metadata.get("versions", {}))


def _configuration(run: McapRun) -> str:
    settings = {**run.metadata["configuration"], **reading_of(run)}.items()
    given = {
        name.replace("_", " "): value for name, value in settings if value not in ("null", "[]")
    }
    return table("configuration", given)


def is_of(page: Path, run: McapRun) -> bool:
    """Return whether a page is a report of the same log with the same options."""
    sha256 = log_sha256_of(run)
    said = page.read_text(encoding="utf-8", errors="replace")
    return sha256 is not None and sha256 in said and _configuration(run) in said


def folded(run: McapRun) -> str:
    """Return the folded tables of details: the vehicle's parameters, the log's lines, the units."""
    lines = run.attachments.get(PARAMETERS, b"").decode("utf-8", "replace").splitlines()
    seen = dict(line.rsplit(" ", 1) for line in lines if " " in line)
    log = {f"{i + 1}. {line.level}": line.text for i, line in enumerate(run.log)}
    shown = (("parameters seen", seen), ("log of the run", log),
             ("units of the MCAP's fields", run.metadata.get("units", {})))  # fmt: skip
    return "\n".join(table(title, rows, folded=True) for title, rows in shown if rows)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
