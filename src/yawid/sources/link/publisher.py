"""The running answer back to the ground station: its frames, their destination, and their limits.

The answer is sent in the vehicle's name (its system id) by a component of its own, in rounds of a
HEARTBEAT and NAMED_VALUE_FLOATs, with STATUSTEXTs between them.

Who sees it depends on where it arrives:

- At an ``--out`` of MAVProxy, it goes on to the vehicle, which logs it; MAVProxy itself shows
  nothing of it. A router passes it to everybody.
- MAVProxy's graph only knows the messages of its first link: there the answer must arrive at the
  UDP port of that link, next to the vehicle's own frames.
- On a link of its own, it is only in MAVProxy's ``status`` and ``watch``. Commands of ground
  stations behind MAVProxy then go to the link on which the newest HEARTBEAT of that system arrived;
  ``set mavfwd_link 1`` keeps them on the first one.

MAVProxy shows texts of a component other than the autopilot after ``set target_component 0``.
"""

import errno
import math
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import product
from typing import Protocol

from yawid.errors import ConfigError, SourceError
from yawid.sources.link.endpoints import Endpoint, parse_endpoint
from yawid.sources.link.outgoing import COMPID, senders
from yawid.sources.link.tap import Tap
from yawid.sources.link.udp import open_socket
from yawid.sources.mavlink.signing import SigningKey

WINDOW_S = 10.0
MOST_BYTES, MOST_SIGNED_BYTES = 2500, 3500
"""The most bytes sent in any ten seconds, without and with signatures."""
TEXT_BYTES, TEXT_SIGNED_BYTES = 600, 660
"""The part of them that texts may take; rounds, 12 at most in ten seconds, have the rest."""
MOST_WAITING = 6
"""The most texts of a system that wait."""
LONGEST_TEXT = 50
"""The longest STATUSTEXT that is sent in a single message."""
TAP = "tap"
NOTICE, INFO = 5, 6
"""Levels of MAV_SEVERITY that ground stations list, but neither speak nor show in red."""
_LARGEST = 3e38  # what fits into a float of four bytes
_MOST_READ, _LONGEST_DATAGRAM = 64, 1 << 16
_HERE = frozenset({"127.0.0.1", "localhost", "::1"})
_ANY = frozenset({"0.0.0.0", "::"})


class Limiter:
    """The limit of ``most`` bytes in any ``WINDOW_S`` seconds, both ends included."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._sent: deque[tuple[float, int]] = deque()
        self._bytes = 0

    def admits(self, size: int, now_s: float) -> bool:
        """Return whether ``size`` bytes may be sent now."""
        while self._sent and now_s - self._sent[0][0] > WINDOW_S:
            self._bytes -= self._sent.popleft()[1]
        return self._bytes + size <= self._most

    def count(self, size: int, now_s: float) -> None:
        """Count bytes that are sent now."""
        self._sent.append((now_s, size))
        self._bytes += size


class Way(Protocol):
    """A destination of frames; sending never waits."""

    def send(self, frame: bytes, sysid: int) -> None:
        """Send a frame in the name of a system; an OSError means that it is not accepted."""

    def close(self) -> None:
        """Close what was opened."""


class BackOverTap:
    """The way back to the source of the vehicle's own frames, over the tap's socket or line."""

    def __init__(self, tap: Tap) -> None:
        self._tap = tap

    def send(self, frame: bytes, sysid: int) -> None:
        """Send a frame: see :class:`Way`."""
        if not self._tap.transmit(frame, sysid):
            raise OSError(errno.ENOTCONN, f"{self._tap.endpoint} does not take it")

    def close(self) -> None:
        """Do nothing: the tap is closed by its owner."""


class OverUdp:
    """The way to a listener (udpout), or to the newest sender to this port (udpin), if any.

    Raises:
        SourceError: the endpoint cannot be opened.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        self._socket = open_socket(endpoint)
        self._socket.setblocking(False)
        self._answers = endpoint.kind == "udpin"
        self._peer: tuple[str, int] | None = None

    def send(self, frame: bytes, sysid: int) -> None:
        """Send a frame: see :class:`Way`."""
        refusal = self._read()
        if not self._answers:
            self._socket.send(frame)
        elif self._peer is not None:
            self._socket.sendto(frame, self._peer)
        if refusal is not None:  # it is about an earlier frame; this one was sent
            raise refusal

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _read(self) -> OSError | None:
        """Read what a ground station sends, for its address; return its refusal, if any."""
        refusal = None
        for _ in range(_MOST_READ):
            try:
                _, self._peer = self._socket.recvfrom(_LONGEST_DATAGRAM)
            except BlockingIOError:
                break
            except OSError as error:
                refusal = error
        return refusal


