"""The running answer back to the ground station: its frames, their destination, and their limits.

The answer is sent in the vehicle's name (its system id) by a component of its own, in rounds of a
HEARTBEAT and at most five NAMED_VALUE_FLOATs, with STATUSTEXTs between them. The manual says who
sees it.
"""

import errno
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from itertools import product
from typing import Any, Final

from yawid.errors import ConfigError, SourceError
from yawid.sources.link.endpoints import Endpoint, parse_endpoint
from yawid.sources.link.tap import Tap
from yawid.sources.link.udp import open_socket
from yawid.sources.mavlink.signing import EPOCH_S, KEY_SIZE, TICKS_PER_S, SigningKey

WINDOW_S: Final = 10.0
MOST_ROUNDS, MOST_TEXTS = 11, 8
"""The most rounds (171 bytes, 249 signed) and texts (66, 79) in ten seconds, both ends included: a
radio of 57 600 baud keeps 95 % of its bytes for the vehicle's own messages."""
MOST_WAITING = 6
"""The most texts of a system that wait."""
LONGEST_TEXT = 50
"""The longest STATUSTEXT that is sent in a single message."""
NOTICE, INFO = 5, 6
"""Levels of MAV_SEVERITY that ground stations list, but neither speak nor show in red."""
_LARGEST = 3e38  # what fits into a float of four bytes
_MOST_READ, _LONGEST_DATAGRAM = 64, 1 << 16
_HERE = frozenset({"127.0.0.1", "localhost", "::1"})
_ANY = frozenset({"0.0.0.0", "::"})
Way = Callable[[bytes, int], None]
"""Sends a frame in the name of a system without waiting; an OSError means that it is not taken."""
COMPID: Final = 194
"""MAV_COMP_ID_ONBOARD_COMPUTER4, the last of four: other programs use the first ones."""
_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE


class Limiter:
    """The limit of ``most`` events in any ``WINDOW_S`` seconds, both ends included."""

    def __init__(self, most: int) -> None:
        self._times: deque[float] = deque([-math.inf] * most, maxlen=most)

    def admits(self, now_s: float) -> bool:
        """Return whether an event may be now, and count it if so."""
        if now_s - self._times[0] <= WINDOW_S:
            return False
        self._times.append(now_s)
        return True


class OverUdp:
    """The way to a listener (udpout), or to the newest sender to this port (udpin), if any.

    Its socket is closed with ``opened``.

    Raises:
        SourceError: the endpoint cannot be opened.
    """

    def __init__(self, endpoint: Endpoint, opened: ExitStack) -> None:
        self.socket = opened.enter_context(open_socket(endpoint))
        self.socket.setblocking(False)
        self._peer: tuple[str, int] | None = None
        self._is_connected = endpoint.kind == "udpout"

    def __call__(self, frame: bytes, sysid: int) -> None:
        """Send a frame: see ``Way``; a refusal is about an earlier frame, and this one is sent."""
        refusal = None
        for _ in range(_MOST_READ):
            try:
                _, self._peer = self.socket.recvfrom(_LONGEST_DATAGRAM)
            except BlockingIOError:
                break
            except OSError as error:
                refusal = error
        if self._is_connected:
            self.socket.send(frame)
        elif self._peer is not None:
            self.socket.sendto(frame, self._peer)
        if refusal is not None:
            raise refusal


def over_tap(tap: Tap, frame: bytes, sysid: int) -> None:
    """Send a frame back to the source of the vehicle's own frames: see ``Way``."""
    if not tap.transmit(frame, sysid):
        raise OSError(errno.ENOTCONN, f"{tap.endpoint} does not take it")


