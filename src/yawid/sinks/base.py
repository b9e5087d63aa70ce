"""The interface of a sink, which takes the results of a pipeline."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from yawid.answers.run_summary import Bare, Manoeuvre, RunSummary
from yawid.blocks import EstimateBlock, ModesBlock, MotionBlock, SampleBlock
from yawid.quantities.units import HALF_TRAVEL
from yawid.quantities.vehicles import mode_name

LogLevel = Literal["debug", "info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Grid:
    """The meaning of a run's rows, the same from the first row to the last.

    ``parameters`` (p,) names theta, ``inputs`` (n_inputs,) the columns of u, ``methods`` the
    estimators, the primary one first. The rudder is in ``rudder_unit``, the aileron in half travel.
    ``autopilot`` and ``vehicle_type`` are the numbers in HEARTBEAT, on which the names of flight
    modes depend; 0 where unknown.
    """

    parameters: tuple[str, ...]
    inputs: tuple[str, ...]
    methods: tuple[str, ...]
    sample_time_s: float
    rudder_unit: str = HALF_TRAVEL
    autopilot: int = 0
    vehicle_type: int = 0

    def unit_of(self, surface: str) -> str:
        """Return the unit of an input, rudder or aileron."""
        return self.rudder_unit if surface == "rudder" else HALF_TRAVEL

    def mode_name(self, custom_mode: float) -> str:
        """Return the name of HEARTBEAT.custom_mode, ``unknown`` where that is NaN."""
        if math.isnan(custom_mode):
            return "unknown"
        return mode_name(self.autopilot, self.vehicle_type, int(custom_mode))


class Sink:
    """A taker of results: ``start`` once the grid is known, ``write`` per block, then ``finish``.

    ``log`` and ``flush`` may be called at any time before the end, also before ``start``; a run
    whose grid never becomes known is finished without ``start``. Every method may raise
    :class:`yawid.errors.SinkError` except ``abort`` and ``discard``, which take the place of
    ``finish`` after an error. By default each does nothing: a sink overrides those it needs.
    """

    path: Path | None = None
    """The final name of the sink's file, which may be changed until ``finish``; None: no file."""

    def start(self, grid: Grid) -> None:
        """Take the meaning of the rows that follow."""

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """Add one row for each sample; ``modes`` belong to the primary method, the first key."""

    def motion(self, block: MotionBlock) -> None:
        """Add lateral motion, which comes before the samples of the same time."""

    def manoeuvre(self, found: Manoeuvre, span_ns: tuple[int, int]) -> None:
        """Add a manoeuvre and its answer; ``span_ns``: Unix times in ns of first and last sample.

        It comes some time after the row of its last sample, in a live run later than in a replay.
        """

    def lateral(self, n: int, bare: Bare, span_ns: tuple[int, int]) -> None:
        """Add the bare airframe of manoeuvre ``n``, which comes after its answer as flown."""

    def log(self, unix_ns: int, level: LogLevel, text: str) -> None:
        """Add one message for people, with its Unix time in ns."""

    def flush(self) -> None:
        """Write out what is complete; to be called after every block of a live run.

        It acts at most twice a second, so that a live file does not consist of chunks of one
        sample. Therefore it has to be called while the link is silent, too.
        """

    def finish(self, summary: RunSummary, attachments: Mapping[str, bytes]) -> None:
        """Add the verdict in ``summary`` and the attachments, close, give the file its name."""

    def abort(self) -> None:
        """Close without the final name, the file as readable as possible; never raises."""

    def discard(self) -> None:
        """Abort and remove the sink's own file; never raises."""
        self.abort()


Call = Callable[[Sink], None]


class Relay(Sink):
    """A sink that hands every call to another; ``_hand`` decides where, when and whether."""

    def _hand(self, call: Call) -> object:
        raise NotImplementedError

    def start(self, grid: Grid) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.start(grid))

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.write(samples, estimates, modes))

    def motion(self, block: MotionBlock) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.motion(block))

    def manoeuvre(self, found: Manoeuvre, span_ns: tuple[int, int]) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.manoeuvre(found, span_ns))

    def lateral(self, n: int, bare: Bare, span_ns: tuple[int, int]) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.lateral(n, bare, span_ns))

    def log(self, unix_ns: int, level: LogLevel, text: str) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.log(unix_ns, level, text))

    def flush(self) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.flush())

    def finish(self, summary: RunSummary, attachments: Mapping[str, bytes]) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.finish(summary, attachments))

    def abort(self) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.abort())


class Pace:
    """A clock by which something is due once in ``period_s`` seconds of wall time at most."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = float("-inf")

    def due(self) -> bool:
        """Return whether the period has passed since this last returned True."""
        now = time.monotonic()
        if now < self._next_s:
            return False
        self._next_s = now + self._period_s
        return True
