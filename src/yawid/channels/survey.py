"""A survey of a flight: its message intervals, and its stretches of flight mode and state.

It observes the channels while they are read, and changes nothing.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.channels.segments import BACK_STEP_US, REBOOT_US
from yawid.channels.series import Series
from yawid.channels.yaw_reader import MODE, ON_GROUND

AIRBORNE, GROUNDED, UNKNOWN = range(3)
"""The states of a phase; unknown is for a vehicle that reports neither speed nor state."""


@dataclass(slots=True)
class Phase:
    """A stretch in one flight mode and one state, in us since the boot, which is counted from 1.

    ``mode`` is HEARTBEAT.custom_mode, -1 before it is known.
    """

    boot: int
    from_us: int
    to_us: int
    mode: int
    state: int

    @property
    def seconds(self) -> float:
        """The duration in s."""
        return (self.to_us - self.from_us) / 1e6


@dataclass(frozen=True, slots=True)
class Intervals:
    """The time from message to message in s: its median, and its 5th and 95th percentiles."""

    messages: int
    median_s: float
    p5_s: float
    p95_s: float

    @property
    def rate_hz(self) -> float:
        """The rate at the median interval."""
        return 1.0 / self.median_s


@dataclass(slots=True)
class Survey:
    """The notes on rows of yaw and surfaces as they are read (``Channels.watch``)."""

    phases: list[Phase] = field(default_factory=list)
    _yaw_us: list[Ints] = field(default_factory=list)
    _surface_us: list[Ints] = field(default_factory=list)

    def note(self, yaw: Series, surface: Series) -> None:
        """Take in the rows of one stretch of the stream."""
        self._yaw_us.append(yaw.t_us)
        self._surface_us.append(surface.t_us)
        if len(yaw):
            self._note_phases(yaw.t_us, *_mode_and_state(yaw.values))

    def intervals(self) -> tuple[Intervals | None, Intervals | None]:
        """Return the intervals of yaw and of surface messages, None for fewer than two."""
        return _intervals(self._yaw_us), _intervals(self._surface_us)

    def _note_phases(self, t_us: Ints, mode: Ints, state: Ints) -> None:
        back = np.diff(t_us) <= -BACK_STEP_US
        changes = back | (np.diff(mode) != 0) | (np.diff(state) != 0)
        starts = [0, *(np.flatnonzero(changes) + 1).tolist()]
        for first, stop in zip(starts, [*starts[1:], len(t_us)], strict=True):
            times = t_us[first:stop]
            self._note_run(times, int(mode[first]), int(state[first]))

    def _note_run(self, t_us: Ints, mode: int, state: int) -> None:
        boot, last = 1, self.phases[-1] if self.phases else None
        if last is not None:
            is_reboot = int(t_us[0]) < last.to_us - REBOOT_US
            boot = last.boot + is_reboot
            if not is_reboot and (mode, state) == (last.mode, last.state):
                last.to_us = max(last.to_us, int(t_us.max()))
                return
        self.phases.append(Phase(boot, int(t_us[0]), int(t_us.max()), mode, state))


def _mode_and_state(values: Floats) -> tuple[Ints, Ints]:
    """Return flight mode (n,) and state (n,) of rows of yaw."""
    reported = np.where(np.isfinite(values[:, MODE]), values[:, MODE], -1.0)
    state = np.full(len(values), UNKNOWN)
    state[values[:, ON_GROUND] == 0.0] = AIRBORNE
    state[values[:, ON_GROUND] == 1.0] = GROUNDED
    return reported.astype(np.int64), state


def _intervals(times_us: list[Ints]) -> Intervals | None:
    t_us = np.concatenate(times_us) if times_us else np.zeros(0, np.int64)
    steps = np.diff(t_us)
    steps = steps[steps > 0]  # a message received twice or a reboot makes no interval
    if len(steps) < 2:
        return None
    low, middle, high = (float(s) / 1e6 for s in np.percentile(steps, [5.0, 50.0, 95.0]))
    return Intervals(len(t_us), middle, low, high) if math.isfinite(middle) else None
