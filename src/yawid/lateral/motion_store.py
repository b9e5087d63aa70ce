"""The newest lateral motion, kept until the manoeuvre under way has ended, and a manoeuvre's part.

Attitudes are put on a grid of their own, since their messages jitter; the commands on a fine one,
on straight lines between their own times. A manoeuvre's rows are those of its own clock: the same
time may come again after a reboot, and the Unix time says which of them is meant.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from yawid.blocks import Floats, MotionBlock, SampleBlock, StampedRows
from yawid.lateral.motion import COMMAND_STEP_S, LEAD_S, Motion
from yawid.quantities.airspeed import true_of_equivalent

BEHIND_S = 40.0
"""The time in s for which a manoeuvre may wait for its end to be decided, and its lead."""
SMALL_ROWS = 1000
"""The rows up to which new motion is added to the last block, of which there are then few."""
ROUNDED_S = 0.0012
"""The range in s of what rounding to ms, as of ATTITUDE, adds to times that are even."""
LEAST_ROWS = 50
"""The fewest attitudes of a manoeuvre."""
LEAST_STEP_S = 0.0195
"""Faster attitudes are averaged to about this step: above 50 Hz they show vibration, no motion."""
BRIDGED = 1.7
"""The longest interval between attitudes that is interpolated, in steps."""
NEAR = 0.25
"""An instant that is nearer to an attitude than this part of a step has it also next to a gap."""
STEEPEST = 0.5
"""The largest sine of the angle of climb: what is beyond it is no altitude."""
LONGEST_COMMAND_S = 0.5
"""The longest interval between two servo messages in which the commands count as known."""


class MotionStore:
    """The rows of the newest ``longest_s`` seconds and of those before that may be needed."""

    def __init__(self, longest_s: float) -> None:
        self._kept_us = round(1e6 * (longest_s + BEHIND_S))
        self._blocks: list[MotionBlock] = []

    def feed(self, block: MotionBlock) -> None:
        """Take motion in, before the samples of the same time."""
        if not len(block):
            return
        if self._blocks and len(self._blocks[-1]) < SMALL_ROWS:
            block = MotionBlock.joined([self._blocks.pop(), block])
        self._blocks.append(block)

    def forget(self, samples: SampleBlock) -> None:
        """Forget whole blocks that no manoeuvre ending after these samples can need."""
        low_ns = int(samples.unix_ns[-1]) - 1000 * self._kept_us
        while self._blocks and _newest_ns(self._blocks[0]) < low_ns:
            del self._blocks[0]

    def cut(self, samples: SampleBlock) -> Motion | str:
        """Return the motion of a manoeuvre's samples, or in words what is missing of it."""
        if not self._blocks:
            return "the log has no attitude with roll and roll rate"
        if (np.diff(samples.k) < 0).any():
            return "the vehicle rebooted during it"
        used = samples.select((samples.held == 0) & (samples.airspeed > 0.0))
        if not len(used):
            return "the airspeed is not known"
        airspeed_m_s = float(true_of_equivalent(used.airspeed, used.altitude).mean())
        block = MotionBlock.joined(self._blocks)
        first_us, last_us = int(samples.boot_us[0]), int(samples.boot_us[-1])
        attitude = _rows(block.attitude, samples, first_us, last_us, 0)
        if len(attitude) < LEAST_ROWS:
            return f"it has {len(attitude)} attitudes with roll and roll rate"
        its = block.commands.values[:, 2] == samples.epoch[-1]
        before_us = round(1e6 * (LEAD_S + LONGEST_COMMAND_S))
        commands = _rows(block.commands.select(its), samples, first_us - before_us, last_us, 2)
        found, climb = (
            motion_of(attitude, commands, airspeed_m_s),
            angle_of_climb(samples, airspeed_m_s),
        )
        return found if isinstance(found, str) else replace(found, climb=climb)


