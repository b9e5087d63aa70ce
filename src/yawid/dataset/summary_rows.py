"""Turns a run's summary into flat rows of the tables of flights, ``runs`` and ``manoeuvres``.

The columns follow from the fields: a row has every field whose name is a column of its table.
"""

from collections.abc import Iterator
from datetime import datetime

from yawid.answers.model_parts import flat, flat_answer, with_sigmas
from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, Manoeuvre, MethodSummary, RunSummary, Value
from yawid.dataset.schema import FLIGHTS, MANOEUVRES, RUNNING, RUNS, Table
from yawid.dataset.values import Row, known_date


def of_table(table: Table, row: Row) -> Row:
    """Return what a table has a column for."""
    return {name: row[name] for name, *_ in table.columns if name in row}


def flight_rows(summary: RunSummary, first_us: int | None, duration_s: float | None) -> list[Row]:
    """Return the rows of one boot of one vehicle: its flight's answers by loop, else its stream's.

    The first is the headline. ``first_us`` is the time of the boot's first sample in us since 1970,
    ``duration_s`` its length in s.
    """
    vehicle, stream = summary.vehicle, summary.answer
    row = {
        **flat(vehicle),
        **{f"{name}_source": each.source for name, each in summary.channels.items()},
        **_bare(summary.bare),
        **ordinary_row(summary.ordinary),
        "airspeed_source": None,
        "date": first_us,
        "duration_s": duration_s,
        "manoeuvres": len(summary.manoeuvres or ()),
        "rate_hz": None if stream is None else 1.0 / stream.sample_time_s,
        "vehicle_type": None if vehicle is None else vehicle.type,
    }
    answers = [
        {
            **flat_answer(flight),
            **flat(flight.between_std, "between_"),
            **_judged(flight.verdict),
            "answer": "manoeuvres",
            "date": first_us if flight.date is None else _us(flight.date),
        }
        for flight in summary.by_loop
    ]
    of_stream = {} if stream is None else {"answer": "stream", **_method(stream)}
    answers = answers or [of_stream | _judged(summary.deciding)]
    return [of_table(FLIGHTS, row | each) for each in answers]


def run_rows(summary: RunSummary) -> Iterator[Row]:
    """Yield a row for each method's estimate from the stream."""
    for method in (summary.estimates or {}).values():
        yield of_table(RUNS, _method(method) | {"is_answer": method is summary.answer})


def manoeuvre_rows(summary: RunSummary) -> Iterator[Row]:
    """Yield a row for each manoeuvre."""
    reasons = () if summary.flight is None else summary.flight.verdict.reasons
    implausible = any(reason.id == "airspeed_implausible" for reason in reasons)
    for each in summary.manoeuvres or ():
        row = flat(each) | _bare(each.lateral) | _judged(each.verdict)
        row |= {"date": _us(each.date), "used": each.n in summary.used}
        if (answer := each.answer) is not None:
            row |= _method(answer) | ({} if implausible else _over_speed(each, answer))
        for name in RUNNING:
            running = each.estimates.get(name)
            row |= flat(running and running.dutch_roll, f"{name}_")
        yield of_table(MANOEUVRES, row)


def _over_speed(each: Manoeuvre, answer: MethodSummary) -> Row:
    """Return wn / V and K / V with their sigmas; V is the equivalent airspeed. Empty without V."""
    speed = each.airspeed_m_s
    if each.airspeed_source != "airspeed" or not speed:
        return {}
    roll, gain = answer.dutch_roll, (answer.physics or {}).get("K", Value())
    wn = Value() if roll is None else Value(roll.wn_rad_s, roll.wn_std, roll.wn_std_noise)
    return with_sigmas("kappa_rad_m", wn, 1.0 / speed) | with_sigmas("K_per_V", gain, 1.0 / speed)


def _bare(bare: Bare | None) -> Row:
    """Return the numbers of the bare airframe; none where it is not known."""
    if bare is None or bare.dutch_roll is None:
        return {}
    mode = bare.roll_mode
    return {
        **flat(bare.dutch_roll, "bare_"),
        "bare_roll_mode_s": None if mode is None else mode.time_constant_s,
        "bare_roll_mode_std": None if mode is None else mode.std,
        "bare_airspeed_m_s": bare.airspeed_m_s,
    }


def ordinary_row(found: OrdinaryAnswer | None) -> Row:
    """Return the numbers of ordinary flight, or why they are not known; none if not asked for."""
    if found is None:
        return {}
    is_known = found.airspeed_source == "airspeed"
    row: Row = {"ordinary_altitude_m": found.altitude_m if is_known else None}
    if (roll := found.dutch_roll) is None:
        return row | {"ordinary_why": found.verdict.reasons[0].id}
    row |= flat(roll, "ordinary_") | {"ordinary_airspeed_m_s": found.airspeed_m_s}
    if is_known and (speed := found.equivalent_airspeed_m_s):
        wn = Value(roll.wn_rad_s, roll.wn_std)
        row |= with_sigmas("ordinary_kappa_rad_m", wn, 1.0 / speed)
    return row


def _method(method: MethodSummary) -> Row:
    theta, stds = method.theta or {}, method.theta_std or {}
    theta_std = [stds.get(name) for name in theta]
    return flat_answer(method) | {
        "theta_names": [*theta],
        "theta": [*theta.values()],
        "theta_std": theta_std,
    }


def _judged(verdict: Verdict) -> Row:
    return {
        "usable": verdict.usable,
        "reasons": [each.id for each in verdict.fatal],
        "warnings": [each.id for each in verdict.reasons if each.weight != "fatal"],
        "text": "; ".join(map(str, verdict.reasons)),
    }


def _us(date: str | None) -> int | None:
    """Return an ISO date in us since 1970; None if it is unknown or not a date."""
    try:
        if date is None:
            return None
        return known_date(round(datetime.fromisoformat(date).timestamp() * 1e6))
    except (ValueError, OverflowError):  # a forged summary may contain anything
        return None
