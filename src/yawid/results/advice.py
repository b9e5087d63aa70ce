"""Advice about a log: what to do about each reason now, and what to record next time."""

from collections.abc import Iterable, Iterator

from msgspec.structs import replace

from yawid.answers.channel_report import ChannelReport
from yawid.answers.heard import VehicleSeen
from yawid.answers.reasons import ASK_HZ, KINDS, PARAMETERS, PARAMETERS_ON, Reason, Verdict
from yawid.answers.run_summary import Bare, RunSummary
from yawid.quantities.vehicles import ARDUPILOT, WITHOUT_RUDDER

OFTEN = 3
"""With this many manoeuvres, more of the same are no longer advised."""
_FLOWN_ENOUGH = {
    "not_converged": "The rudder moved enough: choose calmer air or a steadier airspeed by --from "
    "and --to.",
    "mode_not_driven": "The rudder moved enough: choose the calmest stretch by --from and --to.",
}


def what_to_record(reasons: Iterable[str], report: ChannelReport) -> list[str]:
    """Return what to record next time for the reasons (ids), in the order given, each text once."""
    return list(dict.fromkeys(_advice(reasons, report)))


def _advice(reasons: Iterable[str], report: ChannelReport) -> Iterator[str]:
    vehicle = report.vehicle
    for reason in reasons:
        if reason == "no_rudder" and vehicle is not None:
            yield _no_rudder(vehicle, report)
        elif text := KINDS[reason].to_record(None if vehicle is None else vehicle.autopilot):
            yield text


def _no_rudder(vehicle: VehicleSeen, report: ChannelReport) -> str:
    """Return what would identify the rudder; this depends on what the log holds."""
    message = report.rudder_message
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


def advised(summary: RunSummary) -> RunSummary:
    """Return the summary with the remedy of each reason, and with ``next`` in its verdicts.

    ``next`` is the remedy of the first fatal reason; that of a bare airframe has all remedies.
    """
    flown = len(summary.manoeuvres or ())

    def complete(verdict: Verdict) -> Verdict:
        return with_remedies(verdict, summary.vehicle, flown)

    def warned(bare: Bare | None) -> Bare | None:
        if bare is None or not bare or not bare.verdict.reasons:
            return bare
        verdict = complete(bare.verdict)
        steps = dict.fromkeys(each.remedy for each in verdict.reasons if each.remedy)
        return replace(bare, verdict=replace(verdict, next=" ".join(steps) or None))

    return replace(
        summary,
        verdict=summary.verdict and complete(summary.verdict),
        flight=None
        if summary.flight is None
        else replace(summary.flight, verdict=complete(summary.flight.verdict)),
        flights=summary.flights
        and [replace(each, verdict=complete(each.verdict)) for each in summary.flights],
        manoeuvres=summary.manoeuvres
        and [
            replace(each, verdict=complete(each.verdict), lateral=warned(each.lateral))
            for each in summary.manoeuvres
        ],
        bare=warned(summary.bare),
        ordinary=None
        if summary.ordinary is None
        else replace(summary.ordinary, verdict=complete(summary.ordinary.verdict)),
    )


def with_remedies(verdict: Verdict, vehicle: VehicleSeen | None, flown: int) -> Verdict:
    """Return a verdict on a log with ``flown`` manoeuvres, with the remedy of each reason."""
    reasons = [_cured(each, vehicle, flown) for each in verdict.reasons]
    first = next((each.remedy for each in reasons if each.exit_code), None)
    return replace(verdict, reasons=reasons, next=first)


def _cured(reason: Reason, vehicle: VehicleSeen | None, flown: int) -> Reason:
    """Return a reason with a remedy; one of a kind that a newer version has may have none."""
    kind = KINDS.get(reason.id)
    if reason.remedy is not None or kind is None:
        return reason
    remedy = kind.now
    if flown >= OFTEN:
        remedy = _FLOWN_ENOUGH.get(reason.id, remedy)
    if reason.id in ("rate_too_low", "rate_low") and vehicle is not None:
        remedy = f"Next time {kind.to_record(vehicle.autopilot)}."
    return replace(reason, remedy=remedy)
