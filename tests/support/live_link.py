"""A vehicle's link with real frames, and a live session that listens to it."""

from __future__ import annotations

import io
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from checks.children import free_udp_port
from flightlog import beat, told
from flights.surgery import Encoder
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

from yawid.answers.run_summary import RunSummary
from yawid.config.run import RunConfig
from yawid.errors import YawidError
from yawid.runs.live import Console, Ended, LiveOptions, live
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sources.open_log import ReadOptions

CONFIG = RunConfig(rate=20.0, orders=(2, 2, 1, 1), memory=20.0)
PARAMETERS = {"SERVO4_FUNCTION": 21, "SERVO4_MIN": 1100, "SERVO4_TRIM": 1500, "SERVO4_MAX": 1900}
GROUND = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
BEAT = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(GROUND))
"""The heartbeat of a ground station."""
AT_ONCE = 1000
"""Frames on their way at a time: more than the socket holds would be lost."""
A, B = (1.0, -1.85, 0.9), (0.0, 0.02, 0.01)


def heard(tap: Any, size: int) -> bytes:
    """Return at least so many bytes that a tap receives; fewer if they do not come in time."""
    data, patience = b"", time.monotonic() + 60.0
    while len(data) < size and time.monotonic() < patience:
        data += tap.read(0.2)
    return data


def frames(
    seconds: float,
    sysid: int = 1,
    hz: int = 50,
    first_s: float = 100.0,
    doublet_s: float = 0.0,
    flown: tuple[Any, Any] | None = None,
) -> list[bytes]:
    """Return the frames of a vehicle in so many seconds; its yaw rate responds to the rudder.

    The rudder never rests, or, with ``doublet_s``, makes one doublet at that time. ``flown`` gives
    rudder (n,) in half travels and yaw rate (n,) in rad/s in place of both.
    """
    rng = np.random.default_rng(sysid)
    count = int(seconds * hz)
    moves = np.sign(np.sin(np.arange(count) / hz * 3.0 + rng.normal(0, 1, count)))
    if doublet_s:
        since_s = np.arange(count) / hz - doublet_s
        moves = np.select([since_s < 0.0, since_s < 0.8, since_s < 1.6], [0.0, 1.0, -1.0], 0.0)
    rudder_us = 1500 + 300 * moves
    rate = lfilter(B, A, (rudder_us - 1500) / 400) + rng.normal(0, 0.001, count)
    if flown is not None:
        rudder_us, rate = 1500 + np.round(400 * flown[0]), flown[1]
    messages = [told(name, value, len(PARAMETERS)) for name, value in PARAMETERS.items()]
    heartbeat = beat(base_mode=0x81, mode=5)
    for i in range(count):
        ms = int(1000 * first_s) + i * 1000 // hz
        if i % hz == 0:
            messages.append(heartbeat)
        servos = [1500, 1500, 1000, int(rudder_us[i]), 0, 0, 0, 0]
        messages.append(mavlink.MAVLink_servo_output_raw_message(1000 * ms, 0, *servos))
        messages.append(mavlink.MAVLink_attitude_message(ms, 0.0, 0.0, 0.0, 0.0, 0.0, rate[i]))
    encoder = Encoder()
    return [encoder.frame(message, (sysid, 1)) for message in messages]


def tlog_size(sent: list[bytes]) -> int:
    return sum(8 + len(frame) for frame in sent)


class Screen(io.StringIO):
    """The text that a session prints; a test can wait for a part of it."""

    def __init__(self) -> None:
        super().__init__()
        self._changed = threading.Condition()

    def write(self, text: str) -> int:
        with self._changed:
            written = super().write(text)
            self._changed.notify_all()
        return written

    def wait_for(self, text: str, timeout_s: float = 60.0) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: text in self.getvalue(), timeout_s), (
                f"{text!r} was not said, but ... {self.getvalue()[-500:]!r}"
            )


