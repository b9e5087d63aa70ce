"""The whole way through, to be read from top to bottom.

    source -> messages -> channels -> samples on one grid -> estimates -> physics -> sinks

The only module that knows all stages; where messages come from, a file or a socket, it does not.
"""

from collections.abc import Callable, Sequence

from yawid.blocks import FrameBlock, ModesBlock, SampleBlock
from yawid.channels.stage import Channels
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank
from yawid.estimation.polynomials import parameter_names
from yawid.physics.stage import PhysicsStage
from yawid.sinks.base import Grid, Sink, rudder_unit

BLOCK = 4096
"""Samples estimated and written at once: the covariance of each row makes blocks heavy."""


class Pipeline:
    """Feed it messages, or samples that a run's file holds, then ``finish``; the sinks get rows.

    ``sinks`` may grow until the first sample. ``make_bank`` makes the estimators once the sample
    time is known. ``modes_of`` names autopilot and vehicle type, by which flight modes have their
    names, where no HEARTBEAT passes through.

    Raises:
        ConfigError: what was asked for does not fit the log (its rate).
        SinkError: a sink cannot write.
    """

    def __init__(
        self,
        config: RunConfig,
        sinks: Sequence[Sink] = (),
        make_bank: Callable[[RunConfig, float], Bank] = Bank,
        modes_of: tuple[int, int] = (0, 0),
    ) -> None:
        self.config = config
        self.sinks = sinks
        self.channels = Channels(config)
        self.bank: Bank | None = None
        self.modes: ModesBlock | None = None
        self.newest: SampleBlock | None = None
        self.samples = 0
        self._make_bank = make_bank
        self._modes_of = modes_of

    def feed(self, block: FrameBlock | SampleBlock | None) -> None:
        """Take a block of messages or samples in; every sample it completes is estimated."""
        if isinstance(block, SampleBlock):
            self.estimate(block)
        elif block is not None:
            for samples in self.channels.feed(block):
                self.estimate(samples)

    def finish(self) -> None:
        """Estimate what was held back for want of more; the sinks stay open for the summary."""
        for samples in self.channels.finish():
            self.estimate(samples)

    def estimate(self, samples: SampleBlock) -> None:
        """Estimate samples of one epoch and write them."""
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
        self._physics = PhysicsStage(
            self.config.armax_orders(),
            sample_time_s,
            mean_output=self.config.output == "yaw",
            servo_tau_s=self.config.servo_tau,
        )
        vehicle, modes_of = self.channels.lock.vehicle, self._modes_of
        if vehicle is not None:
            modes_of = vehicle.autopilot, vehicle.type
        names = parameter_names(self.config.armax_orders(), self.config.inputs, bias=True)
        grid = Grid(
            names,
            self.config.inputs,
            self.bank.methods,
            sample_time_s,
            rudder_unit(self.config.rudder_max_deg),
            *modes_of,
        )
        for sink in self.sinks:
            sink.start(grid)
        return self.bank
