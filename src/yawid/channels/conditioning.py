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
    Bools,
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


def band_pass(band_hz: tuple[float, float], sample_time_s: float) -> Floats:
    """Return the Butterworth band-pass as second-order sections (n, 6).

    Raises:
        ConfigError: the upper edge is not below half the rate.
    """
    rate_hz = 1.0 / sample_time_s
    if not band_hz[1] < rate_hz / 2.0:
        raise ConfigError(
            f"--band reaches {band_hz[1]:g} Hz: at {rate_hz:g} Hz it must end below "
            f"{rate_hz / 2.0:g} Hz"
        )
    return butterworth(band_hz, "bandpass", rate_hz)


@dataclass(slots=True)
class Conditioner:
    """The way from aligned samples to those of the estimators, with the state of the filters.

    With a band, ``count`` finer samples make one of the grid (:class:`Decimator`).

    Raises:
        ConfigError: the band does not fit the rate.
    """

    config: RunConfig
    sample_time_s: float
    count: int = 1
    _filter: "GridFilter | None" = field(default=None, init=False)
    _decimator: "Decimator | None" = field(default=None, init=False)
    _last: tuple[int, float, float] | None = field(default=None, init=False)
    _notes: "Notes" = field(init=False)

    def __post_init__(self) -> None:
        self._notes = Notes(self.sample_time_s, self.config.half_travel)
        if self.config.band is None:
            return
        sections = band_pass(self.config.band, self.sample_time_s)
        if self.count > 1:  # the upper corner acts only on the finer samples
            low_hz, high_hz = self.config.band
            self._decimator = Decimator(self.sample_time_s, self.count, high_hz)
            sections = butterworth(low_hz, "high", 1.0 / self.sample_time_s)
        self._filter = GridFilter(sections)

    def feed(self, block: SampleBlock) -> SampleBlock | None:
        """Return the block conditioned, None where it completes no sample of the grid.

        Samples for which something is missing become held.
        """
        at_stop = np.abs(np.nan_to_num(block.u[:, 0])) >= FULL_TRAVEL * self.config.stop
        block = replace(block, noted=block.noted + int(Noted.SATURATED) * at_stop)
        if self.config.output == "yaw":
            block = self._differenced(block)
        if self.config.turn == "remove":
            turn = block.turn_rate
            unknown = (block.held == 0) & np.isnan(turn)
            held = block.held + int(Held.NO_AIRSPEED) * unknown
            block = replace(block, y=block.y - turn, held=held)
        thinned = block if self._decimator is None else self._decimator.feed(block)
        if thinned is None:
            return None
        block = thinned
        if self._filter is not None:
            block = self._filter.feed(block)
        held = block.held != 0
        u = np.where(held[:, None], np.nan, block.u)
        return self._notes.feed(replace(block, u=u, y=np.where(held, np.nan, block.y)))

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


def butterworth(corner_hz: float | tuple[float, float], kind: str, rate_hz: float) -> Floats:
    """Return the Butterworth filter of one end of the band, or of both, as sections (n, 6)."""
    from scipy.signal import butter

    sections: Floats = butter(BAND_ORDER, corner_hz, kind, fs=rate_hz, output="sos")
    return sections


@dataclass(slots=True)
class GridFilter:
    """One filter for inputs and output alike; it keeps its state from block to block."""

    sections: Floats
    _state: Floats | None = None

    def feed(self, block: SampleBlock) -> SampleBlock:
        """Return the block with u, aileron and y filtered; a held sample resets the filter."""
        from scipy.signal import sosfilt, sosfilt_zi

        # An aileron that is unknown for a while must not leave NaN in the filter's state.
        unknown = np.isnan(block.aileron)
        aileron = np.where(unknown, 0.0, block.aileron)
        signals = np.column_stack([block.u, aileron, block.y])
        good = block.held == 0
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


@dataclass(slots=True)
class Decimator:
    """The low-pass of fine samples at ``corner_hz``, which makes one of every ``count``.

    A sample of the grid is held if one of its fine samples is, for the same reasons. If fine
    samples are missing without a reason, it is at the edge of a gap or of the log and is left out.
    """

    sample_time_s: float
    count: int
    corner_hz: float
    _filter: GridFilter = field(init=False)
    _open: SampleBlock | None = None

    def __post_init__(self) -> None:
        rate_hz = self.count / self.sample_time_s
        self._filter = GridFilter(butterworth(self.corner_hz, "low", rate_hz))

    def feed(self, block: SampleBlock) -> SampleBlock | None:
        """Take fine samples in; return those of the grid that are complete."""
        fine = self._filter.feed(block)
        if self._open is not None and self._open.epoch[0] == fine.epoch[0]:
            fine = SampleBlock.joined([self._open, fine])
        apart = (np.diff(fine.k // self.count) != 0) | (np.diff(fine.k) <= 0)
        starts = np.flatnonzero(np.concatenate([[True], apart]))
        self._open = None
        if (fine.k[-1] + 1) % self.count:
            self._open = fine.select(slice(int(starts[-1]), None))
            fine, starts = fine.select(slice(0, int(starts[-1]))), starts[:-1]
        return self._thinned(fine, starts) if len(starts) else None

    def _thinned(self, fine: SampleBlock, starts: Ints) -> SampleBlock | None:
        """Return one sample for each group of fine ones, which begin at the rows ``starts``."""
        held = np.bitwise_or.reduceat(fine.held, starts)
        sizes = np.diff(np.append(starts, len(fine)))
        whole = fine.select(starts)
        k = whole.k // self.count
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

    def feed(self, block: SampleBlock) -> SampleBlock:
        """Return the block with AIRSPEED_CHANGED and NOT_EXCITED noted."""
        used = block.held == 0
        noted = block.noted.copy()
        noted[used & self._other_airspeed(block, used)] |= int(Noted.AIRSPEED_CHANGED)
        noted[used & self._at_rest(block, used)] |= int(Noted.NOT_EXCITED)
        return replace(block, noted=noted)

    def _other_airspeed(self, block: SampleBlock, used: Bools) -> Bools:
        rows = used & np.isfinite(block.airspeed)
        other = np.zeros(len(block), bool)
        if not rows.any():
            return other
        speed = block.airspeed[rows]
        forgetting = math.exp(-self.sample_time_s / DEFAULT_MEMORY_S)
        total, weight = self._sums
        means = []
        for x in speed.tolist():
            total, weight = forgetting * total + x, forgetting * weight + 1.0
            means.append(total / weight)
        self._sums, mean = (total, weight), np.array(means)
        other[rows] = np.abs(speed - mean) > AIRSPEED_SHARE * mean
        return other

    def _at_rest(self, block: SampleBlock, used: Bools) -> Bools:
        if block.epoch[0] != self._epoch:
            self._epoch, self._rudder = int(block.epoch[0]), np.zeros(0)
        at_rest = np.zeros(len(block), bool)
        if not used.any():
            return at_rest
        u, window = block.u[used, 0] / self.travel_unit, window_of(self.sample_time_s)
        at_rest[used] = strokes(u, window, self._rudder) < LEAST_TRAVEL
        self._rudder = np.concatenate([self._rudder, u])[-(window - 1) :]
        return at_rest