@dataclass
class Session:
    """A live session in a thread of its own; ``refused`` is the error that ended it, if one did."""

    port: int
    screen: Screen
    folder: Path
    config: RunConfig
    stop: StopFlag = field(default_factory=StopFlag)
    ended: list[Ended] = field(default_factory=list)
    refused: YawidError | None = None
    _sent_bytes: int = 0

    def part(self, suffix: str, name: str = "live") -> Path:
        return self.folder / f"{name}.{suffix}.part"

    def fly(self, sent: list[bytes], own: socket.socket | None = None) -> None:
        """Send frames, no more at a time than a socket holds, and wait until they are recorded."""
        for first in range(0, len(sent), AT_ONCE):
            send(sent[first : first + AT_ONCE], self.port, own)
            self._sent_bytes += tlog_size(sent[first : first + AT_ONCE])
            wait_for_size(self.part("tlog"), self._sent_bytes)

    def lines(self, text: str) -> list[str]:
        """Return what was said with a text in it."""
        return [line for line in self.screen.getvalue().splitlines() if text in line]

    def again(self, name: str = "live") -> RunSummary:
        """Replay a tlog that the session has recorded."""
        outputs = Outputs(self.folder, f"{name}-again")
        return replay(self.folder / f"{name}.tlog", asdict(self.config), outputs, StopFlag())


@contextmanager
def listening(
    folder: Path,
    config: RunConfig = CONFIG,
    outputs: Outputs | None = None,
    line_s: float = 0.2,
    read_options: ReadOptions | None = None,
    *,
    draws: bool = False,
    **options: object,
) -> Iterator[Session]:
    """Run ``live`` until the context ends; ``ended`` has its sessions afterwards."""
    outputs = outputs or Outputs(folder, "live")
    session = Session(free_udp_port(), Screen(), outputs.folder, config)
    asked = LiveOptions(f"udpin:127.0.0.1:{session.port}", seconds=600.0, answers_s=60.0)
    asked = replace(asked, **options)
    console = Console(session.screen, line_s, draws=draws)

    def listen() -> None:
        try:
            session.ended += live(asked, config, outputs, session.stop, console, read_options)
        except YawidError as error:
            session.refused = error

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    try:
        session.screen.wait_for("listening")
        yield session
    finally:
        session.stop.is_set = True
        thread.join(60.0)


def received(link: socket.socket) -> list[bytes]:
    """Return the datagrams that wait at a socket, which does not block from here on."""
    found: list[bytes] = []
    link.setblocking(False)
    try:
        while True:
            found.append(link.recv(2048))
    except BlockingIOError:
        return found


def send(sent: list[bytes], port: int, own: socket.socket | None = None) -> None:
    """Send each frame as a datagram."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as fresh:
        for frame in sent:
            (own or fresh).sendto(frame, ("127.0.0.1", port))


def wait_until(holds: Callable[[], object], every_s: float = 0.02) -> None:
    """Wait for at most a minute until something holds."""
    end_s = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < end_s, "what was waited for has not come"
        time.sleep(every_s)


def wait_for_size(path: Path, size: int) -> None:
    """Wait until a file has grown to a size; it grows as fast as the tap reads."""
    wait_until(lambda: path.exists() and path.stat().st_size >= size)


def mixed(*vehicles: list[bytes]) -> list[bytes]:
    """Return the frames of vehicles in turn, until the first has no more."""
    return list(chain.from_iterable(zip(*vehicles, strict=False)))


SENT = frames(10.0)


def interrupt() -> None:
    """Send SIGINT to the main thread, whatever it is doing."""
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def attend(folder: Path, then: object, ended: threading.Event) -> Screen:
    """Run a session to which SENT is sent; call ``then(stop, screen)`` when it is recorded.

    ``ended`` is set when the session is over.
    """
    port, stop, screen = free_udp_port(), StopFlag(), Screen()

    def vehicle() -> None:
        screen.wait_for("listening")
        send(SENT, port)
        wait_for_size(folder / "live.tlog.part", tlog_size(SENT))
        then(stop, screen)  # type: ignore[operator] # a function of the test

    sender = threading.Thread(target=vehicle, daemon=True)
    sender.start()
    options = LiveOptions(f"udpin:127.0.0.1:{port}", seconds=600.0, answers_s=60.0)
    try:
        live(options, CONFIG, Outputs(folder, "live"), stop, Console(screen))
    finally:
        ended.set()
        sender.join(60.0)
    return screen


def left(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}
