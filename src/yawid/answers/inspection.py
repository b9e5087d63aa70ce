"""The result of ``yawid inspect``, as ``--json`` prints it; a type for each object."""

from msgspec import field

from yawid.answers.flight_test_card import FlightTestCard
from yawid.answers.part import Part
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Flight, Judged, Manoeuvre, Origin


class MessageRate(Part, frozen=True):
    """The number of messages, their rate, and the percentiles of their intervals."""

    messages: int
    rate_hz: float
    interval_median_s: float
    interval_p5_s: float
    interval_p95_s: float


class Answerable(Part, frozen=True):
    """The fastest Dutch roll that the message rates allow at all, and the fastest allowed well."""

    wn_max_rad_s: float
    wn_well_rad_s: float


class Can(Part, frozen=True):
    """Whether the log gives an answer, and in words what it lacks for it."""

    yes: bool
    lacks: list[str]


class Span(Part, frozen=True):
    """A stretch of a boot, in s since that boot."""

    boot: int | None
    from_s: float = field(name="from")
    to_s: float = field(name="to")


class FlightPhase(Span, frozen=True):
    """A stretch in one flight mode and one state, such as airborne or on the ground."""

    mode: str | None = None
    state: str | None = None


class Inspection(Origin, Judged, frozen=True, kw_only=True):
    """What a log can answer, and its frames by sender (``sysid/compid``).

    ``unchecked`` is a note on signed frames that were not checked. ``excited`` has the stretches in
    which the rudder moved on its own. ``manoeuvres``, ``flight``, ``flights``, ``verdict`` and
    ``warnings`` are those of a replay with the options asked for, which ``command`` is. ``can``
    says whether ordinary flight is answered, too, if that is asked for. ``record`` says what to
    record next time; ``card`` says what to fly, if asked for.
    """

    senders: dict[str, int]
    by_sender: dict[str, dict[str, int]]
    unchecked: str | None = None
    rates: dict[str, MessageRate]
    answerable: Answerable | None = None
    phases: list[FlightPhase] | None = None
    excited: list[Span]
    manoeuvres: list[Manoeuvre] | None = None
    flight: Flight | None = None
    flights: list[Flight] | None = None
    can: dict[str, Can] | None = None
    record: list[str] | None = None
    command: str | None = None
    card: FlightTestCard | None = None
    verdict: Verdict | None = None
    warnings: list[Reason] | None = None
