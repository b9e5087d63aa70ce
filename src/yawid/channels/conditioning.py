"""Conditioning on the grid: choice of the output, turns removed, one filter for all channels.

The filter works on the samples of the grid, the same on every input and on the output, so that it
leaves the relation between them alone: with y = G u also F y = G F u, exactly. Where messages come
faster than the grid, its upper corner acts on a finer one, lest vibration folds into the samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from yawid.blocks import Floats, Held, Noted, SampleBlock
from yawid.channels.decimate import Decimator, GridFilter, butterworth
from yawid.channels.sample_flags import Notes
from yawid.config.run import RunConfig
from yawid.errors import ConfigError

FULL_TRAVEL = 0.99


def band_pass(band_hz: tuple[float, float], sample_time_s: float) -> Floats:
    """Return the Butterworth band-pass as second-order sections (n, 6).

    Raises:
        ConfigError: the upper edge is not below half the rate.
    """
    rate_hz = 1.0 / sample_time_s
    if not band_hz[1] < rate_hz / 2.0:
        raise ConfigError(
            f"--band reaches to {band_hz[1]:g} Hz: at {rate_hz:g} Hz it must end below "
            f"{rate_hz / 2.0:g} Hz"
        )
    return butterworth(band_hz, "bandpass", rate_hz)


@dataclass(slots=True)
class Conditioner:
    """Turns aligned samples into what the estimators see; carries the filters' state.

    With a band each sample comes in ``count`` finer ones (:mod:`yawid.channels.decimate`).

    Raises:
        ConfigError: the band does not fit the rate.
    """

    config: RunConfig
    sample_time_s: float
    count: int = 1
    _filter: GridFilter | None = field(default=None, init=False)
    _decimator: Decimator | None = field(default=None, init=False)
    _last: tuple[int, float, float] | None = field(default=None, init=False)
    _notes: Notes = field(init=False)

    def __post_init__(self) -> None:
        self._notes = Notes(self.sample_time_s, self.config.half_travel)
        if self.config.band is None:
            return
        sections = band_pass(self.config.band, self.sample_time_s)
        if self.count > 1:  # the upper corner acts before the samples are thinned, and only there
            low_hz, high_hz = self.config.band
            self._decimator = Decimator(self.sample_time_s, self.count, high_hz)
            sections = butterworth(low_hz, "high", 1.0 / self.sample_time_s)
        self._filter = GridFilter(sections)

    def feed(self, block: SampleBlock) -> SampleBlock | None:
        """Return the block conditioned, None where it completes no sample of the grid.

        Samples that thereby miss something become held.
        """
        block = self._flag_saturation(block)
        if self.config.output == "yaw":
            block = self._differenced(block)
        if self.config.turn == "remove":
            turn = block.turn
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

    def _flag_saturation(self, block: SampleBlock) -> SampleBlock:
        at_stop = np.abs(np.nan_to_num(block.u[:, 0])) >= FULL_TRAVEL * self.config.half_travel
        return replace(block, noted=block.noted + int(Noted.SATURATED) * at_stop)

    def _differenced(self, block: SampleBlock) -> SampleBlock:
        """Make the output (psi(k) - psi(k-1)) / Ts: the known integrator never becomes a free pole.

        ``turn`` becomes the mean of both ends, as the output is the mean of the rate between them.
        """
        good = block.held == 0
        k, yaw, turn = block.k[good], block.yaw[good], block.turn[good]
        if len(k) == 0:
            return block
        last_k, last_yaw, last_turn = self._last or (k[0] - 2, np.nan, np.nan)
        self._last = (int(k[-1]), float(yaw[-1]), float(turn[-1]))
        adjacent = np.diff(k, prepend=last_k) == 1
        y, mean_turn, held = np.full(len(block), np.nan), block.turn.copy(), block.held.copy()
        y[good] = np.diff(yaw, prepend=last_yaw) / self.sample_time_s
        mean_turn[good] = 0.5 * (turn + np.append(last_turn, turn[:-1]))
        held[good] = np.where(adjacent & np.isfinite(y[good]), 0, int(Held.GAP))
        return replace(block, y=y, turn=mean_turn, held=held)
