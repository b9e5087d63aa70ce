"""Every reason that can speak against an answer, in one table that all other files read.

From it a reason takes weight, exit code and, where it has no remedy of its own, what to do now;
``yawid inspect`` takes what to record next time, and a replay of a finished run's MCAP which
reasons to judge again.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Final

from msgspec.structs import force_setattr

from yawid.answers.part import Part, says
from yawid.quantities.vehicles import ARDUPILOT, PX4

NOT_IDENTIFIABLE: Final = 5
"""The exit code of an answer that cannot be given, or not be used."""
ASK_HZ: Final = 25
"""The message rate in Hz that advice asks for."""

_FLY = (
    "fly wings level at a steady airspeed and move the rudder left and right by 10 to 30 % of its "
    "travel: ten doublets, or a 3-2-1-1 whose 2 lasts half a Dutch-roll period"
)
_DOUBLETS = ": doublets or a 3-2-1-1 with 10 to 30 % of its travel"
_OWN = "move the rudder by itself, by the pedals while the stick rests" + _DOUBLETS
_OWN_ON = {
    ARDUPILOT: "move the rudder by itself, on ArduPlane with KFF_RDDRMIX = 0 for the manoeuvre or "
    "by the pedals while the stick rests" + _DOUBLETS,
    PX4: "move the rudder by itself, on PX4 with FW_RLL_TO_YAW_FF = 0 for the manoeuvre or by the "
    "pedals in Manual while the stick rests" + _DOUBLETS,
}
PARAMETERS: Final = (
    "download the parameters while recording: they say which output is the rudder and how far it "
    "goes"
)
PARAMETERS_ON: Final = {
    ARDUPILOT: "download the parameters while recording: SERVOn_FUNCTION, _MIN, _TRIM, _MAX and "
    "_REVERSED say which servo is the rudder, and how far it goes",
    PX4: "download the parameters while recording: PWM_MAIN_FUNCn, _MINn, _MAXn and CA_SV_CSi_TYPE "
    "say which output is the rudder, and how far it goes",
}


@dataclass(frozen=True, slots=True)
class ReasonKind:
    """One row of the table of reasons.

    With ``exit_code`` 0 it is a warning; any other code is fatal, unless a :class:`Reason` only
    warns. ``origin`` says what is judged: "run", "log" (link and channels), "samples" or
    "estimate". ``now`` is what to do with this record, ``record`` what to record next time,
    ``record_on`` the same for one autopilot, by MAV_AUTOPILOT. A text is empty where there is
    nothing to do.
    """

    id: str
    exit_code: int
    origin: str
    now: str
    record: str = ""
    record_on: Mapping[int, str] = field(default_factory=dict)

    @property
    def weight(self) -> str:
        """The weight: ``fatal`` if it makes the estimate unusable, else ``warning``."""
        return "fatal" if self.exit_code else "warning"

    def to_record(self, autopilot: int | None) -> str:
        """Return what to record next time on this autopilot."""
        return self.record if autopilot is None else self.record_on.get(autopilot, self.record)


def ask_for(hz: float, autopilot: int | None = None) -> str:
    """Return how to ask an autopilot for attitude and servo outputs at a rate."""
    how = {
        ARDUPILOT: f"SRn_EXTRA1 = {hz:g} and SRn_RC_CHAN = {hz:g} (at most 0.8 of the loop rate)",
        PX4: f"mavlink stream -d DEVICE -s NAME -r {2.0 * hz:g} for each",
    }.get(autopilot or 0, f"MAV_CMD_SET_MESSAGE_INTERVAL with {1e6 / hz:.0f} us")
    return (
        f"ask for ATTITUDE (30) and SERVO_OUTPUT_RAW (36) at {hz:g} Hz or more: {how}; the "
        "on-board log has even higher rates"
    )


_RATES_ANY: Final = ask_for(ASK_HZ)
_RATES_ON: Final = {each: ask_for(ASK_HZ, each) for each in (ARDUPILOT, PX4)}
_TABLE: Final = (
    ReasonKind("interrupted", 130, "run", "Replay the log again, to its end."),
    ReasonKind(
        "no_vehicle", 3, "log", "Record the vehicle's own stream, with its HEARTBEAT.",
        "record the vehicle's own HEARTBEAT: log on the link to the aircraft itself",
    ),
    ReasonKind(
        "no_rudder", 3, "log",
        "Record the servo outputs and the parameters, or name the channel by --rudder.",
    ),
    ReasonKind(
        "no_yaw", 3, "log", f"Ask the vehicle for ATTITUDE at {ASK_HZ} Hz or more.",
        f"ask for ATTITUDE (30) at {ASK_HZ} Hz or more",
    ),
    ReasonKind(
        "rate_too_low", 4, "samples",
        f"Ask for ATTITUDE and the servo outputs at {ASK_HZ} Hz or more and fly again.",
        _RATES_ANY, _RATES_ON,
    ),
    ReasonKind(
        "not_in_command", 5, "log",
        "Use a log whose outputs move surfaces, or name the rudder by --rudder.",
        "record the outputs that really move the surfaces, with the autopilot armed",
    ),
    ReasonKind(
        "not_excited", 5, "samples", "Fly rudder doublets or a 3-2-1-1 in steady level flight.",
        _FLY,
    ),
    ReasonKind(
        "mixed_rudder", 5, "samples",
        "Move the rudder without the aileron: yawid inspect LOG --card says how.", _OWN, _OWN_ON,
    ),
    ReasonKind(
        "collinear_inputs", 5, "samples",
        "Move the rudder without the aileron: yawid inspect LOG --card says how.", _OWN, _OWN_ON,
    ),
    ReasonKind(
        "mode_not_driven", 5, "estimate",
        "Fly rudder doublets that clearly move the nose: yawid inspect LOG --card says how.", _FLY,
    ),
    ReasonKind(
        "not_converged", 5, "estimate",
        "Fly more rudder doublets in calm air, with hands off after each.", _FLY,
    ),
    ReasonKind(
        "poor_fit", 5, "estimate",
        "Choose a calmer stretch by --from and --to, or fly again in calmer air.", _FLY,
    ),
    ReasonKind(
        "manoeuvres_disagree", 5, "estimate",
        "Replay each manoeuvre by itself with --from and --to.",
        _FLY,
    ),
    ReasonKind(
        "ordinary_unknown", 5, "estimate",
        "Fly twelve minutes at one airspeed, with turns of 20 degrees of bank or more.",
    ),
    ReasonKind(
        "rudder_assumed", 0, "log", "Record the parameters too, or name the channel by --rudder.",
        PARAMETERS, PARAMETERS_ON,
    ),
    ReasonKind(
        "unit_assumed", 0, "log",
        "Give the units in the header, by --units, or by --columns 'r=r[rad/s]'.",
        "write the units of the columns into the record: r [rad/s]",
    ),
    ReasonKind(
        "channel_stand_in", 0, "log", "Record the channel itself: another one stands in for it.",
        _RATES_ANY, _RATES_ON,
    ),
    ReasonKind("repeated", 0, "samples", "Replay the log without the part that it holds twice."),
    ReasonKind("disarmed", 0, "log", "Make sure that the logged outputs did move the surfaces."),
    ReasonKind(
        "poorly_known", 0, "estimate",
        "Take wn as a rough value; the mean of more manoeuvres is better known.", _FLY,
    ),
    ReasonKind("saturated", 0, "samples", "Fly again with less rudder: 10 to 30 % of its travel."),
    ReasonKind(
        "not_proportional", 0, "estimate",
        "Fly again with half the rudder, or switch a yaw damper off for the manoeuvre.",
    ),
    ReasonKind(
        "airspeed_changed", 0, "samples",
        "Fly at a steady airspeed, or choose a manoeuvre that was, by --from and --to.",
    ),
    ReasonKind(
        "airspeed_implausible", 0, "samples",
        "Check the airspeed sensor: without its airspeed there is no kappa.",
        "free the pitot tube, calibrate the airspeed (ARSPD_RATIO, ASPD_SCALE) and fly a circle",
    ),
    ReasonKind(
        "wrong_sign", 0, "estimate", "Check the servo's direction, or give the other --rudder-sign."
    ),
    ReasonKind(
        "closed_loop", 0, "samples",
        "Move the surface by hand, or leave such an aileron out of --inputs.",
    ),
    ReasonKind(
        "lag_differs", 0, "estimate",
        "Measure the servo's lag, or leave --servo-lag out: move the aileron on its own.",
    ),
    ReasonKind(
        "airframe_changes", 0, "estimate",
        "Keep flaps and power as they are, or choose a part by --from and --to.",
    ),
    ReasonKind(
        "bare_unknown", 0, "estimate",
        "Move the rudder and then the aileron, each by itself, in calm air; or give --servo-lag.",
    ),
    ReasonKind(
        "ordinary_disagrees", 0, "estimate",
        "Take the manoeuvres' answer, and compare the report's spectra with the model.",
    ),
    ReasonKind("rate_changed", 0, "log", "Choose the rate with --rate."),
    ReasonKind(
        "rate_low", 0, "samples",
        f"Next time ask for ATTITUDE and the servo outputs at {ASK_HZ} Hz or more.",
        _RATES_ANY, _RATES_ON,
    ),
)  # fmt: skip

KINDS: Final[Mapping[str, ReasonKind]] = {kind.id: kind for kind in _TABLE}
"""The kinds of reasons by id: the fatal ones first, in the order in which they decide."""
_RANK: Final = {id_: rank for rank, id_ in enumerate(KINDS)}


class Reason(Part, frozen=True):
    """One reason that speaks against an answer: its id, its text, and what to do about it.

    ``weight`` is ``fatal`` or ``warning``, that of its kind where none is given. ``remedy`` is one
    sentence; where none is given, :func:`yawid.results.advice.advised` adds that of its kind.
    """

    id: Annotated[str, says("which reason: see x-reasons")]
    text: Annotated[str, says("what was found and what is needed, in words")]
    remedy: Annotated[str | None, says("what to do about it, in a sentence")] = None
    weight: Annotated[
        str, says("fatal makes the answer unusable, a warning does not", enum=["fatal", "warning"])
    ] = ""

    def __post_init__(self) -> None:
        """Give it the weight of its kind."""
        if not self.weight:
            force_setattr(self, "weight", KINDS[self.id].weight)

    def __str__(self) -> str:
        """Return the id and the text in one line."""
        return f"{self.id}: {self.text}"

    @property
    def called(self) -> str:
        """The id, with the word in front of it where it is a warning."""
        return self.id if self.weight == "fatal" else f"warning {self.id}"

    @property
    def name(self) -> str:
        """The id in words."""
        return self.id.replace("_", " ")

    @property
    def origin(self) -> str:
        """What is judged: see :class:`ReasonKind`; empty for a kind that a newer version has."""
        kind = KINDS.get(self.id)
        return "" if kind is None else kind.origin

    @property
    def exit_code(self) -> int:
        """The exit code: 0 for a warning, else that of its kind."""
        if self.weight != "fatal":
            return 0
        kind = KINDS.get(self.id)
        return NOT_IDENTIFIABLE if kind is None else kind.exit_code

    @property
    def to_do(self) -> str:
        """Return what to do about it, empty where its text already says it."""
        text = self.remedy or ""
        return "" if text.rstrip(".").lower() in self.text.lower() else text


class Verdict(Part, frozen=True, kw_only=True):
    """Whether an answer is usable, why not, what to do next, and the method that gives it.

    The reasons are in the order of the table, the fatal ones first, then the warnings by id.
    """

    method: Annotated[str | None, says("the method that answers")] = None
    usable: bool
    reasons: Annotated[
        list[Reason],
        says(
            "reasons against the answer and warnings: fatal ones first, the "
            "first decides the exit code"
        ),
    ]
    next: Annotated[
        str | None, says("what to do about the first fatal reason, in one line; absent when usable")
    ] = None

    @staticmethod
    def of(reasons: Iterable[Reason], method: str | None = None) -> "Verdict":
        """Return the verdict with the first reason of each id, a fatal one before a warning."""
        unique: dict[str, Reason] = {}
        for reason in sorted(reasons, key=lambda each: each.weight):
            unique.setdefault(reason.id, reason)
        in_order = sorted(unique.values(), key=_place)
        usable = not any(reason.exit_code for reason in in_order)
        return Verdict(method=method, usable=usable, reasons=in_order)

    def with_reasons(self, more: Iterable[Reason]) -> "Verdict":
        """Return it with further reasons."""
        return Verdict.of([*self.reasons, *more], self.method)

    @property
    def fatal(self) -> list[Reason]:
        """The reasons that make it unusable; the first one decides the exit code."""
        return [reason for reason in self.reasons if reason.exit_code]

    @property
    def why(self) -> str | None:
        """The id of the first fatal reason, None where there is none."""
        return self.fatal[0].id if self.fatal else None

    @property
    def exit_code(self) -> int:
        """The exit code of the first fatal reason, or 0."""
        return self.fatal[0].exit_code if self.fatal else 0

    @property
    def word(self) -> str:
        """Whether the answer is usable, in words; without any reason it was not judged."""
        if self.usable:
            return "usable"
        return "not usable" if self.fatal else "not judged"


def _place(reason: Reason) -> tuple[int, str]:
    fatal = reason.exit_code != 0
    return (_RANK.get(reason.id, len(_RANK)) if fatal else len(_RANK) + 1, reason.id)
