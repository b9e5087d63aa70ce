"""Turns a run's summary into flat rows of the tables of flights, ``runs`` and ``manoeuvres``."""

from collections.abc import Iterator, Sequence
from datetime import datetime

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.part import Part
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, Flight, Manoeuvre, MethodSummary, RunSummary, Value
from yawid.dataset.schema import CONDITION, DUTCH_ROLL, OF_MANOEUVRE, ORDERS, RUNNING, Column
from yawid.dataset.values import Row, known_date
from yawid.quantities.table import YAW_CHANNEL


def flight_rows(summary: RunSummary, first_us: int | None, duration_s: float | None) -> list[Row]:
    """Return the rows of one boot of one vehicle: its flight's answers by loop, else its stream's.

    The first is the headline. ``first_us`` is the time of the boot's first sample in us since 1970,
    ``duration_s`` its length in s.
    """
    vehicle, stream = summary.vehicle, summary.answer
    yaw, rudder = summary.channels.get("yaw"), summary.channels.get("rudder")
    row: Row = {
        "date": first_us,
        "duration_s": duration_s,
        "manoeuvres": len(summary.manoeuvres or ()),
        "yaw_source": None if yaw is None else yaw.source,
        "rudder_source": None if rudder is None else rudder.source,
        "rate_hz": None if stream is None else 1.0 / stream.sample_time_s,
        **_bare(summary.bare),
        **_ordinary(summary.ordinary),
    }
    if vehicle is not None:
        row |= {"compid": vehicle.compid, "vehicle_type": vehicle.type}
        row["autopilot"] = vehicle.autopilot
    if summary.by_loop:
        return [row | _answer(flight, first_us) for flight in summary.by_loop]
    row |= _judged(summary.deciding)
    return [row if stream is None else row | {"answer": "stream", **_of_method(stream)}]


def _answer(flight: Flight, first_us: int | None) -> Row:
    between = flight.between_std
    return {
        "date": first_us if flight.date is None else _us(flight.date),
        "answer": "manoeuvres",
        "method": flight.method,
        **_taken(flight, CONDITION),
        **_taken(flight.dutch_roll, DUTCH_ROLL),
        **_value("kappa_rad_m", "kappa", flight.kappa_rad_m),
        **_value("K_per_V", "K_per_V", flight.K_per_V),
        "between_wn_rad_s": None if between is None else between.wn_rad_s,
        "between_zeta": None if between is None else between.zeta,
        "used": flight.used,
        "disagree": flight.disagree,
        **_judged(flight.verdict),
    }


def run_rows(summary: RunSummary) -> Iterator[Row]:
    """Yield a row for each method's estimate from the stream."""
    for method in (summary.estimates or {}).values():
        yield {
            **_of_method(method),
            **_taken(method.orders, ORDERS),
            **_model(method),
            "is_answer": method is summary.answer,
        }


def manoeuvre_rows(summary: RunSummary) -> Iterator[Row]:
    """Yield a row for each manoeuvre."""
    reasons = () if summary.flight is None else summary.flight.verdict.reasons
    implausible = any(reason.id == "airspeed_implausible" for reason in reasons)
    for each in summary.manoeuvres or ():
        row: Row = {
            **_taken(each, OF_MANOEUVRE),
            "date": _us(each.date),
            "used": each.n in summary.used,
            **_bare(each.lateral),
            **_judged(each.verdict),
        }
        if (answer := each.answer) is not None:
            row |= _of_method(answer) | _model(answer)
            row |= {} if implausible else _over_speed(each, answer)
        for name in RUNNING:
            running = each.estimates.get(name)
            if running is not None and running.dutch_roll is not None:
                row[f"{name}_wn_rad_s"] = running.dutch_roll.wn_rad_s
                row[f"{name}_zeta"] = running.dutch_roll.zeta
        yield row


def _over_speed(each: Manoeuvre, answer: MethodSummary) -> Row:
    """Return wn / V and K / V with their sigmas; V is the equivalent airspeed. Empty without V."""
    speed = each.airspeed_m_s
    if each.airspeed_source != "airspeed" or not speed:
        return {}
    row, roll = {}, answer.dutch_roll
    if roll is not None:
        wn = Value(value=roll.wn_rad_s, std=roll.wn_std, std_noise=roll.wn_std_noise)
        row = _value("kappa_rad_m", "kappa", wn, 1.0 / speed)
    gain = (answer.physics or {}).get("K")
    return row | _value("K_per_V", "K_per_V", gain, 1.0 / speed)


def _bare(bare: Bare | None) -> Row:
    """Return the numbers of the bare airframe; none where it is not known."""
    if bare is None or bare.dutch_roll is None:
        return {}
    roll, mode = bare.dutch_roll, bare.roll_mode
    return {
        "bare_wn_rad_s": roll.wn_rad_s,
        "bare_wn_std": roll.wn_std,
        "bare_zeta": roll.zeta,
        "bare_zeta_std": roll.zeta_std,
        "bare_level": roll.level,
        "bare_roll_mode_s": None if mode is None else mode.time_constant_s,
        "bare_roll_mode_std": None if mode is None else mode.std,
        "bare_airspeed_m_s": bare.airspeed_m_s,
    }


def _ordinary(found: OrdinaryAnswer | None) -> Row:
    """Return the numbers of ordinary flight, or why they are not known; none if not asked for."""
    if found is None or found.dutch_roll is None:
        return {} if found is None else {"ordinary_why": found.verdict.reasons[0].id}
    roll, speed = found.dutch_roll, found.equivalent_airspeed_m_s
    names = "wn_rad_s", "wn_std", "zeta", "zeta_std"
    row: Row = {f"ordinary_{name}": getattr(roll, name) for name in names}
    row["ordinary_airspeed_m_s"] = found.airspeed_m_s
    if speed is not None and found.airspeed_source == "airspeed":
        wn = Value(roll.wn_rad_s, roll.wn_std)
        over = _value("ordinary_kappa_rad_m", "ordinary_kappa", wn, 1.0 / speed)
        row |= {name: x for name, x in over.items() if not name.endswith("_noise")}
    return row


def _of_method(method: MethodSummary) -> Row:
    return {"method": method.method, **_taken(method.dutch_roll, DUTCH_ROLL)}


def _taken(of: Part | None, columns: Sequence[Column]) -> Row:
    """Return the fields of an object that have the names of ``columns``; none of None."""
    return {} if of is None else {name: getattr(of, name) for name, *_ in columns}


def _value(column: str, stem: str, value: Value | None, scale: float = 1.0) -> Row:
    if value is None:
        return {}
    named = (
        (column, value.value),
        (f"{stem}_std", value.std),
        (f"{stem}_std_noise", value.std_noise),
    )
    return {name: None if x is None else scale * x for name, x in named}


def _model(method: MethodSummary) -> Row:
    physics: Row = {}
    for name, value in (method.physics or {}).items():
        if name in YAW_CHANNEL:  # physics also has the error of the reduction, not a column here
            physics |= {name: value.value, f"{name}_std": value.std}
    fit = method.fit.to_json()
    theta, stds = method.theta or {}, method.theta_std or {}
    return {
        "sample_time_s": method.sample_time_s,
        "forgetting_factor": method.forgetting_factor,
        "updates": method.updates,
        "held": method.held,
        "theta_names": list(theta),
        "theta": list(theta.values()),
        "theta_std": [stds.get(name) for name in theta],
        **physics,
        **fit,
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
