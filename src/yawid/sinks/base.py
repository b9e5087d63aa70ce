"""The interface of a sink, which takes the results of a pipeline, and the events that it takes."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

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


class RunRows(NamedTuple):
    """Consecutive samples with their estimates, by method, the primary one first, and its modes."""

    samples: SampleBlock
    estimates: Mapping[str, EstimateBlock]
    modes: ModesBlock


@dataclass(frozen=True, slots=True)
class Found:
    """A manoeuvre and its answer; ``span_ns``: Unix times in ns of its first and last sample.

    It comes some time after the row of its last sample, in a live run later than in a replay.
    """

    manoeuvre: Manoeuvre
    span_ns: tuple[int, int]


@dataclass(frozen=True, slots=True)
class FoundBare:
    """The bare airframe of manoeuvre ``n``, which comes after its answer as flown."""

    n: int
    bare: Bare
    span_ns: tuple[int, int]


@dataclass(frozen=True, slots=True)
class LogLine:
    """One message for people, with its Unix time in ns; it may also come before the grid."""

    unix_ns: int
    level: LogLevel
    text: str


@dataclass(frozen=True, slots=True)
class Flush:
    """What is complete is to be written out; it comes after every block of a live run.

    A sink acts at most twice a second, so that a live file does not consist of chunks of one
    sample. Therefore it has to come while the link is silent, too.
    """


@dataclass(frozen=True, slots=True)
class Done:
    """The end: the verdict in ``summary`` and the attachments; a file gets its name."""

    summary: RunSummary
    attachments: Mapping[str, bytes]


@dataclass(frozen=True, slots=True)
class Abort:
    """The end after an error: the file stays as readable as possible, or goes if ``discard``."""

    discard: bool = False


Event: TypeAlias = Grid | RunRows | MotionBlock | Found | FoundBare | LogLine | Flush | Done | Abort
"""What a sink takes: the grid once it is known, then rows with their motion before them, answers,
and :class:`Done` or :class:`Abort` at last. A run whose grid never becomes known ends without it.
"""


class Sink:
    """A taker of a run's events. By default it takes nothing: a sink names those it needs."""

    path: Path | None = None
    """The final name of the sink's file, which may be changed until ``Done``; None: no file."""

    def take(self, event: Event) -> None:
        """Take one event.

        Raises:
            SinkError: it cannot be written; never of :class:`Abort`.
        """


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
