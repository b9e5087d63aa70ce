"""The result of ``yawid inspect``, as ``--json`` prints it; a type for each object."""

from typing import Annotated, Final

from msgspec import field

from yawid.answers.flight_test_card import FlightTestCard
from yawid.answers.part import Part, named, says
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Flight, Judged, Manoeuvre, Origin

OF_SENDER: Final = named(
    "frames",
    "lost",
    "bad_crc",
    "unknown",
    duplicates="frames received twice",
    rejected="frames rejected because they are not signed with the key",
)
"""The counts of a sender."""


class MessageRate(Part, frozen=True):
    """The number of messages, their rate, and the percentiles of their intervals."""

    messages: Annotated[int, says("how many were received")]
    rate_hz: Annotated[float, says("messages a second over the whole log", "Hz")]
    interval_median_s: Annotated[float, says("median of their intervals", "s")]
    interval_p5_s: Annotated[float, says("5th percentile of their intervals", "s")]
    interval_p95_s: Annotated[float, says("95th percentile of their intervals", "s")]


class Answerable(Part, frozen=True):
    """The fastest Dutch roll that the message rates allow at all, and the fastest allowed well."""

    wn_max_rad_s: Annotated[float, says("at all", "rad/s")]
    wn_well_rad_s: Annotated[float, says("well", "rad/s")]


class Can(Part, frozen=True):
    """Whether a log gives an answer, and what it lacks for it: found, needed, and what to do."""

    yes: Annotated[bool, says("whether it does; before a fit, whether nothing speaks against it")]
    lacks: Annotated[list[str], says("what is missing for it and what to do, in sentences")]


class Span(Part, frozen=True):
    """A stretch of a boot, in s since that boot."""

    boot: int | None
    from_s: Annotated[float, says("first second, since boot", "s")] = field(name="from")
    to_s: Annotated[float, says("last second, since boot", "s")] = field(name="to")


class FlightPhase(Span, frozen=True):
    """A stretch in one flight mode and one state, such as airborne or on the ground."""

    mode: str | None = None
    state: Annotated[
        str | None, says("airborne, on ground, or slow", enum=["airborne", "on ground", "slow"])
    ] = None


class Inspection(Origin, Judged, frozen=True, kw_only=True):
    """What a log can answer, and its frames by sender (``sysid/compid``).

    ``unchecked`` is a note on signed frames that were not checked. ``excited`` has the stretches in
    which the rudder moved on its own. ``manoeuvres``, ``flight``, ``flights``, ``verdict`` and
    ``warnings`` are those of a replay with the options asked for, which ``command`` is. ``can``
    says what the log gives, by an answer that is there or by what is known before any fit.
    ``record`` says what to record next time; ``card`` says what to fly, if asked for.
    """

    senders: Annotated[
        dict[str, int],
        says(
            "intact frames of each sender, by sysid/compid", propertyNames={"pattern": r"^\d+/\d+$"}
        ),
    ]
    by_sender: Annotated[
        dict[str, Annotated[dict[str, int], says(**OF_SENDER)]],
        says(
            "counts of each sender's frames, by sysid/compid",
            propertyNames={"pattern": r"^\d+/\d+$"},
        ),
    ]
    unchecked: Annotated[
        str | None, says("that frames are signed but signatures were not checked, in words")
    ] = None
    rates: Annotated[
        dict[str, MessageRate],
        says(
            "messages of both channels on the vehicle's clock",
            **named(yaw="of the yaw rate", rudder="of the rudder"),
        ),
    ]
    answerable: Annotated[
        Answerable | None, says("the fastest Dutch roll that both rates can answer")
    ] = None
    phases: Annotated[list[FlightPhase] | None, says("stretches of one flight mode and state")] = (
        None
    )
    excited: Annotated[list[Span], says("where the rudder moved by itself")]
    manoeuvres: Annotated[
        list[Manoeuvre] | None, says("each with its answer; absent where they were not looked for")
    ] = None
    flight: Annotated[
        Flight | None,
        says("what the manoeuvres say together, the headline; absent where there was none"),
    ] = None
    flights: Annotated[
        list[Flight] | None,
        says(
            "for each loop with a usable manoeuvre what its manoeuvres say together, flight first"
        ),
    ] = None
    can: Annotated[
        dict[str, Can] | None,
        says(
            "what the log can give, a row each, and what it lacks for it",
            **named(
                flown="the aircraft as it was flown, by its manoeuvres",
                bare="the same without its autopilot",
                ordinary="its mode, from flight without a manoeuvre",
                damper="advice on the yaw damper's gain",
            ),
        ),
    ] = None
    record: Annotated[list[str] | None, says("what to record next time, in words")] = None
    command: Annotated[str | None, says("the replay that has this verdict, for a shell")] = None
    card: Annotated[
        FlightTestCard | None,
        says("what to fly next, if asked for by --card; absent for what has no rudder"),
    ] = None
    verdict: Annotated[
        Verdict | None,
        says("the flight's, or why the log has no answer; absent where nothing was judged"),
    ] = None
    warnings: Annotated[
        list[Reason] | None, says("reasons found in link and channels where nothing was judged")
    ] = None
