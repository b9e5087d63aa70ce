"""The summary of a run as a page, and the page of ``yawid orders``."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, TextIO

from msgspec.structs import replace

from yawid.answers.heard import VehicleSeen
from yawid.answers.reports import OrdersReport
from yawid.answers.run_summary import DutchRoll, MethodSummary, Origin, RunSummary, Value
from yawid.quantities.table import YAW_CHANNEL
from yawid.sinks.flight_table import manoeuvre_parts
from yawid.sinks.pages import Grid, Note, Part, to_terminal, verdict_parts
from yawid.sinks.words import (
    NEXT,
    answer_rows,
    conditions,
    next_step,
    numbers,
    percent,
    plus_minus,
    whose,
)

MOST_BOOTS: Final = 4
"""The largest number of boots that are printed; --json has all."""
_DERIVATIVES: Final = ("a_my_beta", "a_my_omega_y", "a_my_delta_h", "a_z_beta", "K", "T_theta_s")
"""The yaw channel's numbers that are shown next to wn and zeta."""


def print_summary(summary: RunSummary, stream: TextIO) -> None:
    """Print the summary of one run: see :func:`summary_page`, then the channels and files."""
    # A path is for copying and must not be wrapped.
    files = (summary.files or {}).items()
    paths = (Note(f"{kind:>8}  {path}", wraps=False) for kind, path in files)
    page = summary_page(summary)
    to_terminal([Note(summary.log, "bold"), *page, *origin(summary), *paths], stream)


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


def yaw_channel_parts(summary: RunSummary, rudder_unit: str) -> Iterator[Part]:
    """Yield the numbers of eq. 22-23 of the flight, for each loop, or of the stream's answer."""
    answer, found = summary.answer, []
    for each in summary.by_loop:
        said = filter(None, (whose(each), conditions(each)))
        found.append((f"the flight, {' '.join(said)}", each.physics))
    if summary.flight is None and answer is not None:
        found.append((f"stream, {answer.method.upper()}", answer.physics))
    for name, physics in found:
        values = [(YAW_CHANNEL[key], (physics or {}).get(key, Value())) for key in _DERIVATIVES]
        rows = [
            (f"{row.words} {row.symbol}",
             f"{plus_minus(each.value, each.std)} {row.unit_for(rudder_unit)}")
            for row, each in values if each.value is not None
        ]  # fmt: skip
        if rows:
            yield Note(f"Yaw channel, {name}:")
            yield Grid(("", ""), rows)


def _number(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)


def _wn_zeta(roll: DutchRoll | None) -> tuple[float | None, float | None]:
    return (None, None) if roll is None else (roll.wn_rad_s, roll.zeta)


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


def print_orders(report: OrdersReport, stream: TextIO, most: int = 12) -> None:
    """Print the ``most`` best structures of a log as a table; an arrow marks the recommended one.

    That is printed where it is not among the best by simulation, too.
    """
    to_terminal(orders_page(report, most), stream)


def orders_page(report: OrdersReport, most: int) -> Iterator[Part]:
    """Yield the parts of that page."""
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
            *(_number(each, ".3f") for each in _wn_zeta(tried.dutch_roll)),
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
    yield from (Note(f"  {reason}") for reason in report.verdict.fatal)
    if (step := next_step(report.verdict)) is not None:
        yield Note(f"  {NEXT} {step}")
    yield Note("yawid inspect says what to record next time")
