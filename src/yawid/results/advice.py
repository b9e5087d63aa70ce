"""Advice about a log without a usable answer: what to do now, and what to record next time."""

from collections.abc import Iterable, Iterator

from yawid.answers.channel_report import ChannelReport
from yawid.answers.run_summary import ReasonSummary, RunSummary
from yawid.quantities.vehicles import ARDUPILOT, WITHOUT_RUDDER
from yawid.results.reasons import ASK_HZ, KINDS, PARAMETERS, PARAMETERS_ON

_OFTEN = 3
"""With this many manoeuvres, more of the same are no longer advised."""
_LONG_S = 60.0
"""The rudder moved long enough where the estimator learnt from this many seconds."""
_NOT_MOVED = frozenset({"not_excited", "mixed_rudder", "collinear_inputs"})
_FLOWN_ENOUGH = {
    "not_converged": "The rudder moved enough: choose calmer air or a steadier airspeed by --from "
    "and --to, or compare orders with yawid orders.",
    "mode_not_driven": "The rudder moved enough: use --band to keep what it drives, or choose the "
    "calmest stretch by --from and --to.",
}


def what_to_record(reasons: Iterable[str], report: ChannelReport) -> list[str]:
    """Return what to record next time for the reasons (ids), in the order given, each text once."""
    return list(dict.fromkeys(_advice(reasons, report)))


def _advice(reasons: Iterable[str], report: ChannelReport) -> Iterator[str]:
    vehicle = report.vehicle
    for reason in reasons:
        if reason == "no_rudder" and vehicle is not None:
            yield _no_rudder(report)
        elif text := KINDS[reason].to_record(None if vehicle is None else vehicle.autopilot):
            yield text


def _no_rudder(report: ChannelReport) -> str:
    """Return what would identify the rudder; this depends on what the log holds."""
    vehicle, message = report.vehicle, report.rudder_message
    assert vehicle is not None  # it was asked for
    if message is not None:
        return f"ask for {message} at {ASK_HZ} Hz or more: it holds the position of the rudder"
    if vehicle.type in WITHOUT_RUDDER:
        kind = f"{vehicle.type_name} (type {vehicle.type})"
        return f"a {kind} has no rudder: record an aircraft that has one"
    if vehicle.autopilot == ARDUPILOT and report.has_functions:
        return (
            "if a servo does move a rudder, give it SERVOn_FUNCTION = 21 (V-tail: 79 and 80), or "
            "name it: --rudder servo:N"
        )
    parameters = PARAMETERS_ON.get(vehicle.autopilot, PARAMETERS)
    return f"record SERVO_OUTPUT_RAW (36) and {parameters}; or name it: --rudder servo:N"


def to_do(reason: ReasonSummary, summary: RunSummary) -> str:
    """Return what to do now about a reason, in one sentence for this vehicle and this record.

    It is empty where there is nothing to do, or where the reason's own text already says it.
    """
    kind, vehicle = KINDS.get(reason.id), summary.vehicle
    if kind is None:  # written by a newer version
        return ""
    autopilot = None if vehicle is None else vehicle.autopilot
    if reason.id == "no_rudder" and vehicle is not None:
        if vehicle.type in WITHOUT_RUDDER:
            return "Use a log of an aircraft that has a rudder."
        if "functions" in reason.text:
            return "If one of these outputs does move a rudder, name it: --rudder servo:N."
    if reason.id == "airspeed_changed" and summary.flight is not None:
        return "Fly at a steady airspeed, or choose a manoeuvre that was, by --from and --to."
    if reason.id in ("rate_too_low", "rate_low") and autopilot in kind.record_on:
        how = kind.to_record(autopilot)
        return f"Next time {how}."
    if reason.id in _FLOWN_ENOUGH and _flown_enough(summary):
        return _FLOWN_ENOUGH[reason.id]
    # The texts of some reasons already say what to do.
    return "" if kind.now.rstrip(".").lower() in reason.text.lower() else kind.now


def _flown_enough(summary: RunSummary) -> bool:
    """Return whether the rudder moved by itself in several manoeuvres or, without any, for long."""
    if summary.manoeuvres:
        return len(summary.manoeuvres) >= _OFTEN
    answer, against = summary.answer, {each.id for each in summary.verdict.reasons}
    learnt_s = 0.0 if answer is None else answer.updates * answer.sample_time_s
    return learnt_s >= _LONG_S and not against & _NOT_MOVED
