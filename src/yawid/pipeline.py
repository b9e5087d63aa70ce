r"""The whole way through yawid, to be read from top to bottom.

    source -> messages -> channels -> samples on one grid -> estimates -> physics -> sinks
                                                         \-> manoeuvres, an answer each -/

This is the only module that knows all stages. It does not know where messages come from: a file or
a socket.
"""

import math
import weakref
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial
from typing import Final

import msgspec
import numpy as np

from yawid.answers.channel_report import ChannelReport
from yawid.answers.heard import BootSpan
from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Bare, ChannelFound, Flight, Manoeuvre
from yawid.blocks import FrameBlock, Held, ModesBlock, MotionBlock, RecordBlock, SampleBlock
from yawid.channels.report import report_of
from yawid.channels.stage import WANTED, Channels
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank
from yawid.estimation.polynomials import parameter_names
from yawid.manoeuvre.find import UnderWay
from yawid.manoeuvre.judge import ManoeuvreSetting
from yawid.manoeuvre.laterals import done_by
from yawid.manoeuvre.stage import Manoeuvres
from yawid.ordinary import LONG_S, Ordinary, answer_of
from yawid.physics.stage import PhysicsStage
from yawid.results.judge_samples import all_held
from yawid.results.ordinary_flight import Flown, given
from yawid.results.yaw_loop import gains_in
from yawid.sinks.base import Event, Found, FoundBare, Grid, RunRows, Sink

BLOCK = 4096
"""The samples estimated and written at once: each row has a covariance, so blocks are large."""
MARGIN_US = 1_000_000
"""The motion kept before --from and after --to: the commands before a manoeuvre belong to it."""


