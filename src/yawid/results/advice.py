"""Advice about a log without a usable answer: what to do now, and what to record next time."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from yawid.answers.channel_report import ChannelReport
from yawid.answers.heard import VehicleSeen
from yawid.answers.run_summary import Bare, ReasonSummary, RunSummary, VerdictSummary
from yawid.quantities.vehicles import ARDUPILOT, WITHOUT_RUDDER
from yawid.results.reasons import ASK_HZ, COPIES, KINDS, PARAMETERS, PARAMETERS_ON

OFTEN = 3
"""With this many manoeuvres, more of the same are no longer advised."""
_LONG_S = 60.0
"""The rudder moved long enough where the estimator learnt from this many seconds."""
_NOT_MOVED = COPIES | {"not_excited"}
_FLOWN_ENOUGH = {
    "not_converged": "The rudder moved enough: choose calmer air or a steadier airspeed by --from "
    "and --to, or compare orders with yawid orders.",
    "mode_not_driven": "The rudder moved enough: use --band to keep what it drives, or choose the "
    "calmest stretch by --from and --to.",
}
_BY_TEXT = {
    ("mode_not_driven", "damper"): "Switch the yaw damper off for the manoeuvre (ArduPlane: "
    "YAW2SRV_DAMP = 0).",
    ("mode_not_driven", "does not belong to"): "Check the rudder's channel (--rudder) and that "
    "its times are those of the yaw rate.",
    ("not_converged", "periods of the Dutch roll"): "Choose a longer stretch, or fly longer "
    "manoeuvres.",
    ("mode_not_driven", "follows the yaw rate"): "Move the rudder by itself, in straight flight, "
    "and check --rudder-sign.",
    ("wrong_sign", "this record"): "Give the other --rudder-sign.",
    ("wrong_sign", "a positive aileron"): "Check the aileron's servo, and SERVOn_REVERSED of the "
    "output that moves it.",
    ("poor_fit", "clocks"): "Check that rudder and yaw rate have the same clock; if not, shift "
    "one of them in the record.",
    ("poor_fit", "--turn remove"): "Replay it with --turn remove.",
    ("poor_fit", "is rounded to"): "Record the rudder in finer steps.",
}
"""Advice that depends on which finding a reason's text (its words are the key) states."""


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


@dataclass(frozen=True, slots=True)
class Situation:
    """The facts on which the advice about a reason depends.

    ``moved_enough`` is True where the rudder moved by itself in several manoeuvres or, without
    any, for long: then more of the same is no advice.
    """

    vehicle: VehicleSeen | None
    has_flight: bool
    moved_enough: bool

    @staticmethod
    def of(summary: RunSummary) -> "Situation":
        """Return the situation of a run."""
        has_flight = summary.flight is not None
        return Situation(summary.vehicle, has_flight, _moved_enough(summary))


def advised(summary: RunSummary) -> RunSummary:
    """Return the summary with ``next`` in each verdict that needs it.

    Those are all that are not usable, and that of a bare airframe with warnings.
    """
    situation = Situation.of(summary)

    def complete(verdict: VerdictSummary) -> VerdictSummary:
        return replace(verdict, next=next_step(verdict.reasons, situation))

    def warned(bare: Bare | None) -> Bare | None:
        if bare is None or not bare or not (said := bare.verdict.reasons):
            return bare
        steps = dict.fromkeys(remedy(each, said, situation) for each in said)
        return replace(bare, verdict=replace(bare.verdict, next=" ".join(steps)))

    flight, flights, manoeuvres = summary.flight, summary.flights, summary.manoeuvres
    if flight is not None:
        flight = replace(flight, verdict=complete(flight.verdict))
    if flights is not None:
        flights = [replace(each, verdict=complete(each.verdict)) for each in flights]
    if manoeuvres is not None:
        manoeuvres = [
            replace(each, verdict=complete(each.verdict), lateral=warned(each.lateral))
            for each in manoeuvres
        ]
    return replace(
        summary, verdict=complete(summary.verdict), flight=flight, flights=flights,
        manoeuvres=manoeuvres, bare=warned(summary.bare),
    )  # fmt: skip


def next_step(reasons: Sequence[ReasonSummary], situation: Situation) -> str | None:
    """Return what to do about the first fatal reason; None where there is none."""
    first = next((reason for reason in reasons if reason.weight == "fatal"), None)
    return None if first is None else remedy(first, reasons, situation) or None


def to_do(reason: ReasonSummary, summary: RunSummary) -> str:
    """Return what to do now about a reason of the verdict that decides, in one sentence.

    It is empty where there is nothing to do, or where the reason's own text already says it.
    """
    text = remedy(reason, summary.deciding.reasons, Situation.of(summary))
    return "" if text.rstrip(".").lower() in reason.text.lower() else text


def remedy(reason: ReasonSummary, reasons: Sequence[ReasonSummary], situation: Situation) -> str:
    """Return what to do now about one of a verdict's reasons, in one sentence.

    It fits the vehicle and the record, and contradicts no other reason of the verdict. It is empty
    for a reason that a newer version wrote.
    """
    kind, vehicle = KINDS.get(reason.id), situation.vehicle
    if kind is None:
        return ""
    autopilot = None if vehicle is None else vehicle.autopilot
    if reason.id == "no_rudder" and vehicle is not None:
        if vehicle.type in WITHOUT_RUDDER:
            return "Use a log of an aircraft that has a rudder."
        if "functions" in reason.text:
            return "If one of these outputs does move a rudder, name it: --rudder servo:N."
    if reason.id == "turn_dominated" and not COPIES.isdisjoint(each.id for each in reasons):
        return "Choose a stretch of straight flight by --from and --to."
    for (id_, words), advice in _BY_TEXT.items():
        if reason.id == id_ and words in reason.text:
            return advice
    if reason.id == "airspeed_changed" and situation.has_flight:
        return "Fly at a steady airspeed, or choose a manoeuvre that was, by --from and --to."
    if reason.id in ("rate_too_low", "rate_low") and autopilot in kind.record_on:
        how = kind.to_record(autopilot)
        return f"Next time {how}."
    if reason.id in _FLOWN_ENOUGH and situation.moved_enough:
        return _FLOWN_ENOUGH[reason.id]
    return kind.now


def _moved_enough(summary: RunSummary) -> bool:
    """Return whether the rudder moved by itself in several manoeuvres or, without any, for long."""
    if summary.manoeuvres:
        return len(summary.manoeuvres) >= OFTEN
    answer, against = summary.answer, {each.id for each in summary.verdict.reasons}
    learnt_s = 0.0 if answer is None else (answer.updates or 0) * answer.sample_time_s
    return learnt_s >= _LONG_S and not against & _NOT_MOVED