class Publisher:
    """The sender of rounds and texts over ways by name, each within the limits of bytes.

    The same frames go over every way. ``news`` has lines about them that have not been reported
    yet.
    """

    def __init__(self, ways: Mapping[str, Way], compid: int, key: SigningKey | None = None) -> None:
        self.names = ", ".join(ways)
        self.compid = compid
        self.news: deque[str] = deque()
        self._ways = dict(ways)
        self.sender_of = senders(compid, key)
        signed = key is not None
        self._all = Limiter(MOST_SIGNED_BYTES if signed else MOST_BYTES)
        self._of_texts = Limiter(TEXT_SIGNED_BYTES if signed else TEXT_BYTES)
        self._texts: dict[tuple[int, str], tuple[int, str]] = {}
        self._said = 0
        self._failed: set[str] = set()

    def send_round(
        self, sysid: int, boot_ms: int, values: Mapping[str, float], now_s: float
    ) -> bool:
        """Send a HEARTBEAT and the values by name; return whether the limits allowed it.

        Names have ten characters at most. A value that is not finite is left out: it would stop
        MAVProxy's graph as long as it is shown.
        """
        sender = self.sender_of(sysid)
        make = sender.messages
        messages = [sender.heartbeat()]
        for name, value in values.items():
            if math.isfinite(value) and abs(value) < _LARGEST:
                text = name.encode("ascii")
                messages.append(make.named_value_float_encode(boot_ms & 0xFFFFFFFF, text, value))
        frames = [sender.frame(message) for message in messages]
        size = sum(map(len, frames))
        if not self._all.admits(size, now_s):
            make.seq = (make.seq - len(frames)) % 256  # they must not count as lost
            return False
        self._all.count(size, now_s)
        self._send(frames, sysid)
        return True

    def say(self, sysid: int, severity: int, text: str, about: str = "") -> None:
        """Queue a text, to be sent as soon as the limits allow it.

        It replaces a waiting text with the same ``about``. Of the texts without ``about``, the
        newest ``MOST_WAITING`` of each system wait.
        """
        if not about:
            waiting = [key for key in self._texts if key[0] == sysid and key[1].isdecimal()]
            if len(waiting) >= MOST_WAITING:
                del self._texts[waiting[0]]
            self._said += 1
        self._texts[sysid, about or str(self._said)] = severity, text[:LONGEST_TEXT]

    def send_texts(self, now_s: float) -> None:
        """Send the texts that the limits allow, the one that has waited longest first."""
        while self._texts:
            (sysid, about), (severity, text) = next(iter(self._texts.items()))
            sender = self.sender_of(sysid)
            frame = sender.frame(
                sender.messages.statustext_encode(severity, text.encode("ascii", "replace"))
            )
            size = len(frame)
            if not (self._of_texts.admits(size, now_s) and self._all.admits(size, now_s)):
                sender.messages.seq = (sender.messages.seq - 1) % 256
                return
            del self._texts[sysid, about]
            self._of_texts.count(size, now_s)
            self._all.count(size, now_s)
            self._send([frame], sysid)

    def close(self) -> None:
        """Close what was opened."""
        for way in self._ways.values():
            way.close()

    def _send(self, frames: list[bytes], sysid: int) -> None:
        """Send frames, each in a datagram of its own; a way's refusal is reported one time."""
        for name, frame in product(self._ways, frames):
            try:
                self._ways[name].send(frame, sysid)
            except OSError as error:
                if name not in self._failed:
                    self._failed.add(name)
                    self.news.append(
                        f"nothing receives what is published to {name} "
                        f"({error.strerror or error}): publishing goes on"
                    )


def parse_publish(text: str, tapped: Endpoint) -> Endpoint | None:
    """Return where to publish; None means back over the tap.

    Raises:
        ConfigError: it is no place to publish to; the message gives the right spellings.
    """
    what = "udpout:HOST:PORT (a ground station listens there), udpin:HOST:PORT (it sends there)"
    try:
        endpoint = None if text == TAP else parse_endpoint(text)
    except ConfigError as error:
        raise ConfigError(f"--publish {text} must be {what} or tap (the tap's own link)") from error
    is_own_link = endpoint == tapped and tapped.kind != "udpin"
    if endpoint is None or is_own_link:
        if tapped.kind == "mcast":
            raise ConfigError(f"--publish {text}: a group cannot be answered: write {what}")
        return None
    if endpoint.kind not in ("udpout", "udpin"):
        raise ConfigError(f"--publish {text} must be {what} or tap (the tap's own link)")
    if _is_at_tap(endpoint, tapped):
        raise ConfigError(
            f"--publish {text}: the tap itself listens there: write --publish tap or another port"
        )
    return endpoint


def _is_at_tap(endpoint: Endpoint, tapped: Endpoint) -> bool:
    """Return whether one of the two would receive what is meant for the other."""
    if tapped.kind in ("tcp", "serial") or endpoint.port != tapped.port:
        return False
    if endpoint.host in {*_HERE, tapped.host}:
        return True
    listens = tapped.kind != "udpout"
    return listens and (endpoint.host in _ANY or (endpoint.kind == "udpin" and tapped.host in _ANY))


def parse_all(texts: Sequence[str], tapped: Endpoint) -> dict[str, Endpoint | None]:
    """Return by name where to publish, as :func:`parse_publish` of each text.

    Raises:
        ConfigError: one is no place to publish to, or two are the same.
    """
    places: dict[str, Endpoint | None] = {}
    for text in texts:
        place = parse_publish(text, tapped)
        name = str(place or tapped)
        if name in places:
            raise ConfigError(f"--publish {text}: {name} is given twice: give it once")
        places[name] = place
    return places


def open_publisher(
    texts: Sequence[str], tap: Tap, compid: int = COMPID, key: SigningKey | None = None
) -> Publisher:
    """Return the open publisher to what each ``--publish`` names, next to this tap.

    Raises:
        ConfigError: as :func:`parse_all`.
        SourceError: one cannot be opened.
    """
    ways: dict[str, Way] = {}
    with ExitStack() as opened:
        for name, place in parse_all(texts, tap.endpoint).items():
            try:
                ways[name] = BackOverTap(tap) if place is None else OverUdp(place)
            except SourceError as error:
                raise SourceError(f"--publish {name}: {error}") from error
            opened.callback(ways[name].close)
        opened.pop_all()
    return Publisher(ways, compid, key)
