"""What every sink offers the pipeline."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from yawid.answers.run_summary import Manoeuvre, RunSummary
from yawid.blocks import EstimateBlock, ModesBlock, SampleBlock
from yawid.quantities.units import HALF_TRAVEL
from yawid.quantities.vehicles import mode_name

LogLevel = Literal["debug", "info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Grid:
    """What the rows of a run mean, the same from its first row to its last.

    ``parameters`` (p,) names theta, ``inputs`` (n_inputs,) the columns of u, ``methods`` the
    estimators, the first asked for before the others. The rudder is in ``rudder_unit``, the aileron
    in half travel. ``autopilot`` and ``vehicle_type`` are HEARTBEAT's numbers, by which a flight
    mode has its name; 0 where unknown.
    """

    parameters: tuple[str, ...]
    inputs: tuple[str, ...]
    methods: tuple[str, ...]
    sample_time_s: float
    rudder_unit: str = HALF_TRAVEL
    autopilot: int = 0
    vehicle_type: int = 0

    def unit_of(self, surface: str) -> str:
        """Return the unit of an input."""
        return self.rudder_unit if surface == "rudder" else HALF_TRAVEL

    def mode_name(self, custom_mode: float) -> str:
        """Return the name of HEARTBEAT.custom_mode, ``unknown`` where that is NaN."""
        if math.isnan(custom_mode):
            return "unknown"
        return mode_name(self.autopilot, self.vehicle_type, int(custom_mode))


def rudder_unit(*, in_rad: bool) -> str:
    """Return the unit of a rudder that is in rad or not."""
    return "rad" if in_rad else HALF_TRAVEL


class Sink:
    """Where results go: ``start`` once the grid is known, ``write`` per block, then ``finish``.

    ``log`` and ``flush`` may be called at any time before the end, also before ``start``; a run
    that never came to a grid is finished without it. Every method may raise
    :class:`yawid.errors.SinkError` except ``abort`` and ``discard``, which take the place of
    ``finish`` after an error. By default each does nothing: a sink has those that concern it.
    """

    path: Path | None = None
    """The name that its file gets when finished; it may be changed until then. None: no file."""

    def start(self, grid: Grid) -> None:
        """Say what the rows will mean."""

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """Add one row for each sample; ``modes`` are those of the primary method, the first key."""

    def manoeuvre(self, found: Manoeuvre, span_ns: tuple[int, int]) -> None:
        """Add a manoeuvre and its answer; ``span_ns`` is Unix time of its first and last sample.

        It comes some time after the last sample's row, live later than in a replay.
        """

    def log(self, unix_ns: int, level: LogLevel, text: str) -> None:
        """Add one line for people."""

    def flush(self) -> None:
        """Bring out what is complete: made to be called after every block of a live run.

        It acts at most twice a second, so that a live file is not made of chunks of one sample:
        call it when the link is silent too.
        """

    def finish(self, summary: RunSummary, attachments: Mapping[str, bytes]) -> None:
        """Add the verdict of ``summary``, close, and give the file its final name."""

    def abort(self) -> None:
        """Close without the final name, as readable as it can be; never raises."""

    def discard(self) -> None:
        """Abort and remove what was written, which is this sink's own; never raises."""
        self.abort()


Call = Callable[[Sink], None]


class Relay(Sink):
    """A sink that hands every call to another one, by ``_hand``: where, when, and if at all."""

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

    def manoeuvre(self, found: Manoeuvre, span_ns: tuple[int, int]) -> None:
        """See :class:`Sink`."""
        self._hand(lambda sink: sink.manoeuvre(found, span_ns))

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
    """Says at most once in ``period_s`` seconds of wall time that something is due."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = float("-inf")

    def due(self) -> bool:
        """Whether the period has passed since this was last true."""
        now = time.monotonic()
        if now < self._next_s:
            return False
        self._next_s = now + self._period_s
        return True
