"""The live session of one vehicle: the same bytes go to its tlog and to its pipeline."""

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

import msgspec

from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Bare, Manoeuvre, RunSummary
from yawid.answers.session import LiveFacts
from yawid.config.run import RunConfig
from yawid.errors import UNFORESEEN, ConfigError, SinkError
from yawid.pipeline import Pipeline
from yawid.quantities.vehicles import NOT_A_VEHICLE
from yawid.results.summary import summarise
from yawid.runs.live.bulkhead import Bulkhead, cause_of
from yawid.runs.live.guarded_sink import Guarded, TlogRecorder
from yawid.runs.live.running_answer import RunningAnswer
from yawid.runs.live.screen_facts import Gatherer
from yawid.runs.live.standing import Latency, Standing
from yawid.runs.live.viewer_thread import Viewer
from yawid.runs.live.worker import FitWorker, SharedDisk, WorkThread
from yawid.runs.outputs import Outputs, finish, open_mcap, open_rerun, parameters_of, refused
from yawid.sinks.base import Abort, Flush, Sink
from yawid.sinks.rerun.sink import RerunSink
from yawid.sinks.terminal.console import VehicleFacts
from yawid.sinks.words import flown, lateral_says, says
from yawid.sources.open_log import ReadOptions

MOST_EVENTS = 100

FAILED = "estimation or status failed"
_T = TypeVar("_T")


class Ended(NamedTuple):
    """The result of a session: summary and exit code.

    The code is 70 where the estimation failed, 6 where another part of the session did, else the
    verdict's. The loop raises a lower one to 6 where the link, publishing, rate requests or the
    screen failed.
    """

    summary: RunSummary
    exit_code: int


class Setting(NamedTuple):
    """The settings, clocks and workers that all sessions of a run share."""

    endpoint: str
    config: RunConfig
    outputs: Outputs
    read_options: ReadOptions
    say: Callable[[str], None]
    now_us: Callable[[], int]
    reached_us: Callable[[], int]
    fits: FitWorker
    disk: SharedDisk
    viewers: WorkThread | None
    lateral: WorkThread | None

    def end_fits(self) -> None:
        """Drop the fits that are not made yet, and end the processes that make them."""
        for worker in (self.fits, self.lateral):
            if worker is not None:
                worker.shutdown(cancel_futures=True)


