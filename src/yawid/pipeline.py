"""The whole way through, to be read from top to bottom.

    bytes -> frames -> channels -> samples on one grid -> estimates -> physics -> sinks

The only module that knows all stages; whether the bytes come from a file or a socket it does not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from yawid.blocks import FrameBlock, ModesBlock, SampleBlock
from yawid.channels.stage import WANTED, Channels
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank
from yawid.estimation.polynomials import parameter_names
from yawid.physics.stage import PhysicsRows
from yawid.sinks.base import Grid, Sink, rudder_unit
from yawid.sources.mavlink.link_stats import LinkStats
from yawid.sources.read_options import Reading

BLOCK = 4096
"""Samples estimated and written at once: the covariance of each row makes blocks heavy."""


class Counted(Protocol):
    """What messages come from: a decoder or the reader of a log."""

    @property
    def link(self) -> LinkStats:
        """Counts of what has been read."""


class Pipeline:
    """Feed it tlog bytes cut anywhere, then ``finish``; the sinks are told as results come.

    What reads another kind of log is its ``source`` in the decoder's place: ``take`` its messages.
    ``make_bank`` makes the estimators once the sample time is known.

    Raises:
        ConfigError: what was asked for does not fit the log (its rate).
        SinkError: a sink cannot write.
    """

    def __init__(
        self,
        config: RunConfig,
        sinks: Sequence[Sink] = (),
        reading: Reading | None = None,
        make_bank: Callable[[RunConfig, float], Bank] = Bank,
    ) -> None:
        self.config = config
        self._make_bank = make_bank
        self.sinks = list(sinks)
        self.decoder = (reading or Reading()).decoder(WANTED)
        self.source: Counted = self.decoder
        self.channels = Channels(config)
        self.bank: Bank | None = None
        self.modes: ModesBlock | None = None
        self.newest: SampleBlock | None = None
        self.samples = 0
        self.modes_of = (0, 0)
        """Autopilot and vehicle type where no HEARTBEAT passes through, as with a file of results.
        """

    @property
    def link(self) -> LinkStats:
        """Counts of what came from the source."""
        return self.source.link

    def feed(self, data: bytes) -> None:
        """Take bytes in; every sample they complete is estimated and written."""
        self.take(self.decoder.feed(data))

    def finish(self) -> None:
        """Take in what was held back for want of more; the sinks stay open for the summary."""
        self.take(self.decoder.finish())
        for samples in self.channels.finish():
            self.estimate(samples)

    def take(self, frames: FrameBlock | None) -> None:
        """Take messages in; every sample they complete is estimated and written."""
        if frames is not None:
            for samples in self.channels.feed(frames):
                self.estimate(samples)

    def estimate(self, samples: SampleBlock) -> None:
        """Take samples of one epoch in, such as a file of results holds; estimate and write."""
        for first in range(0, len(samples), BLOCK):
            self._estimate(samples.select(slice(first, first + BLOCK)))

    def _estimate(self, samples: SampleBlock) -> None:
        bank = self.bank or self._open_bank(samples.sample_time_s)
        estimates = bank.run(samples)
        self.modes = self._physics.of(samples.k, estimates[self.config.method])
        self.newest, self.samples = samples, self.samples + len(samples)
        for sink in self.sinks:
            sink.write(samples, estimates, self.modes)

    def _open_bank(self, sample_time_s: float) -> Bank:
        self.bank = self._make_bank(self.config, sample_time_s)
        self._physics = PhysicsRows(
            self.config.armax_orders(),
            sample_time_s,
            mean_output=self.config.output == "yaw",
            servo_tau_s=self.config.servo_tau,
        )
        names = parameter_names(self.config.armax_orders(), self.config.inputs, bias=True)
        grid = Grid(
            names,
            self.config.inputs,
            self.bank.methods,
            sample_time_s,
            rudder_unit(self.config.rudder_max_deg),
            *self._modes_of(),
        )
        for sink in self.sinks:
            sink.start(grid)
        return self.bank

    def _modes_of(self) -> tuple[int, int]:
        """Return the autopilot and the vehicle type whose flight modes the samples bear."""
        vehicle = self.channels.lock.vehicle
        return self.modes_of if vehicle is None else (vehicle.autopilot, vehicle.type)
