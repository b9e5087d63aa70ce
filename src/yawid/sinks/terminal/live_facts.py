"""What a live screen shows, as plain facts: a live session fills them in, a screen draws them."""

from dataclasses import dataclass

from yawid.answers.run_summary import Flight, Manoeuvre


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """Where one vehicle's session stands.

    ``name`` says which vehicle, ``rudder`` and ``yaw`` where these come from, all empty before that
    is known. ``quiet`` says how long nothing has come, ``held`` why no sample is used now;
    both are empty while all is well. Rates are of the last seconds, in Hz.

    ``stroke`` is how far the rudder's own part moved within 5 s, in parts of half its travel, None
    where that is not known; ``rests_s`` how long it has rested. The manoeuvre being recorded began
    at ``from_s`` since boot, None where there is none, and ``is_excited`` once it has moved far
    enough; ``unanswered`` have ended and are being estimated. ``stream`` is the running estimate in
    words, ``state`` in one or two; ``verdict`` is whether the answer may be used, the flight's or
    before that the stream's, None where it is not known, and ``why`` its reasons in words.
    """

    sysid: int = 0
    name: str = ""
    rudder: str = ""
    yaw: str = ""
    quiet: str = ""
    held: str = ""
    message_hz: float = 0.0
    yaw_hz: float = 0.0
    rudder_hz: float = 0.0
    lost: int = 0
    finds: bool = True
    stroke: float | None = None
    rests_s: float = 0.0
    from_s: float | None = None
    lasted_s: float = 0.0
    is_excited: bool = False
    unanswered: int = 0
    manoeuvres: tuple[Manoeuvre, ...] = ()
    flight: Flight | None = None
    stream: str = ""
    state: str = ""
    verdict: bool | None = None
    why: tuple[str, ...] = ()

    @property
    def urgency(self) -> tuple[bool, bool, bool, int]:
        """The key by which what is wrong or under way comes first."""
        return not self.quiet, self.from_s is None, not self.unanswered, self.sysid


@dataclass(frozen=True, slots=True)
class LiveFacts:
    """Where a live run stands: its link and its vehicles.

    ``lasted_s`` is its own age, ``age_s`` that of the last datagram, None before the first;
    ``dropped`` the datagrams dropped here. ``line`` says it all in one line, for a window too small
    for more.
    """

    endpoint: str
    lasted_s: float
    age_s: float | None
    dropped: str
    vehicles: tuple[VehicleFacts, ...]
    line: str
