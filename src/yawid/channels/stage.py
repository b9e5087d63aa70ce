"""The whole stage: blocks of messages, or a record's rows, in; blocks of samples out.

find the vehicle -> find its surfaces -> rows on the vehicle's clock -> segments -> one grid
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from yawid.blocks import FrameBlock, Held, MessageBlock, MotionBlock, RecordBlock, SampleBlock
from yawid.channels.align import Aligner
from yawid.channels.command import Command
from yawid.channels.conditioning import Conditioner, finer_by
from yawid.channels.find_surface import find_surface
from yawid.channels.flight_state import FlightState, lift_motors
from yawid.channels.grid_rate import Flow, StartUp, bridged_gaps_us, sample_rate
from yawid.channels.motion_reader import MotionReader
from yawid.channels.parameters import ParameterTable
from yawid.channels.segments import Boots, Segmenter
from yawid.channels.series import END, Piece, Series
from yawid.channels.surface import OUTPUTS, STICKS, Surface
from yawid.channels.surface_reader import SurfaceReader, record_surfaces, record_values
from yawid.channels.vehicle import Vehicle, VehicleLock
from yawid.channels.yaw_reader import ROW, SOURCES, YawReader
from yawid.config.run import RunConfig
from yawid.errors import ConfigError

WANTED = (
    OUTPUTS
    | {*STICKS}
    | SOURCES.keys()
    | {"HEARTBEAT", "PARAM_VALUE", "EXTENDED_SYS_STATE", "VFR_HUD"}
)
"""The messages this stage reads."""
FAST_RAD_S = 6.0
"""A yaw rate beyond this (344 deg/s) is counted: no aircraft holds it, but a gyro in deg/s that is
read as rad/s shows it in every manoeuvre. Without it such a record is usable without a word."""


class Channels:
    """The way from messages (``feed_frames``) or records (``feed_rows``) to samples.

    ``watch`` is called with the rows of yaw and surfaces in the order received, and changes
    nothing. ``used`` counts the samples that update the estimators, ``fast`` those whose yaw rate
    is beyond ``FAST_RAD_S``, and ``twins`` compares the outputs of one function.

    Raises:
        ConfigError: the rate asked for is above the log's own.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self.watch: Callable[[Series, Series], None] | None = None
        self.lock = VehicleLock(config.sysid)
        self.parameters = ParameterTable()
        self.segmenter = Segmenter()
        self.startup: StartUp | None = StartUp()
        self.aligner: Aligner | None = None
        self.intervals_us: tuple[float, float] | None = None
        self.surfaces: tuple[Surface, ...] = ()
        self.aileron: Surface | None = None
        self.surface_rows = 0
        self.used = self.fast = 0
        self.flows = Flow(), Flow()
        self._used: tuple[Surface, ...] = ()
        self.received: frozenset[str] = frozenset()
        self._state_of_flight = FlightState(config.airborne == "all")
        self.command = Command(config)
        self.boots = Boots()
        self._motion = MotionReader(config) if config.keeps_motion else None
        self.yaw = YawReader(config.airborne == "all", config.keeps_motion)
        self._surface = SurfaceReader(len(config.inputs))
        self.twins = self._surface.twins
        self.record: RecordBlock | None = None
        """What is common to all rows of a record, None for a log of messages."""

    @property
    def modes_of(self) -> tuple[int, int] | None:
        """Autopilot and vehicle type, which name the flight modes; None where they are unknown."""
        if (vehicle := self.lock.vehicle) is not None:
            return vehicle.autopilot, vehicle.type
        return None if self.record is None else self.record.modes_of

    # A float of the log may hold any bits: an absurd value becomes NaN, and its sample is held.
    @np.errstate(over="ignore", invalid="ignore")
    def feed_frames(self, frames: FrameBlock) -> list[SampleBlock]:
        """Take a block of messages in; return the samples that it completes, in order."""
        messages, parameters = self.lock.filter(frames)
        if self.lock.vehicle is None:
            return []
        self._state_of_flight.vehicle = self.lock.vehicle
        stretches = self._stretches(messages, parameters)
        return [samples for stretch in stretches for samples in self._read(stretch)]

    @np.errstate(over="ignore", invalid="ignore")
    def feed_rows(self, block: RecordBlock) -> list[SampleBlock]:
        """Take rows of a record in; return the samples that they complete, in order."""
        self.record = block.select(slice(0))
        self.command.armed = self.command.moved = True  # a record needs no check of its commands
        self.surfaces = record_surfaces(block, self.config)
        changes = np.flatnonzero(~(block.has_yaw | block.has_surfaces))
        samples: list[SampleBlock] = []
        for first, stop in pairwise([-1, *changes.tolist(), len(block)]):
            if first >= 0:
                self.segmenter.begin_segment(Held(int(block.held[first])))
            rows = block.select(slice(first + 1, stop))
            values = record_values(rows, self.config)
            lost = np.where(np.isnan(values[:, :-1]).any(axis=1), Held.RUDDER_INVALID.value, 0)
            yaw = self.yaw.read_record(rows.select(rows.has_yaw), lost[rows.has_yaw])
            # The surfaces of a row complete the sample before it, so they come first.
            surface = Series(2 * rows.order, rows.received_us, rows.t_us, values)
            surface = surface.select(rows.has_surfaces)
            self.surface_rows += len(surface)
            samples += self._segments(yaw, surface)
        return samples

    def finish(self) -> list[SampleBlock]:
        """Return the samples kept back until now because the first five seconds are incomplete."""
        if self.startup is None or not self.startup.give_up():
            return []
        return self._begin(self.startup)

    def motion(self) -> MotionBlock | None:
        """Return the lateral motion since the last call, with all that the samples since need.

        It is None where there is none: before the first samples, and without ``keeps_motion``.
        """
        return None if self._motion is None else self._motion.take()

    def _stretches(
        self, messages: Mapping[str, MessageBlock], parameters: list[MessageBlock]
    ) -> Iterator[Mapping[str, MessageBlock]]:
        """Yield the stretches of the block between changes of the surfaces or the yaw source."""
        flight = self._state_of_flight
        self.surfaces, self.aileron, flight.lift = self._find_all()
        low = -1
        for order, name in self._places_of_change(messages, parameters):
            found, is_better = self._find_all(), name in self.yaw.better
            if is_better or found != (self.surfaces, self.aileron, flight.lift):
                yield _between(messages, low, order)
                low, (self.surfaces, self.aileron, flight.lift) = order, found
            if is_better:
                if self.yaw.rows:
                    self.segmenter.begin_segment()
                self.yaw.source = name
        yield _between(messages, low, END)

    def _places_of_change(
        self, messages: Mapping[str, MessageBlock], parameters: list[MessageBlock]
    ) -> Iterator[tuple[int, str | None]]:
        """Yield each place at which a parameter or a first message, by its name, may change them.

        The places come in the stream's own order: no decision depends on what comes after it.
        """
        low, new = -1, (((OUTPUTS | {*STICKS}) - self.received) | {*self.yaw.better}) & {*messages}
        places = sorted((int(messages[name].order[0]), name) for name in new)
        for high, name in [*places, (END, None)]:
            for block in parameters:
                rows = (block.order >= low) & (block.order < high)
                yield from ((order, None) for order in self.parameters.changes(block.select(rows)))
            if name is not None:
                self.received |= {name} - SOURCES.keys()
                yield high, name
            low = high

    def _find_all(self) -> tuple[tuple[Surface, ...], Surface | None, dict[int, float]]:
        """Return the inputs' surfaces, the aileron and the lift motors by what is known now.

        While one of the inputs is missing there are no surfaces.
        """
        vehicle = self.lock.vehicle
        assert vehicle is not None
        found = [self._find(name, vehicle) for name in self.config.inputs]
        surfaces = tuple(surface for surface in found if surface is not None)
        if len({surface.message for surface in surfaces}) > 1:
            raise ConfigError("--rudder and --aileron must come from the same message")
        aileron, lift = self._find("aileron", vehicle), lift_motors(vehicle, self.parameters)
        return surfaces if len(surfaces) == len(found) else (), aileron, lift

    def _find(self, name: str, vehicle: Vehicle) -> Surface | None:
        """Return the surface ``rudder`` or ``aileron`` to read from now on, None if unknown."""
        selector = getattr(self.config, name)
        surface = find_surface(name, selector, vehicle, self.parameters, self.received)
        sign = -1.0 if self.config.rudder_sign == "nose-left" else 1.0
        scale = sign * self.config.half_travel if name == "rudder" else 1.0
        return None if surface is None else replace(surface, scale=scale)

    def _read(self, messages: Mapping[str, MessageBlock]) -> list[SampleBlock]:
        """Return the samples of one stretch."""
        surfaces = self.surfaces
        self._state_of_flight.observe(messages)
        if self._motion is not None:
            self._motion.observe(messages)
        yaw = self.yaw.read(messages, self._state_of_flight)
        self._surface.observe_clock(messages.get(self.yaw.source or ""))
        surface = self._surface.read(messages, surfaces, self.aileron)
        self.surface_rows += len(surface)
        samples: list[SampleBlock] = []
        if len(surface) and self._used and not all(map(Surface.same_meaning, self._used, surfaces)):
            # Rows before the first row of the new meaning still have the old one.
            early = yaw.order < surface.order[0]
            samples += self._segments(yaw.select(early), surface.select(slice(0, 0)))
            self.segmenter.begin_segment()
            yaw = yaw.select(~early)
        if len(surface):
            self._used = surfaces
        samples += self._segments(yaw, surface)
        self.command.observe(messages)
        return samples

    def _segments(self, yaw: Series, surface: Series) -> list[SampleBlock]:
        for flow, rows in zip(self.flows, (yaw, surface), strict=True):
            flow.observe(rows.t_us)
        if self.watch is not None:
            self.watch(yaw, surface)
        samples = []
        for piece in self.segmenter.feed_series(yaw, surface):
            self.command.observe_yaw(piece)
            self.parameters.observe_time(piece.boot, piece.yaw)
            self.boots.observe(piece.boot, piece.yaw)
            samples += self._align(piece)
        return samples

    def _align(self, piece: Piece) -> list[SampleBlock]:
        if self.startup is not None:
            return self._begin(self.startup) if self.startup.feed_piece(piece) else []
        assert self.aligner is not None
        if self._motion is not None:
            piece = self._motion.feed_piece(piece, len(ROW))
        block = self.aligner.feed_piece(piece)
        conditioned = None if block is None else self.conditioner.feed_samples(block)
        return [] if conditioned is None else self._chosen(conditioned, piece.boot)

    def _begin(self, startup: StartUp) -> list[SampleBlock]:
        """Fix the rate and return the samples of what was kept until now."""
        assert startup.intervals_us is not None
        self.intervals_us = startup.intervals_us
        sample_time_s = 1.0 / sample_rate(self.config.rate, startup.intervals_us)
        gaps_us = bridged_gaps_us(sample_time_s, startup.intervals_us)
        # The difference quotient of the yaw angle is taken on the grid itself.
        finer = self.config.band is not None and self.config.output != "yaw"
        count = finer_by(sample_time_s, min(startup.intervals_us)) if finer else 1
        measured = () if self.record is None else self.record.measured
        lines = [i for i, name in enumerate((*self.config.inputs, "aileron")) if name in measured]
        self.startup, self.aligner = None, Aligner(sample_time_s / count, gaps_us, lines)
        self.conditioner = Conditioner(self.config, sample_time_s, count)
        return [block for piece in startup.pieces for block in self._align(piece)]

    def _chosen(self, block: SampleBlock, boot: int) -> list[SampleBlock]:
        """Return the samples that --boot, --from and --to choose; these do not cut parameters."""
        if self.config.boot not in (None, boot):
            return []
        low, high = self.config.window_us
        rows = (block.boot_us >= low) & (block.boot_us <= high)
        if not rows.any():
            return []
        chosen = block if rows.all() else block.select(rows)
        self.used += int((chosen.held == 0).sum())
        self.fast += int((np.abs(chosen.y) > FAST_RAD_S).sum())
        return [chosen]


def _between(
    messages: Mapping[str, MessageBlock], low: int, high: int
) -> Mapping[str, MessageBlock]:
    """Return the messages at or after byte ``low`` and before ``high``."""
    if low < 0 and high == END:
        return messages
    chosen = {n: b.select((b.order >= low) & (b.order < high)) for n, b in messages.items()}
    return {name: block for name, block in chosen.items() if len(block)}