class Publisher:
    """The sender of rounds and texts over ways by name, within the limits.

    The same frames go over every way. ``news`` has lines about them that have not been reported
    yet.
    """

    def __init__(self, ways: Mapping[str, Way], compid: int, key: SigningKey | None = None) -> None:
        self.names, self.compid = ", ".join(ways), compid
        self.news: deque[str] = deque()
        self.sender_of = senders(compid, key)
        self._ways = dict(ways)
        self._rounds, self._spoken = Limiter(MOST_ROUNDS), Limiter(MOST_TEXTS)
        self._texts: dict[tuple[int, str], tuple[int, str]] = {}
        self._failed: set[str] = set()

    def send_round(
        self, sysid: int, boot_ms: int, values: Mapping[str, float], now_s: float
    ) -> bool:
        """Send a HEARTBEAT and the values by name; return whether the limits allowed it.

        Names have ten characters at most. A value that is not finite is left out: it would stop
        MAVProxy's graph as long as it is shown.
        """
        if not self._rounds.admits(now_s):
            return False
        sender = self.sender_of(sysid)
        make, t_ms = sender.messages.named_value_float_encode, boot_ms & 0xFFFFFFFF
        known = {n: value for n, value in values.items() if abs(value) < _LARGEST}
        messages = (make(t_ms, n.encode("ascii"), value) for n, value in known.items())
        self._send([sender.frame(each) for each in (sender.heartbeat(), *messages)], sysid)
        return True

    def say(self, sysid: int, severity: int, text: str, about: str = "") -> None:
        """Queue a text, to be sent as soon as the limits allow it.

        It replaces a waiting text with the same ``about``. Of the texts without ``about``, the
        newest ``MOST_WAITING`` of each system wait.
        """
        waiting = [key for key in self._texts if key[0] == sysid and key[1].startswith("text ")]
        if not about and len(waiting) >= MOST_WAITING:
            del self._texts[waiting[0]]
        self._texts[sysid, about or f"text {text}"] = severity, text[:LONGEST_TEXT]

    def send_texts(self, now_s: float) -> None:
        """Send the texts that the limits allow, the one that has waited longest first."""
        while self._texts and self._spoken.admits(now_s):
            (sysid, about), (severity, text) = next(iter(self._texts.items()))
            del self._texts[sysid, about]
            sender, said = self.sender_of(sysid), text.encode("ascii", "replace")
            frame = sender.frame(sender.messages.statustext_encode(severity, said))
            self._send([frame], sysid)

    def _send(self, frames: list[bytes], sysid: int) -> None:
        """Send frames, each in a datagram of its own; a way's refusal is reported one time."""
        for name, frame in product(self._ways, frames):
            try:
                self._ways[name](frame, sysid)
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
    endpoint = None
    with suppress(ConfigError):
        endpoint = tapped if text == "tap" else parse_endpoint(text)
    if endpoint == tapped and (text == "tap" or tapped.kind != "udpin"):
        if tapped.kind == "mcast":
            raise ConfigError(f"--publish {text}: a group cannot be answered: write {what}")
        return None
    if endpoint is None or endpoint.kind not in ("udpout", "udpin"):
        raise ConfigError(f"--publish {text} must be {what} or tap (the tap's own link)")
    is_udp = tapped.kind not in ("tcp", "serial")
    hosts = {*_HERE, tapped.host} | (_ANY if tapped.kind != "udpout" else set())
    takes_all = endpoint.kind == "udpin" and tapped.host in _ANY
    if is_udp and endpoint.port == tapped.port and (endpoint.host in hosts or takes_all):
        # One of the two would receive what is meant for the other.
        raise ConfigError(
            f"--publish {text}: the tap itself listens there: write --publish tap or another port"
        )
    return endpoint


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


@contextmanager
def open_publisher(
    texts: Sequence[str], tap: Tap, compid: int = COMPID, key: SigningKey | None = None
) -> Iterator[Publisher]:
    """Yield the open publisher to what each ``--publish`` names, next to this tap; then close it.

    Raises:
        ConfigError: as :func:`parse_all`.
        SourceError: one cannot be opened.
    """
    ways: dict[str, Way] = {}
    with ExitStack() as opened:
        for name, place in parse_all(texts, tap.endpoint).items():
            try:
                ways[name] = partial(over_tap, tap) if place is None else OverUdp(place, opened)
            except SourceError as error:
                raise SourceError(f"--publish {name}: {error}") from error
        yield Publisher(ways, compid, key)


class Outgoing:
    """The sender (sysid, compid) that packs messages into frames.

    Each frame has the next sequence number. With ``key`` it is signed on link 0, with the present
    time in 10 us since 2015; a time stamp is always newer than the one before, even if the clock is
    set back.
    """

    def __init__(self, sysid: int, compid: int, key: SigningKey | None = None) -> None:
        from pymavlink.dialects.v20 import ardupilotmega

        self.messages: Any = ardupilotmega.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        """pymavlink's encoder: ``messages.heartbeat_encode(...)`` and so on."""
        self._key = key
        # pymavlink makes room for a signature; ours replaces the one that it writes.
        self.messages.signing.sign_outgoing = key is not None
        self.messages.signing.secret_key = bytes(KEY_SIZE)

    def heartbeat(self) -> Any:
        """Return the HEARTBEAT of an onboard controller."""
        return self.messages.heartbeat_encode(_ONBOARD_CONTROLLER, _NO_AUTOPILOT, 0, 0, _ACTIVE)

    def frame(self, message: Any) -> bytes:
        """Return the frame of one message, made by ``messages``."""
        signing = self.messages.signing
        # Each stamp is newer than the last, because packing increments it.
        signing.timestamp = max(signing.timestamp, int((time.time() - EPOCH_S) * TICKS_PER_S))
        frame: bytes = bytes(message.pack(self.messages))
        self.messages.seq = (self.messages.seq + 1) % 256
        return frame if self._key is None else self._key.sign(frame)


def senders(compid: int, key: SigningKey | None) -> Callable[[int], Outgoing]:
    """Return a function from a system id to its one sender: two would use the same numbers."""
    return cache(partial(Outgoing, compid=compid, key=key))
