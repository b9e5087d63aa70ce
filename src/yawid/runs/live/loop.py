"""The loop of ``yawid live``: read, record, estimate, and report events on the link."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial

from yawid.answers.session import LiveFacts
from yawid.config.run import RunConfig
from yawid.errors import ConfigError, SinkError, SourceError
from yawid.estimation.machine.runner import RUNNER
from yawid.runs.live.bulkhead import Bulkhead
from yawid.runs.live.overload import Overload
from yawid.runs.live.publish import Publish
from yawid.runs.live.vehicle_session import MOST_EVENTS, Ended, Setting
from yawid.runs.live.vehicles import Fleet, Single
from yawid.runs.live.worker import FitWorker, SharedDisk, WorkThread
from yawid.runs.outputs import Outputs
from yawid.runs.stop import StopFlag
from yawid.sinks.terminal.console import Console
from yawid.sinks.terminal.console import LiveFacts as ScreenFacts
from yawid.sources.link.endpoints import Endpoint, parse_endpoint
from yawid.sources.link.inbox import Stamps
from yawid.sources.link.publisher import COMPID, open_publisher, parse_all
from yawid.sources.link.rate_requests import SYSID, RateRequests
from yawid.sources.link.tap import BATCH_S, Tap
from yawid.sources.link.tcp_serial import StreamTap
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions
from yawid.system.part_file import os_errors_as_sink_error

READ_S = 0.2
ANSWERS_S = 2.0
"""How long a stop waits for answers: all files of six vehicles are finished within 3 s of it."""
SILENT_US = 5_000_000
LAST_READ_US = 1_000_000
"""If reading is less than this behind the link at a stop, all that has arrived is still read."""
SWITCH_S = 0.001
"""How long a fit in another thread may hold the interpreter before the loop gets it.

With 1 ms the latency of the stream's estimates is the same while a fit runs; with Python's usual
5 ms it is visibly longer.
"""
LOAD, LOAD_WITH_FITS, LONGEST_PAUSE_S = 1 / 3, 1 / 8, 0.5
"""The part of the time that the loop may take, alone and while fits wait, and the longest pause.

