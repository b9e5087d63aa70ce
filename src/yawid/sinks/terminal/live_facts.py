"""The facts of a live run: its sessions fill them in, a line or a screen shows them."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from yawid.answers.run_summary import Flight, Manoeuvre

FEW: Final = 4
"""Up to this many vehicles stand in the line one by one."""
SILENT: Final = "silent"


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """The state of one vehicle's session.

    ``name`` is the vehicle, ``rudder`` and ``yaw`` the sources of these channels; each is empty
    before it is known. ``label`` begins its line among several. ``quiet`` says for how long nothing
    has come, ``held`` why no sample is used now; both are empty in normal operation. Rates are
    those of the last seconds, in Hz.

    ``stroke`` is how far the rudder's own part moved within 5 s, as a part of half its travel, None
    where that is unknown; ``rests_s`` is how long it has rested. The manoeuvre that is recorded
    began at ``from_s`` since boot (None: there is none) and has lasted ``lasted_s``; ``is_excited``
    is True once the rudder has moved far enough. ``unanswered`` manoeuvres have ended and are being
    estimated; ``finds`` is False where manoeuvres are not looked for. ``samples`` counts samples,
    ``answer`` is the answer now in words, "" before the first estimate, ``stream`` the stream
    in words: its status, and its numbers if they are the answer; ``state`` is its status in one or
    two. ``verdict`` says whether the flight's answer is usable, None before a manoeuvre is
    answered; ``why`` lists its reasons and ``next`` says what to do about the first fatal one.
    """

    sysid: int = 0
    label: str = ""
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
    samples: int = 0
    answer: str = ""
    stream: str = ""
    state: str = ""
    verdict: bool | None = None
    why: tuple[str, ...] = ()
    next: str = ""

    @property
    def urgency(self) -> tuple[bool, bool, bool, int]:
        """A sort key: silent vehicles first, then those that record, then those being estimated."""
        return not self.quiet, self.from_s is None, not self.unanswered, self.sysid

    def line(self, dropped: str) -> str:
        """Return the state in one line, of which a narrow terminal cuts off the least important."""
        if self.quiet == self.state != "":
            return f"{self.label}{self.quiet}, dropped {dropped}"
        parts = [self.quiet or f"{self.message_hz:.0f} msg/s", f"lost {self.lost}"]
        parts += [f"dropped {dropped}", self.answer or "waiting for rudder and yaw rate"]
        parts += [self.state] if self.answer and not self.quiet else []
        return f"{self.label}{', '.join([*parts, f'{self.samples} samples'])}"


@dataclass(frozen=True, slots=True)
class LiveFacts:
    """The state of a live run: its link and its vehicles.

    ``lasted_s`` is how long it has run, ``age_s`` the age of the last datagram, None before the
    first; ``dropped`` is the number of datagrams dropped here, as text; ``to_send`` is what to type
    at the sender.
    """

    endpoint: str
    lasted_s: float
    age_s: float | None
    dropped: str
    vehicles: tuple[VehicleFacts, ...]
    to_send: str = ""

    @property
    def line(self) -> str:
        """The state in one line; more than ``FEW`` vehicles are counted by their state."""
        if len(self.vehicles) <= FEW:
            return " | ".join(each.line(self.dropped) for each in self.vehicles) or "no vehicle yet"
        return f"{self._counts}: {', '.join(self._states())}"

    @property
    def _counts(self) -> str:
        rate, lost = sum(v.message_hz for v in self.vehicles), sum(v.lost for v in self.vehicles)
        counts = f"{rate:.0f} msg/s, lost {lost}, dropped {self.dropped}"
        return f"{len(self.vehicles)} vehicles, {counts}"

    def _states(self) -> Iterator[str]:
        states = Counter(each.state or "waiting" for each in self.vehicles)
        yield from (f"{count} {state}" for state, count in states.most_common())
        silent = [str(each.sysid) for each in self.vehicles if each.state == SILENT]
        if 0 < len(silent) <= FEW:
            yield f"system {' and '.join(silent)} is silent"