def motion_of(attitude: StampedRows, commands: StampedRows, airspeed_m_s: float) -> Motion | str:
    """Return the motion on its grids, or in words why there is none; times begin at the first row.

    The step of the grid is that of the slower of attitudes and commands.
    """
    t_s = _without_rounding((attitude.t_us - attitude.t_us[0]) / 1e6)
    interval_s = float(np.median(np.diff(t_s)))
    commands = commands.select(np.isfinite(commands.values[:, 0]))
    ailerons = commands.values[:, 1]
    command_s = (commands.t_us - attitude.t_us[0]) / 1e6
    if len(command_s) < 2 or not (command_s[0] <= 0.0 and command_s[-1] >= t_s[-1]):
        return "the commands do not cover it"
    if (longest_s := float(np.diff(command_s[command_s >= -LEAD_S]).max())) > LONGEST_COMMAND_S:
        return f"there is no servo message for {longest_s:.2g} s of it"
    aileron_known = bool(np.isfinite(ailerons).all())
    step_s = max(interval_s, float(np.median(np.diff(command_s))), LEAST_STEP_S)
    count = max(1, round(step_s / interval_s))
    step_s = count * interval_s
    grid_s = np.arange(math.floor(t_s[-1] / step_s + 1e-6) + 1) * step_s
    roll, pitch, p, q, r = _on_grid(t_s, _averaged(attitude.values, count), grid_s, step_s).T
    start_s = -COMMAND_STEP_S * math.floor(-max(command_s[0], -LEAD_S) / COMMAND_STEP_S)
    steps = math.floor((command_s[-1] - start_s) / COMMAND_STEP_S + 1e-9)
    fine_s = start_s + COMMAND_STEP_S * np.arange(steps + 1)
    rudder = np.interp(fine_s, command_s, commands.values[:, 0])
    return Motion(
        sample_time_s=step_s, p=p, r=r, roll=roll, pitch=pitch, q=q,
        commands_start_s=start_s, rudder=rudder,
        aileron=np.interp(fine_s, command_s, ailerons) if aileron_known else np.zeros_like(rudder),
        airspeed_m_s=airspeed_m_s, commands_exact=bool((commands.values[:, 3] == 1.0).all()),
        aileron_known=aileron_known,
    )  # fmt: skip


def angle_of_climb(samples: SampleBlock, airspeed_m_s: float) -> float:
    """Return the mean angle of climb in rad, 0 where the altitude is not known."""
    known = np.isfinite(samples.altitude)
    t_s, altitude = samples.boot_us[known] / 1e6, samples.altitude[known]
    if len(t_s) < LEAST_ROWS:
        return 0.0
    rate = float(np.polyfit(t_s - t_s.mean(), altitude, 1)[0])
    return math.asin(min(max(rate / airspeed_m_s, -STEEPEST), STEEPEST))


def _newest_ns(block: MotionBlock) -> int:
    parts = (block.attitude, block.commands, block.acceleration)
    return max(int(part.unix_ns[-1]) for part in parts if len(part))


def _rows(
    rows: StampedRows, samples: SampleBlock, first_us: int, last_us: int, more: int
) -> StampedRows:
    """Return the rows from one time to another, and ``more`` after them, on the samples' clock.

    Of the stretches between two reboots it is the one with the samples' Unix time at their end.
    """
    end_us, end_ns = int(samples.boot_us[-1]), int(samples.unix_ns[-1])
    edges = {0, *(np.flatnonzero(np.diff(rows.t_us) < 0) + 1).tolist(), len(rows)}

    def away_ns(run: tuple[int, int]) -> int:
        at = min(int(np.searchsorted(rows.t_us[slice(*run)], end_us)) + run[0], run[1] - 1)
        return abs(int(rows.unix_ns[at]) - 1000 * int(rows.t_us[at] - end_us) - end_ns)

    own = rows.select(slice(*min(pairwise(sorted(edges)), key=away_ns, default=(0, 0))))
    first, stop = np.searchsorted(own.t_us, (first_us, last_us + 1)).tolist()
    return own.select(slice(first, stop + more))


def _without_rounding(t_s: Floats) -> Floats:
    """Return times (n,) of messages sent evenly without their rounding to ms; others as they are.

    Rounding is slow to change where messages come at almost whole ms: it colours what is left.
    """
    steps = np.diff(t_s)
    number = np.concatenate([[0.0], np.cumsum(np.rint(steps / np.median(steps)))])
    slope, first = np.polyfit(number, t_s, 1)
    even = first + slope * number
    return np.asarray(even if np.ptp(t_s - even) < ROUNDED_S else t_s, np.float64)


def _averaged(values: Floats, count: int) -> Floats:
    """Return the means of ``count`` rows around each row of values (n, m), fewer at the ends."""
    if count == 1:
        return values
    weights = np.ones(count + 1 - count % 2)  # an odd number has a middle
    within = np.convolve(np.ones(len(values)), weights, "same")
    return np.column_stack([np.convolve(x, weights, "same") / within for x in values.T])


def _on_grid(t_s: Floats, values: Floats, grid_s: Floats, step_s: float) -> Floats:
    """Return values (n, m) at instants (k,) on straight lines, NaN in gaps."""
    after = np.clip(np.searchsorted(t_s, grid_s), 1, len(t_s) - 1)
    left, right = grid_s - t_s[after - 1], t_s[after] - grid_s
    lost = (left + right > BRIDGED * step_s) & (np.minimum(left, right) > NEAR * step_s)
    found = np.column_stack([np.interp(grid_s, t_s, x) for x in values.T])
    return np.where(lost[:, None], np.nan, found)