A loop that needs more reads less often, with pauses up to the longest. A block takes nearly the
same time for two samples of a vehicle as for ten: many vehicles are therefore estimated in larger
blocks, which leaves time for their fits.
"""


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """The options of a live run that are not in its configuration and outputs.

    ``seconds`` None: the run lasts until it is stopped. ``request_hz`` None: no rate is requested.
    ``every_vehicle``: each vehicle has its own session, ``MOST_VEHICLES`` at most.
    ``publish`` has where to send the answer; where it is empty, no answer is ever sent.
    ``answers_s`` is how long a stop waits for the answers of manoeuvres.

    Raises:
        ConfigError: a value is outside its limits, or two options exclude each other.
    """

    endpoint: str
    seconds: float | None = None
    request_hz: float | None = None
    every_vehicle: bool = False
    publish: tuple[str, ...] = ()
    answers_s: float = ANSWERS_S

    @property
    def may_transmit(self) -> bool:
        """Whether anything is ever sent on the link that the tap listens to."""
        places = parse_all(self.publish, parse_endpoint(self.endpoint))
        return None in places.values() or self.request_hz is not None

    def __post_init__(self) -> None:
        if self.seconds is not None and not self.seconds > 0.0:
            raise ConfigError(f"--seconds must be > 0, got {self.seconds!r}")
        if self.request_hz is not None and not 0.1 <= self.request_hz <= 1000.0:
            raise ConfigError(f"--request-rates must be 0.1 to 1000 Hz, got {self.request_hz!r}")
        if self.request_hz is not None and self.every_vehicle:
            raise ConfigError("--request-rates asks one vehicle only: name it by --sysid N")
        endpoint = parse_endpoint(self.endpoint)
        parse_all(self.publish, endpoint)
        if endpoint.kind == "udpout" and self.request_hz is None:
            raise ConfigError(
                f"{self.endpoint}: a program that listens there answers only those who send first, "
                "and a tap is passive: add --request-rates, or let the program send to a udpin "
                "endpoint of yours"
            )


def live(
    options: LiveOptions,
    config: RunConfig,
    outputs: Outputs,
    stop: StopFlag,
    console: Console,
    read_options: ReadOptions | None = None,
) -> list[Ended]:
    """Listen on a link until asked to stop; return the result of each vehicle's session.

    Raises:
        ConfigError: the rate asked for is too high.
        SourceError: the endpoint cannot be opened.
        SinkError: the folder cannot be made.
    """
    endpoint, stamps = parse_endpoint(options.endpoint), Stamps()
    with os_errors_as_sink_error(outputs.folder):
        outputs.folder.mkdir(parents=True, exist_ok=True)
    read_options = read_options or ReadOptions()
    fits, disk = FitWorker("yawid-manoeuvres", console.say), WorkThread("yawid-disk")
    lateral = WorkThread("yawid-lateral") if config.keeps_motion else None
    viewers = WorkThread("yawid-viewers") if outputs.has_viewer else None
    switch_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    try:
        # The tap comes first: it queues what arrives while a viewer is being opened.
        key = read_options.key
        with open_tap(endpoint, stamps, may_transmit=options.may_transmit, key=key) as tap:
            RUNNER.compile_behind()
            setting = Setting(
                options.endpoint, config, outputs, read_options, console.say,
                stamps.now, tap.reached_us, fits, SharedDisk(disk), viewers, lateral,
            )  # fmt: skip
            with _publishing(tap, setting, options) as publish:
                return _attend(tap, setting, options, stop, console, publish)
    finally:
        sys.setswitchinterval(switch_s)
        for worker in (fits, lateral, disk, viewers):
            if worker is not None:
                worker.shutdown()
        console.close()


def _attend(
    tap: Tap,
    setting: Setting,
    options: LiveOptions,
    stop: StopFlag,
    console: Console,
    publish: Publish | None,
) -> list[Ended]:
    """Read the tap until asked to stop, close it and finish; after an error files stay readable."""
    sessions = (Fleet if options.every_vehicle else Single)(setting)
    try:
        loop = _Loop(tap, sessions, setting, options, console, publish)
        loop.run(stop)
        console.close()  # from here on lines are printed; a second Ctrl-C ends the program at once
        tap.close()
        return loop.finish()
    except ConfigError as error:
        kept = [tlog for session in sessions.running() if (tlog := session.give_up())]
        recorded = f"; what was recorded is in {kept[0]}" if kept else ""
        raise ConfigError(f"{error}{recorded}") from error
    except BaseException:
        for session in sessions.running():
            session.abort()
        raise


@contextmanager
def _publishing(tap: Tap, setting: Setting, options: LiveOptions) -> Iterator[Publish | None]:
    """Open the publisher of answers, if ``--publish`` asks for one."""
    if not options.publish:
        yield None
        return
    key = setting.read_options.key
    with open_publisher(options.publish, tap, COMPID, key) as publisher:
        names, compid = publisher.names, publisher.compid
        setting.say(f"publishing to {names} as component {compid} of the vehicle")
        yield Publish(publisher, setting.reached_us)


def open_tap(
    endpoint: Endpoint, stamps: Stamps, *, may_transmit: bool, key: SigningKey | None = None
) -> Tap:
    """Return the tap that listens on an endpoint.

    Raises:
        SourceError: the endpoint cannot be opened.
    """
    kind = StreamTap if endpoint.kind in ("tcp", "serial") else UdpTap
    return kind(endpoint, may_transmit=may_transmit, stamps=stamps, key=key)


def session_name() -> str:
    """Return a name for the files of a live session that starts now: its time in UTC."""
    return datetime.now(UTC).strftime("live-%Y%m%dT%H%M%SZ")


class _Loop:
    """The loop: it reads until asked to stop, reports events on the link, and keeps them."""

    def __init__(
        self,
        tap: Tap,
        sessions: Single,
        setting: Setting,
        options: LiveOptions,
        console: Console,
        publish: Publish | None,
    ) -> None:
        self._tap = tap
        self._sessions = sessions
        self._console = console
        self._events: list[str] = []
        self._is_silent = self._has_failed = False
        self._overload, self._fits = Overload(tap), setting.fits
        self._read_s = self._busy_s = 0.0
        self._begun_us = tap.stamps.now()
        self._begun_s = time.monotonic()
        seconds = options.seconds
        self._end_s = float("inf") if seconds is None else time.monotonic() + seconds
        hz = options.request_hz
        self._rates = None
        if hz is not None:
            sender_of = None if publish is None else publish.sender_of
            self._rates = RateRequests(tap, hz, setting.read_options, SYSID, sender_of)
        self._publish, self._answers_s = publish, options.answers_s
        self._publishing = Bulkhead("publishing", "nothing more is published", self._say)
        self._asking = Bulkhead("asking for rates", "no more rates are asked for", self._say)
        self._drawing = Bulkhead("the screen", "lines are written instead", self._say)

    def run(self, stop: StopFlag) -> None:
        """Read and watch until asked to stop, the time is up, or the endpoint fails."""
        size = self._tap.receive_buffer
        buffer = "" if size is None else f" (receive buffer {size} bytes)"
        self._console.say(f"listening on {self._tap.endpoint}{buffer}")
        while not (stop.is_set or self._has_failed):
            left_s = self._end_s - time.monotonic()
            if left_s <= 0.0:
                return
            fed = self._feed(min(READ_S, left_s))
            self._sessions.tick()
            self._watch()
            if self._publish is not None:
                publish = partial(self._publish.tick, self._sessions.running(), time.monotonic())
                self._say(*self._publishing.attempt(publish, list[str]()))
            stopped = [session for session in self._sessions.running() if session.stopped()]
            if stopped or self._console.is_due():
                self._show()
            if fed:
                self._keep_apart(time.monotonic() - self._read_s)

    def _show(self) -> None:
        """Show the state of the sessions: as a line, or on the screen."""
        begun_s = time.monotonic()
        facts = self._facts()
        took_s = time.monotonic() - begun_s
        if self._console.failure is not None:
            self._drawing.give_up(self._console.failure)
        if not self._console.draws or self._drawing.failure is not None:
            self._console.show(facts.line, took_s)
        elif not self._drawing.attempt(lambda: self._console.draw(facts, took_s), False):
            self._console.close()

    def _facts(self) -> ScreenFacts:
        now_us, last_us = self._tap.stamps.now(), self._tap.inbox.last_us
        return ScreenFacts(
            endpoint=str(self._tap.endpoint),
            lasted_s=time.monotonic() - self._begun_s,
            age_s=(now_us - last_us) / 1e6 if last_us else None,
            dropped=self._dropped(),
            vehicles=tuple(self._sessions.facts()),
            to_send=self._tap.endpoint.to_send,
        )

    def finish(self) -> list[Ended]:
        """Read what arrived last, then finish every session; the tap is already closed.

        Where the estimates are behind the link, what waits is skipped: no file and no estimate has
        it.
        """
        if self._tap.stamps.now() - self._tap.reached_us() < LAST_READ_US:
            self._feed(0.0)
        inbox = self._tap.inbox
        if len(inbox):
            skipped_bytes = inbox.skip()
            self._say(
                f"stopped while {inbox.skipped} datagrams of {skipped_bytes} bytes were waiting to "
                "be estimated: they are in no file and no estimate"
            )
        self._say(*self._tap.news)
        if inbox.dropped or inbox.too_long or self._tap.socket_dropped:
            self._say(f"some datagrams were lost on this machine: {self._dropped()} dropped")
        parts = (self._publishing, self._asking, self._drawing)
        failed = [part for part in parts if part.failure is not None]
        dropped = {
            "queue": inbox.dropped,
            "socket": self._tap.socket_dropped,
            "too_long": inbox.too_long,
            "at_the_stop": inbox.skipped,
        }
        live = LiveFacts(
            datagrams=inbox.received,
            skipped_bytes=self._tap.skipped_bytes,
            receive_buffer_bytes=self._tap.receive_buffer,
            dropped={name: count for name, count in dropped.items() if count is not None},
            events=self._events,
            rates=None if self._rates is None else self._rates.summary(),
            failed=[part.failure for part in failed if part.failure is not None],
        )
        ended = self._sessions.finish(live, self._answers_s)
        if self._has_failed or failed:
            ended = [e._replace(exit_code=max(e.exit_code, SinkError.exit_code)) for e in ended]
        if failed:
            names, code = ", ".join(part.what for part in failed), max(e.exit_code for e in ended)
            self._console.say(f"failed in this session: {names}; exit code {code}")
        return ended

    def _feed(self, timeout_s: float) -> bool:
        """Read what has arrived and give it to the sessions; return whether there was anything."""
        try:
            data = self._tap.read(timeout_s)
        except SourceError as error:
            if not self._has_failed:
                self._has_failed = True
                self._say(str(error))
            return False
        self._read_s = time.monotonic()
        if data:
            self._sessions.feed(data)
            if self._rates is not None:
                self._asking.attempt(partial(self._rates.feed, data, self._vehicle()), None)
        return bool(data)

    def _keep_apart(self, busy_s: float) -> None:
        """Set the pause between reads by the shorter one of the last two passes."""
        usual_s, self._busy_s = min(busy_s, self._busy_s), busy_s
        load = LOAD_WITH_FITS if self._fits.waiting else LOAD
        self._tap.pause_s = min(max(BATCH_S, usual_s / load), LONGEST_PAUSE_S)

    def _watch(self) -> None:
        """Report what is new: senders, silence, a clock that was set, overload, rates."""
        while self._tap.news:
            self._say(self._tap.news.popleft())
        jump_s = self._tap.stamps.jump()
        if jump_s is not None:
            self._say(
                f"this machine's clock jumped by {jump_s:+.1f} s: the receive stamps continue "
                "without the jump"
            )
        silent_us = self._tap.stamps.now() - max(self._tap.inbox.last_us, self._begun_us)
        if (silent_us > SILENT_US) is not self._is_silent:
            self._is_silent = not self._is_silent
            seconds = SILENT_US // 1_000_000
            text = f"no data for {seconds} s" if self._is_silent else "the link is back"
            never = self._is_silent and not self._tap.inbox.last_us
            to_send = f"; {self._tap.endpoint.to_send}" if never else ""
            self._say(f"{text} on {self._tap.endpoint}{to_send}")
        self._say(*self._overload.lines())
        if self._rates is not None:
            ask = partial(self._rates.tick, time.monotonic(), self._vehicle())
            self._say(*self._asking.attempt(ask, list[str]()))

    def _say(self, *lines: str) -> None:
        for text in lines:
            if len(self._events) < MOST_EVENTS:
                self._events.append(text)
            self._console.say(text)

    def _vehicle(self) -> tuple[int, int] | None:
        return next((s.vehicle for s in self._sessions.running()), None)

    def _dropped(self) -> str:
        """Return how many datagrams were dropped here, with "at least" where not all are known."""
        inbox = self._tap.inbox
        count = inbox.dropped + inbox.too_long + (self._tap.socket_dropped or 0)
        # A system that does not count its drops: they show only as gaps in sequence numbers.
        known = self._tap.socket_dropped is not None or self._tap.receive_buffer is None
        return f"{count}" if known else f"at least {count}"
