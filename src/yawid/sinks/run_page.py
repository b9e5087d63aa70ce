"""The pages of a run, of its manoeuvres as a table, of ``yawid orders`` and of ``yawid damper``.

In a terminal a table is at most 80 columns wide; of many manoeuvres it has the first and the last.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from typing import Final

from msgspec.structs import asdict, replace

from yawid.answers.damper_report import DamperAt, DamperReport
from yawid.answers.heard import VehicleSeen
from yawid.answers.reports import OrdersReport
from yawid.answers.run_summary import (
    DutchRoll,
    Flight,
    Manoeuvre,
    MethodSummary,
    Origin,
    RunSummary,
)
from yawid.quantities.airspeed import GROUND_SPEED
from yawid.sinks.pages import Grid, Note, Part, Said, verdict_parts
from yawid.sinks.words import (
    answer_rows,
    loop_of,
    numbers,
    outcome,
    percent,
    sigma_means,
    utc,
    whose,
)

HEADS: Final = (
    "n", "from-to s", "mode", "loop", "V m/s", "alt m", "wn rad/s", "zeta", "result",
)  # fmt: skip
MOST_ROWS: Final = 20
"""The largest number of rows; manoeuvres between the first and the last ten are in --json."""
SAME_BOOT: Final = timedelta(seconds=10)
"""Two manoeuvres whose boots, from date and seconds, differ by no more have the same boot."""
_FINE: Final = 0.05
"""A sigma of wn in rad/s below which wn has a third decimal."""
_MODE_WIDTH: Final = 10
_LARGEST: Final = 1000.0
"""Numbers as large as this, from estimates that diverged, have three digits."""


def manoeuvre_parts(manoeuvres: Sequence[Manoeuvre], flights: Sequence[Flight]) -> Iterator[Part]:
    """Yield a table with a row for each manoeuvre, dim if not usable, and the notes below it."""
    yield manoeuvre_grid(manoeuvres, flights)
    yield Note(table_notes(manoeuvres, flights), "dim")


def manoeuvre_grid(manoeuvres: Sequence[Manoeuvre], flights: Sequence[Flight]) -> Grid:
    """Return that table."""
    half, left_out = MOST_ROWS // 2, len(manoeuvres) - MOST_ROWS
    shown = list(manoeuvres) if left_out <= 0 else [*manoeuvres[:half], *manoeuvres[-half:]]
    rows = [[*_cells(each), *in_columns(each.dutch_roll), outcome(each, flights)] for each in shown]
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
    boots: dict[datetime, list[str]] = {}
    for each in manoeuvres:
        # Without a date there is no boot, and the vehicle's clock may have any value.
        with suppress(ValueError, OverflowError, TypeError):
            begun = datetime.fromisoformat(each.date or "") - timedelta(seconds=each.from_s)
            boot = next((one for one in boots if abs(one - begun) <= SAME_BOOT), begun)
            boots.setdefault(boot, []).append(str(each.n))
    for boot, of in list(boots.items())[:MOST_BOOTS]:
        which = "" if len(boots) == 1 else f" of {' to '.join(dict.fromkeys((of[0], of[-1])))}"
        yield f"seconds{which} since boot at {utc(boot.isoformat())}"


MOST_BOOTS: Final = 4
"""The largest number of boots that are printed; --json has all."""


def whole_page(summary: RunSummary) -> Iterator[Part]:
    """Yield the page of one run: see :func:`summary_page`, then the channels and files."""
    yield Note(summary.log, "bold")
    yield from (*summary_page(summary), *origin(summary))
    for kind, path in (summary.files or {}).items():
        # A path is for copying and must not be wrapped.
        yield Note(f"{kind:>8}  {path}", wraps=False)


def summary_page(summary: RunSummary) -> Iterator[Part]:
    """Yield the verdict, the answers with their sigmas, and the manoeuvres.

    The numbers of the stream follow only where there was no manoeuvre.
    """
    yield from verdict_parts(summary.deciding)
    yield from answer_rows(summary)
    if summary.manoeuvres:
        yield from manoeuvre_parts(summary.manoeuvres, summary.by_loop)
    if summary.estimates and summary.flight is None:
        yield stream_grid(summary.estimates)


def stream_grid(estimates: Mapping[str, MethodSummary]) -> Grid:
    """Return the table of the running estimates at the end of the stream, a column each."""
    names = ("Dutch roll wn, rad/s", "Dutch roll zeta", "fit one step, %", "fit simulated, %",
             "samples used / not used", "na,nb,nc,nk at rate")  # fmt: skip
    columns = [
        (
            *numbers(each.dutch_roll),
            _percent(each.fit.one_step_pct),
            _percent(each.fit.simulation_pct),
            f"{each.updates} / {each.held}",
            f"{each.orders} at {1.0 / each.sample_time_s:.3g} Hz",
        )
        for each in estimates.values()
    ]
    heads = ("± is one sigma of noise", *(method.upper() for method in estimates))
    return Grid(heads, list(zip(names, *columns, strict=True)))


def _number(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)


def _percent(value: float | None) -> str:
    return "-" if value is None else percent(value)


_PLURAL = ("frames", "skipped_bytes", "reboots", "clock_steps", "gaps")
"""Counts of a link whose name is a plural."""


def origin(summary: Origin) -> Iterator[Note]:
    """Yield a line for each channel with its source, then one each for link, vehicles, boots."""
    for name, channel in summary.channels.items():
        rate = "" if channel.rate_hz is None else f" at {channel.rate_hz:.3g} Hz"
        how = "" if channel.how is None else f" ({channel.how})"
        yield Note(f"{name:>8}  {channel.source}{rate}{how}")
    link, leap_s = replace(summary.link, clock_leap_s=None), summary.link.clock_leap_s
    counts = ", ".join(
        f"{count} {(name[:-1] if count == 1 and name in _PLURAL else name).replace('_', ' ')}"
        for name, count in link.to_json().items()
        if count or name == "frames"
    )
    leapt = f"; the vehicle's clock jumped by {leap_s:.0f} s" if leap_s else ""
    if counts or leapt:  # a torn run has neither
        yield Note(f"    link  {counts}{leapt}")
    if summary.vehicles is not None:
        yield Note(f"vehicles  {_vehicles(summary.vehicles, summary.vehicle)}")
    if summary.boots is not None:
        each = [f"{b.boot}: {b.from_s:.0f} to {b.to_s:.0f} s" for b in summary.boots]
        yield Note(f"   boots  {', '.join(each[:MOST_BOOTS])}{', ...' * (len(each) > MOST_BOOTS)}")


def _vehicles(vehicles: Sequence[VehicleSeen], answered: VehicleSeen | None) -> str:
    """Return the names of all vehicles in the log; the one that the answer is about is marked."""
    named = [
        f"{each.sysid}/{each.compid} {each.type_name}"
        + (" (answered)" if answered and each.address == answered.address else "")
        for each in vehicles
    ]
    return f"{', '.join(named)}: choose another by --sysid"


def orders_page(report: OrdersReport, most: int = 12) -> Iterator[Part]:
    """Yield the ``most`` best structures of a log as a table; an arrow marks the recommended one.

    It is there where it is not among the best by simulation, too.
    """
    yield Note(report.log, "bold")
    chosen = str(report.recommended)
    shown = [t for i, t in enumerate(report.candidates) if i < most or str(t) == chosen]
    rows = [
        (
            "->" if str(tried) == chosen else "",
            str(tried),
            _percent(tried.simulation_pct),
            _number(tried.bic, ".0f"),
            _number(tried.aic, ".0f"),
            _number(tried.whiteness_p, ".2g"),
            *(_number(getattr(tried.dutch_roll, n, None), ".3f") for n in ("wn_rad_s", "zeta")),
        )
        for tried in shown
    ]
    heads = ("", "na,nb,nc,nk", "simulated %", "BIC", "AIC", "white p", "wn", "zeta")
    yield Grid(heads, rows, ["bold" if row[0] else "" for row in rows])
    of = f"{report.manoeuvres} manoeuvres'" if report.manoeuvres else "the log's"
    yield Note(
        f"Rule: of the structures within 0.5 points of the best simulation, the one with the least "
        f"BIC; estimated from two thirds of {of} samples, simulated over the rest."
    )
    if report.recommended is not None:
        yield Note(f"recommended  --orders {report.recommended}", "bold")
        return
    yield Note("no orders are recommended: no replay of this log can be used", "bold red")
    yield from verdict_parts(report.verdict)
    yield Note("yawid inspect says what to record next time")


MEANS: Final = (
    "± is one sigma; settled: s after a step of the rudder; GM, PM: margins of the open loop at "
    "the 95 % bound, - where nothing crosses or the model is not known"
)


def damper_page(report: DamperReport) -> Iterator[Part]:
    """Yield the report of a damper: the gains, the band, what to look for; or why there is none."""
    yield Note(report.log, "bold")
    mix = [] if report.mix is None else [Note(f"mix  {report.mix.text}")]
    if not report.verdict.usable:
        yield Note("no gain can be given", "bold red")
        yield from (*verdict_parts(report.verdict), *mix)
        return
    found = report.recommended
    text = "none is recommended" if found is None else (
        f"aim at {found.low:g} to {found.high:g}, fly {found.next:g} next"
    )  # fmt: skip
    name = f"{report.parameter}  " if report.parameter else ""
    yield Note(f"{name}{text}", "bold")
    yield from (Said("", said) for said in report.says)
    yield from (Said("", f"{reason.called}: {reason.text}") for reason in report.verdict.reasons)
    if report.gains:
        yield gains_grid(report)
    yield from mix
    if report.gains:
        yield Note(MEANS)


def gains_grid(report: DamperReport) -> Grid:
    """Return the table of every gain at every airspeed."""
    heads = (report.parameter or "", "V m/s", "wn rad/s", "zeta", "settled", "GM dB", "PM deg", "")
    return Grid(heads, list(_gains(report)), texts=(7,))


def _gains(report: DamperReport) -> Iterator[list[str]]:
    named = {"flown": report.flown}
    if report.recommended is not None:
        named |= asdict(report.recommended)  # low, high, next
    for gain in report.gains or ():
        marks = ", ".join(name for name, value in named.items() if value == gain.value)
        for at in gain.at:
            yield [f"{gain.value:g}", f"{at.airspeed_m_s:.1f}", *_at_airspeed(at), marks]


def _at_airspeed(at: DamperAt) -> list[str]:
    margins = (at.gain_margin_db, at.phase_margin_deg)
    return [
        _with_sigma(at.wn_rad_s, at.wn_std, ".2f"),
        _with_sigma(at.zeta, at.zeta_std, ".3f"),
        "-" if at.settling_s is None else f"{at.settling_s:.2g}",
        *("-" if each is None else f"{each:.0f}" for each in margins),
    ]


def _with_sigma(value: float | None, std: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}} ± {std or 0.0:{form}}"