class LiveSession:
    """A session that records, estimates and shows one vehicle; ``label`` names it among several.

    Each of these parts may fail without the others; recording goes on where estimation fails.
    ``publishing`` guards what :class:`yawid.runs.live.publish.Publish` does for this session.
    """

    def __init__(self, setting: Setting, label: str = "") -> None:
        self.events: list[str] = []
        self.failures: dict[str, str] = {}
        """Why a part failed to open, by the part's name."""
        self.latency = Latency()
        self._setting = setting
        self._label = label
        self._viewer = self._open_viewer()
        self._sinks: list[Sink] = [] if self._viewer is None else [self._viewer]
        self.decoder = setting.read_options.decoder(Pipeline.reads)
        self.pipeline = Pipeline(
            setting.config, self._sinks, worker=setting.fits, lateral_worker=setting.lateral
        )
        self._guards: dict[str, Guarded] = {}
        self._tlog: TlogRecorder | None = None
        self._sha256 = hashlib.sha256()
        self._opened = False
        self._seen = 0
        self._others: set[int] = set()
        self._signing_said = setting.read_options.key is not None
        self._standing = Standing()
        self.answer = RunningAnswer()
        self._gatherer = Gatherer()
        self._estimating = Bulkhead(
            "the estimation",
            "it is no longer estimated, but recorded as before",
            self.say,
            self._misfit,
        )
        self._showing = Bulkhead("the status", "it is no longer shown", self.say)
        self.publishing = Bulkhead("publishing", "nothing more is published for it", self.say)

    @property
    def vehicle(self) -> tuple[int, int] | None:
        """The vehicle that is estimated, as (sysid, compid); None before it is known."""
        found = self.pipeline.channels.lock.vehicle
        return None if found is None else (found.sysid, found.compid)

    @property
    def is_estimated(self) -> bool:
        """Whether the estimation has not failed."""
        return self._estimating.failure is None

    def say(self, text: str) -> None:
        """Print a line, and keep it for the summary."""
        if len(self.events) < MOST_EVENTS:
            self.events.append(text)
        self._setting.say(f"{self._label}{text}")

    def record(self, data: bytes) -> None:
        """Record the bytes (whole records); the first call opens the files."""
        if not self._opened:
            self._open()
        self._sha256.update(data)
        if self._tlog is not None:
            self._tlog.write(data)
        self._standing.received_us = self._setting.now_us()

    def estimate(self, data: bytes) -> None:
        """Estimate from bytes that were recorded."""
        self._estimating.attempt(lambda: self._estimate(data), None)

    def _estimate(self, data: bytes) -> None:
        before = self.pipeline.samples
        self.pipeline.feed(self.decoder.feed(data))
        newest = self.pipeline.newest
        if before and newest is not None and self.pipeline.samples > before:
            # The first samples are not counted: they wait until the rate is known.
            self.latency.add(self._setting.now_us() - newest.received_us)

    def tick(self) -> None:
        """Write out and report what is complete; to be called several times each second."""
        if self._tlog is not None:
            self._tlog.look()
        self._estimating.attempt(self._look, None)
        self.pipeline.pass_on(Flush())

    def _look(self) -> None:
        """Report new manoeuvres, further vehicles, and signatures that are not checked."""
        self._report(*self.pipeline.collect())
        if self._setting.config.sysid is None:
            self._look_for_others()
        if not self._signing_said:
            self._look_for_signatures()

    def settle(self) -> None:
        """Estimate from everything received, also what was waiting for more data."""
        self._estimating.attempt(self._settle, None)

    def _settle(self) -> None:
        self.pipeline.feed(self.decoder.finish())
        self._report(*self.pipeline.finish())
        if not self._signing_said:
            self._look_for_signatures()

    def conclude(self, until_s: float) -> None:
        """Wait for answers until a time on the monotonic clock, and leave out the others."""
        self._estimating.attempt(partial(self._conclude, until_s), None)

    def _conclude(self, until_s: float) -> None:
        self._report(*self.pipeline.collect(until_s=until_s))
        missing = self.pipeline.leave_out(until_s)
        self._report(*self.pipeline.collect())
        self._say_late(missing)

    def _say_late(self, missing: list[str]) -> None:
        then = "a replay of the tlog gives it" if self._setting.outputs.record else "it is lost"
        for each in missing:
            self.say(f"{each} was not ready in time for the end of the session: {then}")

    def stopped(self) -> bool:
        """Return whether samples have stopped since the last call: the line is then due at once."""
        return self._shown(
            lambda: self._standing.stopped(self.pipeline, self._setting.reached_us()), False
        )

    def facts(self) -> VehicleFacts:
        """Return the session's state; see :meth:`Gatherer.facts`."""
        vehicle = self.vehicle or (0, 0)
        name = f"{vehicle[0]}/{vehicle[1]}" if self.vehicle else ""
        failed = VehicleFacts(vehicle[0], self._label, name, quiet=FAILED, state=FAILED)
        return self._shown(self._facts, failed)

    def _facts(self) -> VehicleFacts:
        quiet = self._standing.quiet(self.pipeline, self._setting.reached_us())
        link = self.decoder.link
        answer = self.answer.look(self.pipeline, link)
        return self._gatherer.facts(self.pipeline, link, quiet, answer, self._label)

    def _shown(self, act: Callable[[], _T], failed: _T) -> _T:
        """Return the result of ``act``, or ``failed``: no older number is shown as current."""
        return self._showing.attempt(act, failed) if self.is_estimated else failed

    def finish(self, live: LiveFacts) -> Ended:
        """Finish every file, after :meth:`settle`; ``live`` is the tap's part of the summary."""
        tlog = None if self._tlog is None else self._tlog.finish()
        log = self._setting.endpoint if tlog is None else str(tlog)
        path = self._setting.outputs.path
        summary = self._summarise(log)
        self._say_late(["the bare airframe of the flight"] if self.pipeline.bare_is_late else [])
        summary = msgspec.structs.replace(summary, live=self._own(live))
        files = {n: str(path(f".{n}")) for n, g in self._guards.items() if g.failure is None}
        files |= {} if tlog is None else {"tlog": str(tlog)}
        summary = finish(self.pipeline, summary, files, parameters_of(self.pipeline))
        # A file may fail while it is finished.
        files = {name: path for name, path in files.items() if name not in self._failed()}
        summary = msgspec.structs.replace(summary, files=files, live=self._own(live))
        code = SinkError.exit_code if self._failed() else summary.exit_code
        code = code if self.is_estimated else UNFORESEEN
        if self._failed():
            names = ", ".join(self._failed())
            self._setting.say(f"{self._label}failed in this session: {names}; exit code {code}")
        return Ended(summary, code)

    def _summarise(self, log: str) -> RunSummary:
        """Return the summary; after a failure, of the parts that can be summarised."""
        sha256 = self._sha256.hexdigest()
        channels_alone, nothing = Pipeline(self.pipeline.config), Pipeline(self.pipeline.config)
        channels_alone.channels = self.pipeline.channels
        for pipeline in (self.pipeline, channels_alone, nothing):
            try:
                summary = summarise(pipeline, self.decoder.link, log, sha256)
                summary.to_json()  # the files hold this: it must not fail later
                break
            except Exception as error:
                self._estimating.give_up(error)
        if self._estimating.failure is None:
            return summary
        text = f"{self._estimating.failure}: what arrived afterwards is in no estimate"
        return refused(summary, Reason("interrupted", text))

    def abort(self) -> None:
        """Close what is open; files keep their unfinished names and what was recorded."""
        if self._tlog is not None:
            self._tlog.abort()
        self.pipeline.pass_on(Abort())

    def give_up(self) -> Path | None:
        """End a session that does not fit what was asked for; return its finished tlog, if any."""
        tlog, self._tlog = self._tlog, None
        self.abort()
        return None if tlog is None else tlog.finish()

    def _report(self, answered: list[Manoeuvre], bares: list[tuple[int, Bare]]) -> None:
        for found in answered:
            self.say(f"manoeuvre {found.n} ({flown(found)}): {says(found)}")
        for n, bare in bares:
            if bare.dutch_roll is not None or self._setting.config.lateral is not None:
                self.say(f"manoeuvre {n}, {lateral_says(bare)}")

    def _open(self) -> None:
        self._opened = True
        outputs, disk = self._setting.outputs, self._setting.disk
        self._guard("mcap", lambda: open_mcap(self._setting.config, outputs, disk))
        if outputs.rerun == "save":
            self._guard("rrd", lambda: open_rerun(outputs)[0])
        if outputs.record:
            try:
                self._tlog = TlogRecorder(outputs.path(".tlog"), self.say, force=outputs.force)
            except Exception as error:
                self._go_on_without("tlog", error)

    def _look_for_others(self) -> None:
        """Report every further vehicle once: it is not estimated."""
        lock = self.pipeline.channels.lock
        if lock.vehicle is None or len(lock.senders) == self._seen:
            return
        self._seen = len(lock.senders)
        flying = {
            sysid for (sysid, _), (kind, _) in lock.senders.items() if kind not in NOT_A_VEHICLE
        }
        for sysid in sorted(flying - self._others - {lock.vehicle.sysid}):
            self._others.add(sysid)
            self.say(
                f"system {sysid} is received too, but system {lock.vehicle.sysid} is estimated: "
                "choose another by --sysid N, or each by --sysid all"
            )

    def _look_for_signatures(self) -> None:
        """Report once that frames are signed and their signatures are not checked."""
        said = self._setting.read_options.unchecked(self.decoder.link)
        if said is not None:
            self._signing_said = True
            self.say(said)

    def _guard(self, name: str, make: Callable[[], Sink]) -> None:
        part = self._setting.outputs.path(f".{name}.part")
        try:
            guarded = Guarded(make(), part, self.say)
        except Exception as error:
            self._go_on_without(name, error)
            return
        self._guards[name] = guarded
        self._sinks.insert(0, guarded)

    def _go_on_without(self, name: str, error: Exception) -> None:
        self.failures[name] = cause_of(error)
        self.say(f"{self.failures[name]}: the session goes on without it")

    def _open_viewer(self) -> Viewer | None:
        outputs, viewers = self._setting.outputs, self._setting.viewers
        if viewers is None or not outputs.has_viewer:
            return None
        return Viewer(
            lambda warn: RerunSink(outputs.rerun, name=outputs.name, warn=warn), self.say, viewers
        )

    def _misfit(self, error: Exception) -> bool:
        """Return whether what was asked for does not fit the link; that shows before any sample."""
        return isinstance(error, ConfigError) and self.pipeline.bank is None

    def _failed(self) -> dict[str, str]:
        """Return the causes of the parts that failed, by the part's name."""
        viewing = None if self._viewer is None else self._viewer.working
        parts = {
            "estimation": self._estimating, **self._guards, "tlog": self._tlog,
            "viewer": viewing, "status": self._showing,
            "publishing": self.publishing,
        }  # fmt: skip
        found = {name: part.failure for name, part in parts.items() if part is not None}
        return self.failures | {name: why for name, why in found.items() if why is not None}

    def _own(self, live: LiveFacts) -> LiveFacts:
        """Return the tap's facts with those of this session added."""
        return msgspec.structs.replace(
            live,
            events=[*live.events, *self.events],
            failed=[*(live.failed or []), *self._failed().values()],
            latency_ms=self.latency.summary() if self.latency.count else None,
            viewer_skipped=None if self._viewer is None else self._viewer.skipped,
        )