class Pipeline:
    """The whole run: feed it messages, or samples from a run's file, then ``finish``.

    ``sinks`` get the rows; sinks may be added until the first sample. For samples without
    messages, ``modes_of`` has the autopilot and the vehicle type, which name the flight modes,
    ``rates_hz`` the rates of yaw and rudder messages, and ``of_file`` the rudder, with gains of a
    yaw damper, and the boots. With ``worker``, an executor of one thread, manoeuvres are answered
    there, and ``collect`` returns those that are ready; ``lateral_worker`` is the same for the fits
    of the bare airframe, and for those of ordinary flight, whose ``running`` answer of the last
    quarter of an hour follows each window of it.

    Raises:
        ConfigError: the rate asked for does not fit the log.
        SinkError: a sink cannot write.
    """

    reads: Final = WANTED
    """The names of the messages that it needs."""

    def __init__(
        self,
        config: RunConfig,
        sinks: Sequence[Sink] = (),
        modes_of: tuple[int, int] = (0, 0),
        rates_hz: tuple[float, float] | None = None,
        worker: Executor | None = None,
        lateral_worker: Executor | None = None,
        of_file: tuple[ChannelFound | None, list[BootSpan] | None] = (None, None),
    ) -> None:
        self.config = config
        self.sinks = sinks
        self.channels = Channels(config)
        self.bank: Bank | None = None
        self.modes: ModesBlock | None = None
        self.newest: SampleBlock | None = None
        self.samples = self._used = 0
        self._held = Held(0)
        self._modes_of = modes_of
        self._rates_hz = rates_hz
        self._worker, self._lateral_worker = worker, lateral_worker
        self._manoeuvres: Manoeuvres | None = None
        self._motion: list[MotionBlock] = []
        self._of_file = of_file
        self._ordinary = Ordinary(config.half_travel) if config.is_ordinary else None
        self._answering: Future[OrdinaryAnswer] | None = None
        self._refit: Future[OrdinaryAnswer] | None = None
        self._refitted: tuple[object, ...] = ()
        self.running: OrdinaryAnswer | None = None
        self._flown = Flown()

    def report(self) -> ChannelReport:
        """Return the report of the channels in their present state."""
        return report_of(self.channels)

    @property
    def manoeuvres(self) -> list[Manoeuvre] | None:
        """The manoeuvres answered so far; None where none are searched for."""
        if not self.config.has_manoeuvres:
            return None
        stage = self._manoeuvres
        if stage is None:
            return []
        bares = {} if stage.laterals is None else stage.laterals.bares()
        return [msgspec.structs.replace(x, lateral=bares.get(x.n)) for x in stage.judged()]

    def progress(self) -> tuple[UnderWay, int]:
        """Return the progress of the current manoeuvre, and how many wait for their answers."""
        stage = self._manoeuvres
        if stage is None:
            return UnderWay(None, 0.0), 0
        return stage.finder.progress(), len(stage.waiting)

    def flights(self, of_the_log: list[Reason]) -> list[Flight]:
        """Return the flight's answers, the headline first; see the stage."""
        return [] if self._manoeuvres is None else self._manoeuvres.flights(of_the_log)

    def why_none(self) -> list[Reason]:
        """Return why there is no estimate or no manoeuvre, by the samples and what they showed."""
        stage, bank = self._manoeuvres, self.bank
        if bank is None:
            return []
        if not self._used:
            return [all_held(self._held)]
        if stage is not None:
            return stage.why_none(bank.grounded / bank.taken)
        if any(estimator.updates for estimator in bank.estimators.values()):
            return []
        return [Reason("not_excited", "rudder and yaw rate never moved enough for an estimate")]

    def yaw_loop(self, from_s: float, to_s: float) -> str | None:
        """Return the gains of a yaw damper in a stretch, as far as they are known."""
        report = self.report()
        rudder, boots = report.channels.get("rudder"), report.boots
        return gains_in(*(self._of_file if rudder is None else (rudder, boots)), from_s, to_s)

    def bare(self) -> Bare | None:
        """Return the bare airframe of the flight, which may take a fit; None without any."""
        return None if self._manoeuvres is None else self._manoeuvres.bare()

    def ordinary(self) -> OrdinaryAnswer | None:
        """Return the answer of ordinary flight, which may take a fit; None where none is asked."""
        if self._ordinary is None or self.bank is None:
            return None
        if self._answering is None:
            self._answering = Future()
            self._answering.set_result(_answered(self._ordinary))
        return self._flown.at(self._answering.result())

    def ordinary_sums(self) -> str | None:
        """Return the sums of an ordinary flight that is too short to answer, for others of its day.

        They are a text; see ``Sums.packed``.
        """
        sums = None if self._ordinary is None else self._ordinary.sums()
        return sums.packed() if sums and 0.0 < sums.seconds < LONG_S else None

    def feed(self, block: FrameBlock | RecordBlock | SampleBlock | MotionBlock | None) -> None:
        """Take messages, a record's rows or samples in; estimate all samples they complete.

        A file's lateral motion comes before the samples that need it.
        """
        if isinstance(block, MotionBlock):
            self._move(block)
        elif isinstance(block, SampleBlock):
            for samples in self._asked_for(block).epochs():
                self.estimate(samples)
        elif isinstance(block, RecordBlock):
            self._estimate_all(self.channels.feed_rows(block))
        elif block is not None:
            self._estimate_all(self.channels.feed_frames(block))

    def _estimate_all(self, found: list[SampleBlock]) -> None:
        """Estimate the samples that the channels have just completed, after their motion."""
        if (motion := self.channels.motion()) is not None:
            self._move(motion)
        for samples in found:
            self.estimate(samples)

    def _move(self, motion: MotionBlock) -> None:
        """Pass lateral motion on, if it is asked for; it waits until samples open the sinks."""
        low, high = self.config.window_us
        parts = motion.attitude, motion.commands, motion.acceleration
        inside = [(x.t_us >= low - MARGIN_US) & (x.t_us <= high + MARGIN_US) for x in parts]
        motion = MotionBlock(*(x.select(at) for x, at in zip(parts, inside, strict=True)))
        if not motion:
            return
        if self.bank is None:
            self._motion.append(motion)
            return
        if self._manoeuvres is not None and self._manoeuvres.laterals is not None:
            self._manoeuvres.laterals.store.feed(motion)
        if self._ordinary is not None:
            self._ordinary.store.feed(motion)
        self.pass_on(motion)

    def pass_on(self, event: Event) -> None:
        """Give every sink an event."""
        for sink in self.sinks:
            sink.take(event)

    def _asked_for(self, block: SampleBlock) -> SampleBlock:
        """Return a file's samples with the inputs and in the stretch that are asked for."""
        low, high = self.config.window_us
        rows = (block.boot_us >= low) & (block.boot_us <= high)
        samples = replace(block, u=np.ascontiguousarray(block.u[:, : len(self.config.inputs)]))
        return samples if rows.all() else samples.select(rows)

    def finish(self) -> tuple[list[Manoeuvre], list[tuple[int, Bare]]]:
        """Estimate the samples kept back until now; the sinks stay open for the summary.

        Return what :meth:`collect` does: all, where no worker answers.
        """
        self._estimate_all(self.channels.finish())
        if self._manoeuvres is not None:
            self._manoeuvres.finish()
        if self._ordinary is not None:
            self._ordinary.finish()
            if self._lateral_worker is not None:
                self._answering = self._lateral_worker.submit(_answered, self._ordinary)
        return self.collect()

    def collect(
        self, *, until_s: float = -math.inf
    ) -> tuple[list[Manoeuvre], list[tuple[int, Bare]]]:
        """Pass the manoeuvres answered and the airframes fitted since the last call to the sinks.

        Return both, an airframe with its manoeuvre's number. Those without an answer or a fit are
        waited for until ``until_s`` on the monotonic clock.
        """
        stage, bares = self._manoeuvres, list[tuple[int, Bare]]()
        if stage is None:
            return [], bares
        answered = list(stage.ready(until_s=until_s))
        for each in answered:
            self.pass_on(Found(each, stage.spans_ns[each.n]))
        if stage.laterals is not None:
            numbers = {each.n for each in stage.answered}
            bares = list(stage.laterals.ready(numbers, until_s=until_s))
        for n, bare in bares:
            self.pass_on(FoundBare(n, bare, stage.spans_ns[n]))
        return answered, bares

    def leave_out(self, until_s: float) -> list[str]:
        """Give up the answers that are not ready; return in words what is missing."""
        late = [] if self._manoeuvres is None else self._manoeuvres.leave_out(until_s)
        if self._answering is not None and not done_by(self._answering, until_s):
            self._ordinary = self._answering = None
            late.append("the answer of ordinary flight")
        return late

    @property
    def bare_is_late(self) -> bool:
        """Whether there was no time for the fit of the flight's bare airframe."""
        laterals = None if self._manoeuvres is None else self._manoeuvres.laterals
        return laterals is not None and laterals.is_late

    def estimate(self, samples: SampleBlock) -> None:
        """Estimate samples of one epoch, and write them."""
        for first in range(0, len(samples), BLOCK):
            self._estimate(samples.select(slice(first, first + BLOCK)))

    def _estimate(self, samples: SampleBlock) -> None:
        bank = self.bank or self._open_bank(samples.sample_time_s)
        estimates = bank.run(samples)
        self.modes = self._physics.of(samples.k, estimates[self.config.method])
        self.newest, self.samples = samples, self.samples + len(samples)
        self._used += int(np.count_nonzero(samples.held == 0))
        self._held |= Held(int(np.bitwise_or.reduce(samples.held)))
        self.pass_on(RunRows(samples, estimates, self.modes))
        if self._ordinary is not None:
            self._ordinary.feed(samples)
            self._flown.feed(samples)
            self._run_on(self._ordinary)
        if self._manoeuvres is not None:
            self._manoeuvres.feed(samples, estimates)
            if self._worker is None:
                self.collect()

    def _run_on(self, flight: Ordinary) -> None:
        """Take the running answer of ordinary flight, and ask for the next one after a window."""
        if self._refit is not None and self._refit.done():
            self.running, self._refit = self._refit.result(), None
        is_new = flight.recent is not self._refitted  # each window makes another tuple of them
        if self._lateral_worker is None or self._refit is not None or not is_new:
            return
        last = None if self.running is None else self.running.dutch_roll
        near, self._refitted = () if last is None else (last.wn_rad_s,), flight.recent
        self._refit = self._lateral_worker.submit(_answered, flight, *near, recent=True)

    def _open_bank(self, sample_time_s: float) -> Bank:
        self.bank = Bank(self.config, sample_time_s)
        self._physics = PhysicsStage(
            self.config.armax_orders(),
            sample_time_s,
            mean_output=self.config.output == "yaw",
        )
        modes_of = self.channels.modes_of or self._modes_of
        if self.config.has_manoeuvres:
            rates_hz = self._rates_hz or (1.0 / sample_time_s,) * 2
            if self.channels.intervals_us is not None:
                yaw_us, rudder_us = self.channels.intervals_us
                rates_hz = 1e6 / yaw_us, 1e6 / rudder_us
            setting = ManoeuvreSetting(self.config, sample_time_s, rates_hz, modes_of)
            # In a circle with its stage the pipeline would keep all samples when it has ended.
            yaw_loop = partial(Pipeline.yaw_loop, weakref.proxy(self))
            self._manoeuvres = Manoeuvres(setting, self._worker, self._lateral_worker, yaw_loop)
        names = parameter_names(self.config.armax_orders(), self.config.inputs, bias=True)
        grid = Grid(
            names,
            self.config.inputs,
            self.bank.methods,
            sample_time_s,
            self.config.unit_of_rudder,
            *modes_of,
        )
        self.pass_on(grid)
        waiting, self._motion = self._motion, []
        for motion in waiting:
            self._move(motion)
        return self.bank


def _answered(flight: Ordinary, *near: float, recent: bool = False) -> OrdinaryAnswer:
    """Return what is given of the answer of ordinary flight; see ``answer_of``."""
    return given(answer_of(flight, near, recent=recent))
