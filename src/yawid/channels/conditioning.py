"""Conditioning on the grid: the choice of the output, turns removed, one filter for all channels.

The filter works on the samples of the grid and is the same for every input and the output, so that
it does not change the relation between them: if y = G u, then F y = G F u exactly. Vibration above
half the rate of the grid would appear in the samples as a slow motion (aliasing), which no filter
on the grid could remove. So with ``--band``, where messages come faster than the grid, the upper
corner acts on a finer one: the channels are aligned on a grid as fine as their messages, pass the
same Butterworth low-pass there, and are reduced to the grid, y at the instant and u as the mean
over the interval as always. SciPy is loaded only for a band, because that takes half a second.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from yawid.blocks import (
    AIRSPEED_SHARE,
    LEAST_TRAVEL,
    Floats,
    Held,
    Ints,
    Noted,
    SampleBlock,
    runs_of,
    strokes,
    window_of,
)
from yawid.config.run import DEFAULT_MEMORY_S, RATE_SLACK, RunConfig
from yawid.errors import ConfigError

FULL_TRAVEL = 0.99
"""A rudder counts as saturated if its deflection reaches this part of the full one."""
BAND_ORDER = 2
"""The order of the Butterworth filter at either end of the band."""


def butterworth(corner_hz: float | tuple[float, float], kind: str, rate_hz: float) -> Floats:
    """Return the Butterworth filter of one end of the band, or of both, as sections (n, 6).

    Raises:
        ConfigError: the upper edge of a band is not below half the rate.
    """
    from scipy.signal import butter

    if isinstance(corner_hz, tuple) and not corner_hz[1] < rate_hz / 2.0:
        raise ConfigError(
            f"--band reaches {corner_hz[1]:g} Hz: at {rate_hz:g} Hz it must end below "
            f"{rate_hz / 2.0:g} Hz"
        )
    sections: Floats = butter(BAND_ORDER, corner_hz, kind, fs=rate_hz, output="sos")
    return sections


class Conditioner:
    """The way from aligned samples to those of the estimators, with the state of the filters.

    With a band, ``count`` finer samples make one of the grid.

    Raises:
        ConfigError: the band does not fit the rate.
    """

    def __init__(self, config: RunConfig, sample_time_s: float, count: int = 1) -> None:
        self.config, self.sample_time_s, self.count = config, sample_time_s, count
        self._last: tuple[int, float, float] | None = None
        self._notes = Notes(sample_time_s, config.half_travel)
        self._filters: list[GridFilter] = []
        if config.band is not None:
            rate_hz = 1.0 / sample_time_s
            sections = butterworth(config.band, "bandpass", rate_hz)
            if count > 1:  # the upper corner acts only on the finer samples
                low = butterworth(config.band[1], "low", count * rate_hz)
                self._filters.append(GridFilter(low, count, sample_time_s))
                sections = butterworth(config.band[0], "high", rate_hz)
            self._filters.append(GridFilter(sections))

    def feed_samples(self, block: SampleBlock) -> SampleBlock | None:
        """Return the block conditioned, None where it completes no sample of the grid.

        Samples for which something is missing become held.
        """
        at_stop = np.abs(np.nan_to_num(block.u[:, 0])) >= FULL_TRAVEL * self.config.stop
        block = replace(block, noted=block.noted + int(Noted.SATURATED) * at_stop)
        if self.config.output == "yaw":
            block = self._differenced(block)
        if self.config.turn == "remove":
            unknown = (block.held == 0) & np.isnan(block.turn_rate)
            held = block.held + int(Held.NO_AIRSPEED) * unknown
            block = replace(block, y=block.y - block.turn_rate, held=held)
        for each in self._filters:
            if (filtered := each.feed_samples(block)) is None:
                return None
            block = filtered
        held = block.held != 0
        u = np.where(held[:, None], np.nan, block.u)
        return self._notes.feed_samples(replace(block, u=u, y=np.where(held, np.nan, block.y)))

    def _differenced(self, block: SampleBlock) -> SampleBlock:
        """Return the block with output (psi(k) - psi(k-1)) / Ts: the integrator is no free pole.

        ``turn_rate`` becomes the mean of both ends, since the output is the mean rate between them.
        """
        good = block.held == 0
        k, yaw, turn = block.k[good], block.yaw[good], block.turn_rate[good]
        if len(k) == 0:
            return block
        last_k, last_yaw, last_turn = self._last or (k[0] - 2, np.nan, np.nan)
        self._last = (int(k[-1]), float(yaw[-1]), float(turn[-1]))
        adjacent = np.diff(k, prepend=last_k) == 1
        y, mean_turn, held = np.full(len(block), np.nan), block.turn_rate.copy(), block.held.copy()
        y[good] = np.diff(yaw, prepend=last_yaw) / self.sample_time_s
        mean_turn[good] = 0.5 * (turn + np.append(last_turn, turn[:-1]))
        held[good] = np.where(adjacent & np.isfinite(y[good]), 0, int(Held.GAP))
        return replace(block, y=y, turn_rate=mean_turn, held=held)


def finer_by(sample_time_s: float, interval_us: float) -> int:
    """Return how many fine samples make one of the grid, by the shortest message interval."""
    return max(1, math.ceil(RATE_SLACK * 1e6 * sample_time_s / interval_us))


@dataclass(slots=True)
class GridFilter:
    """One filter for inputs and output alike; it keeps its state from block to block.

    With a ``count`` above 1 it makes one sample of the grid, of ``sample_time_s``, of so many fine
    ones, y at the instant and u as the mean. A sample of the grid is held if one of its fine
    samples is, for the same reasons. If fine samples are missing without a reason, it is at the
    edge of a gap or of the log and is left out.
    """

    sections: Floats
    count: int = 1
    sample_time_s: float = 0.0
    _state: Floats | None = None
    _open: SampleBlock | None = None

    def feed_samples(self, block: SampleBlock) -> SampleBlock | None:
        """Return the samples of the grid that these complete, with u, aileron and y filtered."""
        fine = self._filtered(block)
        if self.count == 1:
            return fine
        if self._open is not None and self._open.epoch[0] == fine.epoch[0]:
            fine = SampleBlock.joined([self._open, fine])
        apart = (np.diff(fine.k // self.count) != 0) | (np.diff(fine.k) <= 0)
        starts = np.flatnonzero(np.concatenate([[True], apart]))
        self._open = None
        if (fine.k[-1] + 1) % self.count:
            self._open = fine.select(slice(int(starts[-1]), None))
            fine, starts = fine.select(slice(0, int(starts[-1]))), starts[:-1]
        return self._thinned(fine, starts) if len(starts) else None

    def _filtered(self, block: SampleBlock) -> SampleBlock:
        """Return the block filtered; a held sample resets the filter."""
        from scipy.signal import sosfilt, sosfilt_zi

        # An aileron that is unknown for a while must not leave NaN in the filter's state.
        unknown, good = np.isnan(block.aileron), block.held == 0
        signals = np.column_stack([block.u, np.where(unknown, 0.0, block.aileron), block.y])
        for start, stop in runs_of(good):
            if start > 0 or self._state is None:
                self._state = sosfilt_zi(self.sections)[:, :, None] * signals[start]
            signals[start:stop], self._state = sosfilt(
                self.sections, signals[start:stop], axis=0, zi=self._state
            )
        if not good[-1]:
            self._state = None
        aileron = np.where(unknown, np.nan, signals[:, -2])
        return replace(block, u=signals[:, :-2], aileron=aileron, y=signals[:, -1])

    def _thinned(self, fine: SampleBlock, starts: Ints) -> SampleBlock | None:
        """Return one sample for each group of fine ones, which begin at the rows ``starts``."""
        held, whole = np.bitwise_or.reduceat(fine.held, starts), fine.select(starts)
        sizes, k = np.diff(np.append(starts, len(fine))), whole.k // self.count
        block = replace(
            whole,
            sample_time_s=self.sample_time_s,
            k=k,
            boot_us=np.rint(k * (1e6 * self.sample_time_s)).astype(np.int64),
            received_us=fine.received_us[starts + sizes - 1],
            u=np.add.reduceat(fine.u, starts, axis=0) / self.count,
            aileron=np.add.reduceat(fine.aileron, starts) / self.count,
            noted=np.bitwise_or.reduceat(fine.noted, starts),
            rudder_moves=np.maximum.reduceat(fine.rudder_moves, starts),
            held=held,
        )
        kept = (held != 0) | (sizes == self.count)
        return block.select(kept) if kept.any() else None


@dataclass(slots=True)
class Notes:
    """The notes added to conditioned samples; it keeps the mean airspeed and the newest rudder.

    The airspeed is compared with its mean over the last minute, with exponentially smaller weight
    for older values. This is the default estimator's memory, whatever memory this run has.
    ``travel_unit`` is half the rudder's travel in the unit of ``u``.
    """

    sample_time_s: float
    travel_unit: float
    _sums: tuple[float, float] = (0.0, 0.0)
    _rudder: Floats = field(default_factory=lambda: np.zeros(0))
    _epoch: int = -1

    def feed_samples(self, block: SampleBlock) -> SampleBlock:
        """Return the block with AIRSPEED_CHANGED and NOT_EXCITED noted."""
        used, noted = block.held == 0, block.noted.copy()
        rows = used & np.isfinite(block.airspeed)
        speed = block.airspeed[rows]
        means = self._mean_airspeeds(speed)
        noted[rows] |= int(Noted.AIRSPEED_CHANGED) * (
            np.abs(speed - means) > AIRSPEED_SHARE * means
        )
        if block.epoch[0] != self._epoch:
            self._epoch, self._rudder = int(block.epoch[0]), np.zeros(0)
        if used.any():
            u, window = block.u[used, 0] / self.travel_unit, window_of(self.sample_time_s)
            at_rest = strokes(u, window, self._rudder) < LEAST_TRAVEL
            noted[used] |= int(Noted.NOT_EXCITED) * at_rest
            self._rudder = np.concatenate([self._rudder, u])[-(window - 1) :]
        return replace(block, noted=noted)

    def _mean_airspeeds(self, speed: Floats) -> Floats:
        """Return the mean (n,) up to each of these airspeeds (n,)."""
        forgetting, means = math.exp(-self.sample_time_s / DEFAULT_MEMORY_S), []
        total, weight = self._sums
        for x in speed.tolist():
            total, weight = forgetting * total + x, forgetting * weight + 1.0
            means.append(total / weight)
        self._sums = total, weight
        return np.array(means)
