"""The facts that a live screen shows: a live session fills them in, a screen draws them."""

from dataclasses import dataclass

from yawid.answers.run_summary import Flight, Manoeuvre


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """The state of one vehicle's session.

    ``name`` is the vehicle, ``rudder`` and ``yaw`` the sources of these channels; each is empty
    before it is known. ``quiet`` says for how long nothing has come, ``held`` why no sample is used
    now; both are empty in normal operation. Rates are those of the last seconds, in Hz.

    ``stroke`` is how far the rudder's own part moved within 5 s, as a part of half its travel, None
    where that is unknown; ``rests_s`` is how long it has rested. The manoeuvre that is recorded
    began at ``from_s`` since boot (None: there is none) and has lasted ``lasted_s``; ``is_excited``
    is True once the rudder has moved far enough. ``unanswered`` manoeuvres have ended and are being
    estimated; ``finds`` is False where manoeuvres are not looked for. ``stream`` is the stream
    in words: its status, and its numbers if they are the answer; ``state`` is its status in one or
    two. ``verdict`` says whether the flight's answer is usable, None before a manoeuvre is
    answered; ``why`` lists its reasons and ``next`` says what to do about the first fatal one.
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
    flights: tuple[Flight, ...] = ()
    stream: str = ""
    state: str = ""
    verdict: bool | None = None
    why: tuple[str, ...] = ()
    next: str = ""

    @property
    def urgency(self) -> tuple[bool, bool, bool, int]:
        """A sort key: silent vehicles first, then those that record, then those being estimated."""
        return not self.quiet, self.from_s is None, not self.unanswered, self.sysid


@dataclass(frozen=True, slots=True)
class LiveFacts:
    """The state of a live run: its link and its vehicles.

    ``lasted_s`` is how long it has run, ``age_s`` the age of the last datagram, None before the
    first; ``dropped`` is the number of datagrams dropped here, as text. ``line`` is the state in
    one line, for a window too small for more; ``to_send`` is what to type at the sender.
    """

    endpoint: str
    lasted_s: float
    age_s: float | None
    dropped: str
    vehicles: tuple[VehicleFacts, ...]
    line: str
    to_send: str = ""
