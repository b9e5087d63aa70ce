"""A manoeuvre as the criterion needs it: measurements, and inputs after lag and delay.

A command that jumps from one servo message to the next is taken as a line between them. When it
jumped is not known: in SITL at 50 Hz it was 6 ms after the middle of the line, which made the roll
mode 17 % too fast. So how much later is sought for every jump, as start and trims are.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.estimation.all_pole import all_pole
from yawid.lateral.model import AILERON, RUDDER
from yawid.lateral.motion import COMMAND_STEP_S, Flags, Motion
from yawid.lateral.predictor import unused

AT_REST = 2e-3
"""Standard deviation of an aileron that does not move, in the unit of its channel."""
JUMP = 0.1
"""The least jump within a sample, as a share of what the command covers in the manoeuvre."""
MOST_JUMPS = 40
"""The most jumps, the largest of a manoeuvre, whose times are sought: each takes time."""
FOLLOWS = 0.85
"""R squared of the aileron on roll and p above which it follows them and does not jump."""
LEAST_DELAY_S, MOST_DELAY_S = 0.007, 0.05
"""Roll is taken at the times of its rates where it is later or earlier by this much. The model has
the rest to first order: of 12 ms in SITL, whose rates are filtered, it made the roll mode 18 % too
slow."""
SURELY_LATE = 10.0
"""The least delay in sigmas of white noise. Noise that is integrated has up to four of them by
chance, where roll hardly moves; in SITL it is over a hundred."""
_DRIFT = 5
"""The powers of time in a slow drift of roll from the integral of its rates."""
LEAST_LAG_S = 1e-9
_LEAST_LIFT = 0.25


class Record:
    """One manoeuvre. ``y`` (n, 3) are p, r and roll about their means, and lines where ``missing``.

    ``turn`` are means and slopes (n, 2) of f1 and f2 over each step; ``fed_back`` the R squared of
    the aileron on roll and p. An aileron that a hold moves is an input like any other: it depends
    on the past alone. ``jumps`` are those of the commands: aileron or rudder, the step of their
    grid in which it begins, and its size; ``jump_std_s`` is sigma of its time, of which only its
    sample is known. ``large`` (n, m) are what large motion adds to the inputs ``large_into`` (m,),
    each by a factor of its own, as means over each step: none until a fit asks for them.
    """

    def __init__(self, motion: Motion) -> None:
        self.motion, self.sample_time_s = motion, motion.sample_time_s
        columns = np.stack([motion.p, motion.r, motion.roll], axis=1)
        self.missing: Flags = np.isnan(columns.sum(axis=1))
        self.unused = unused(self.missing)
        self.times_s = np.asarray(np.arange(len(columns)) * self.sample_time_s, np.float64)
        self._filled = np.stack([self._fill(x) for x in (*columns.T, motion.pitch, motion.q)])
        self.roll_delay_s = self._take_roll_in_time()
        self.pitch = float(self._filled[3].mean())
        self.alpha = self._alpha()
        self.y = self._filled[:3].T - self._filled[:3].mean(axis=1)
        self.turn = self._turn()
        times = motion.command_times_s()
        self._inside: Flags = (times >= 0.0) & (times <= self.times_s[-1])
        commands = np.stack([motion.aileron, motion.rudder])
        self.commands = commands - commands[:, self._inside].mean(axis=1)[:, None]
        self.aileron_moves = motion.aileron_known and bool(
            self.commands[0, self._inside].std() > AT_REST
        )
        aileron, heard = self.commanded(0.0, 0.0)[:, 0], self.y[:, [0, 2]]
        self.fed_back = explained(aileron, heard) if self.aileron_moves else 0.0
        self.jump_std_s = self.sample_time_s / math.sqrt(12.0)
        self.large, self.large_into = np.zeros((len(self.y), 0)), np.zeros(0, int)

    @cached_property
    def jumps(self) -> list[tuple[int, int, float]]:
        """The largest jumps, as ``_jumps`` yields them: only a fit pays for them."""
        its = [RUDDER] if self.fed_back > FOLLOWS else [AILERON, RUDDER]
        jumps = [jump for surface in its for jump in self._jumps(surface)]
        return sorted(jumps, key=lambda jump: -abs(jump[2]))[:MOST_JUMPS]

    @cached_property
    def late(self) -> Floats:
        """What a jump by 1 adds (m,) to its command, from its step on, if it is later by 1 s.

        The jump may be anywhere in a sample. The step that is expected for a jump that is known to
        be late differs from the line by a parabola over that sample.
        """
        width = round(self.sample_time_s / COMMAND_STEP_S)
        from_middle_s = COMMAND_STEP_S * (np.arange(width + 1) - width // 2)
        within = np.clip(from_middle_s / self.sample_time_s + 0.5, 0.0, 1.0)
        parabola = within * (1.0 - within)
        return np.asarray(-parabola / (COMMAND_STEP_S * parabola.sum()), np.float64)

    def _fill(self, x: Floats) -> Floats:
        """Return x with lines over its gaps.

        Raises:
            ValueError: there is no sample.
        """
        known = np.isfinite(x)
        return np.asarray(np.interp(self.times_s, self.times_s[known], x[known]), np.float64)

    def _take_roll_in_time(self) -> float:
        """Take roll at the times of its rates, and return by how much later it was in s; or 0.

        Its difference from their integral is regressed on their sum and a slow drift. Between
        samples roll is a cubic.
        """
        p, _, roll, *_ = self._filled
        rate = p + self._turning()
        turned = np.append(0.0, np.cumsum(0.5 * self.sample_time_s * (rate[1:] + rate[:-1])))
        columns = np.column_stack([rate, np.vander(np.linspace(-1.0, 1.0, len(p)), _DRIFT)])
        found, *_ = np.linalg.lstsq(columns, roll - turned, rcond=None)
        delay_s, left = -float(found[0]), roll - turned - columns @ found
        power = np.linalg.pinv(columns.T @ columns)[0, 0]
        least_s = max(LEAST_DELAY_S, SURELY_LATE * math.sqrt(left.var() * power))
        if not least_s < abs(delay_s) < MOST_DELAY_S:
            return 0.0
        at = np.arange(len(p)) + delay_s / self.sample_time_s
        i = np.clip(np.floor(at), 1, len(p) - 3).astype(int)
        f = at - i
        self._filled[2] = (
            (f + 1.0) * (f - 1.0) * (f - 2.0) / 2.0 * roll[i]
            - (f + 1.0) * f * (f - 2.0) / 2.0 * roll[i + 1]
            + f * (f - 1.0) * ((f + 1.0) * roll[i + 2] - (f - 2.0) * roll[i - 1]) / 6.0
        )
        return delay_s

    def _turning(self) -> Floats:
        """Return what q and r add to the rate (n,) in rad/s of the roll angle."""
        _, r, roll, pitch, q = self._filled
        return np.asarray(np.tan(pitch) * (q * np.sin(roll) + r * np.cos(roll)), np.float64)

    def _alpha(self) -> float:
        """Return the mean angle of attack in rad that the flight path implies."""
        roll, pitch = self._filled[2:4]
        lift = np.maximum(np.cos(pitch) * np.cos(roll), _LEAST_LIFT)
        return float(np.mean(np.arctan((np.sin(pitch) - math.sin(self.motion.climb)) / lift)))

    def _turn(self) -> tuple[Floats, Floats]:
        _, r, roll, pitch, _ = self._filled
        force = np.cos(pitch) * np.sin(roll) - math.cos(self.pitch) * roll
        rolling = self._turning() - math.tan(self.pitch) * r
        both = np.stack([force, rolling], axis=1)
        both -= both.mean(axis=0)
        after = np.vstack([both[1:], both[-1:]])
        mean, slope = 0.5 * (both + after), (after - both) / self.sample_time_s
        return np.asarray(mean, np.float64), np.asarray(slope, np.float64)

    def _jumps(self, surface: int) -> Iterator[tuple[int, int, float]]:
        """Yield the surface of each jump in a sample, the step in which it begins, and its size."""
        width, u = round(self.sample_time_s / COMMAND_STEP_S), self.commands[surface]
        change = np.where(self._inside[:-width], u[width:] - u[:-width], 0.0)
        large = np.abs(change) > JUMP * np.ptp(u[self._inside])
        edges = np.flatnonzero(np.diff(np.sign(change) * large, prepend=0.0, append=0.0))
        for start, stop in pairwise(edges.tolist()):
            if large[start]:
                at = start + int(np.abs(change[start:stop]).argmax())
                yield surface, at, float(change[at])

    def inputs(self, lag_s: float, delay_s: float, own: Sequence[float] | Floats = ()) -> Floats:
        """Return the inputs (n, 8) over each step: aileron, rudder, f1 and f2, then their slopes.

        Each is the line with the input's area and first moment over the step. ``own`` are by how
        much later each jump comes, and the factors of ``large``, or nothing.
        """
        commands, factors = self.commands.copy(), own[len(self.jumps) :]
        for by_s, (surface, at, size) in zip(own, self.jumps, strict=False):
            commands[surface, at : at + len(self.late)] += by_s * size * self.late
        mean, slope = self._lines(commands, lag_s, self._cells(delay_s)[None])
        found = np.hstack([mean.T, self.turn[0], slope.T, self.turn[1]])
        for factor, into, c in zip(factors, self.large_into, self.large.T, strict=False):
            found[:, into] += factor * c
        return found

    def later(self, lag_s: float, delay_s: float) -> tuple[Ints, Ints, Floats]:
        """Return what jumps that are later by 1 s add to their surfaces, for each jump.

        They are its surface (j,), the first step (j,) in which it adds anything, and from there on
        what it adds to the surface's mean and slope (2, j, s); beyond the last of these steps that
        fades with the lag.
        """
        jumps = np.array(self.jumps).reshape(-1, 3)
        (surface, at), size = jumps[:, :2].astype(int).T, jumps[:, 2:]
        width, begin = len(self.late), np.maximum(at - 1, 0)[:, None]
        steps = 3 + math.ceil(4 / (width - 1))
        rows, cells = np.zeros((len(at), (steps + 1) * width)), self._cells(delay_s)
        within = at[:, None] - begin + np.arange(width)
        np.put_along_axis(rows, within, size * self.late, axis=1)
        first = np.clip(np.searchsorted(cells, begin, "right") - 1, 0, len(cells) - 1 - steps)
        added = self._lines(rows, lag_s, cells[first + np.arange(steps + 1)] - begin)
        return surface, first[:, 0], np.stack(added)

    def _cells(self, delay_s: float) -> Floats:
        """Return the edges of the steps (n + 1,), in steps of the commands' grid from its begin."""
        edges_s = np.append(self.times_s, self.times_s[-1] + self.sample_time_s)
        return (edges_s - delay_s - self.motion.commands_start_s) / COMMAND_STEP_S

    def _lines(self, signals: Floats, lag_s: float, edges: Floats) -> tuple[Floats, Floats]:
        """Return means and slopes (s, n) of signals (s, m) after a lag, from edge to edge.

        The edges (s or 1, n + 1) are in steps of the commands' grid. Mean and slope are those of
        the line with the signal's area and first moment. The lag is exact at the points of the
        commands' grid; between them the signal is a line, so that its integral, and the integral of
        that, are known at every time but for constants.
        """
        h, step_s = COMMAND_STEP_S, self.sample_time_s
        x = lagged_lines(signals, lag_s, h)
        area = h * (np.cumsum(x, axis=1) - 0.5 * x)
        twice = h * (np.cumsum(area, axis=1) - 0.5 * area) - h**2 / 12.0 * x
        i = np.clip(edges + 1e-9, 0, x.shape[1] - 2).astype(int)
        x_i, after, area, twice = (
            np.take_along_axis(each, at, axis=1)
            for each, at in ((x, i), (x, i + 1), (area, i), (twice, i))
        )
        into, bent = h * (edges - i), (edges - i) * (after - x_i)
        twice = twice + into * (area + into * (x_i / 2.0 + bent / 6.0))
        area = area + into * (x_i + bent / 2.0)
        moment = 0.5 * step_s * (area[:, 1:] + area[:, :-1]) - np.diff(twice)
        return np.diff(area) / step_s, moment * 12.0 / step_s**3

    def commanded(self, lag_s: float, delay_s: float) -> Floats:
        """Return aileron and rudder (n, 2) at each instant."""
        at_s, times_s = self.times_s - delay_s, self.motion.command_times_s()
        lagged = lagged_lines(self.commands, lag_s, COMMAND_STEP_S)
        return np.stack([np.interp(at_s, times_s, x) for x in lagged], axis=1)


def explained(x: Floats, by: Floats) -> float:
    """Return R squared of x (n,) on columns (n, m) and a constant."""
    columns = np.column_stack([by, np.ones(len(x))])
    left = x - columns @ np.linalg.lstsq(columns, x, rcond=1e-9)[0]
    return 1.0 - float(left.var()) / max(float(x.var()), np.finfo(float).tiny)


def lagged_lines(signals: Floats, lag_s: float, step_s: float) -> Floats:
    """Return signals (s, m), linear between instants a step apart, after a lag of first order."""
    if lag_s < LEAST_LAG_S:
        return signals
    stays = math.exp(-step_s / lag_s)
    mean = lag_s / step_s * (1.0 - stays)
    u = signals.T
    before = np.vstack([u[:1], u[:-1]])
    drive = (mean - stays) * before + (1.0 - mean) * u
    return np.asarray(all_pole(np.array([-stays]), drive, u[:1]).T, np.float64)
