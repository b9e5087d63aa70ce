"""What ``yawid inspect`` finds, as ``--json`` prints it: one type for each object."""

from typing import Any

from msgspec import field

from yawid.answers.flight_test_card import FlightTestCard
from yawid.answers.run_summary import Flight, Manoeuvre, Origin, Part, VerdictSummary


class MessageRate(Part, frozen=True):
    """How many messages came, how often, and the percentiles of their intervals."""

    messages: int
    rate_hz: float
    interval_median_s: float
    interval_p5_s: float
    interval_p95_s: float


class Answerable(Part, frozen=True):
    """The fastest Dutch roll that the rates can answer at all, and well."""

    wn_max_rad_s: float
    wn_well_rad_s: float


class Span(Part, frozen=True):
    """A stretch of a boot, in seconds since it."""

    boot: int | None
    from_s: float = field(name="from")
    to_s: float = field(name="to")


class FlightPhase(Span, frozen=True):
    """A stretch in one flight mode, airborne, slow or on the ground."""

    mode: str | None = None
    state: str | None = None


class Inspection(Origin, frozen=True, kw_only=True):
    """What a log can answer; frames of each sender (``sysid/compid``), and what came of them.

    ``unchecked`` says that frames are signed and nobody checks them, ``excited`` where the rudder
    moved on its own, ``manoeuvres`` and ``flight`` what a replay as asked for says, ``recommend``
    the options of a replay and what to ``record`` next time, ``card`` what to fly, if asked for.
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
    recommend: dict[str, Any]
    command: str | None = None
    card: FlightTestCard | None = None
    verdict: VerdictSummary
