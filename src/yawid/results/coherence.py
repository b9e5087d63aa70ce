"""Whether the rudder drives the mode found: squared coherence of rudder and yaw rate at it.

A vibration line, an engine or a gust has its own frequency, and a model that may put a pole
anywhere puts one there. Where the rudder has no part in what the yaw does at that frequency, it is
not the aircraft's answer to its rudder.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats, runs_of

SEGMENTS = 8
"""Fewer Welch segments tell nothing: the test abstains."""
PERIODS = (3.0, 8.0)
"""Periods of the mode in one segment: least and most."""
AROUND = 0.2
"""Part of wn around it within which the coherence is looked at: doublets have holes in theirs."""
LEVEL = 0.01
OVERLAP_LOSS = 1.0 + 2.0 / 36.0
"""Welch (1967): segments under a Hann window that overlap by half count for so much fewer."""
LINE_BINS = 2
BAND_MARGIN = 1.4
HIGHEST = 0.45
"""Part of the rate at which a recommended band ends at the latest."""

Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Coherence:
    """Squared coherence at the mode, and what it exceeds by chance in one case of a hundred.

    ``peak_hz`` is the frequency of the most yaw-rate power near the mode and ``peak_share`` its
    part of all of it; ``band_hz`` (low, high) what the coherent part of the spectrum asks for, None
    where nothing is coherent.
    """

    squared: float
    limit: float
    segments: int
    peak_hz: float
    peak_share: float
    band_hz: tuple[float, float] | None

    @property
    def driven(self) -> bool:
        """Whether the rudder has a part in the mode."""
        return self.squared >= self.limit


def coherence_at(u: Floats, y: Floats, wn_rad_s: float, sample_time_s: float) -> Coherence | None:
    """Return the coherence of ``u`` and ``y`` (n,) at wn; None where the record is too short.

    NaN samples are left out: segments lie within runs of known ones.
    """
    period = 2.0 * math.pi / wn_rad_s / sample_time_s
    runs = [slice(a, b) for a, b in runs_of(np.isfinite(u) & np.isfinite(y))]
    length = _segment_length([run.stop - run.start for run in runs], period)
    if length is None:
        return None
    starts = [i for run in runs for i in range(run.start, run.stop - length + 1, length // 2)]
    rows = np.array(starts)[:, None] + np.arange(length)
    window = np.hanning(length + 1)[:-1]
    spectra = [np.fft.rfft(window * _detrended(x[rows]), axis=1) for x in (u, y)]
    frequency = np.arange(1, length // 2 + 1) / (length * sample_time_s)
    puu, pyy = (np.mean(np.abs(s[:, 1:]) ** 2, axis=0) for s in spectra)
    puy = np.mean(np.conj(spectra[0][:, 1:]) * spectra[1][:, 1:], axis=0)
    power = puu * pyy
    squared = np.where(power > 0.0, np.abs(puy) ** 2 / np.where(power > 0.0, power, 1.0), 0.0)
    return _at_mode(frequency, squared, pyy, len(starts), wn_rad_s / (2.0 * math.pi))


def _segment_length(runs: list[int], period: float) -> int | None:
    """Return the longest even length that gives enough segments, None below three periods."""
    least, most = (math.ceil(periods * period) for periods in PERIODS)
    for length in range(most + most % 2, max(least, 16) - 1, -2):
        if sum(max(0, (run - length) // (length // 2) + 1) for run in runs) >= SEGMENTS:
            return length
    return None


def _detrended(x: Floats) -> Floats:
    """Return the segments (m, length) without their means and slopes."""
    t = np.arange(x.shape[1]) - 0.5 * (x.shape[1] - 1)
    slope = x @ t / (t @ t)
    detrended: Floats = x - x.mean(axis=1, keepdims=True) - slope[:, None] * t
    return detrended


def _at_mode(
    frequency: Floats, squared: Floats, pyy: Floats, segments: int, mode_hz: float
) -> Coherence:
    near = np.abs(frequency - mode_hz) <= AROUND * mode_hz
    near[np.argmin(np.abs(frequency - mode_hz))] = True
    count = segments / OVERLAP_LOSS
    limit = _limit(count, int(near.sum()))
    peak = int(np.flatnonzero(near)[np.argmax(pyy[near])])
    line = slice(max(peak - LINE_BINS, 0), peak + LINE_BINS + 1)
    band = _coherent_band(frequency, squared, pyy, _limit(count, len(frequency)))
    return Coherence(
        float(squared[near].max()),
        limit,
        segments,
        float(frequency[peak]),
        float(pyy[line].sum() / pyy.sum()),
        band,
    )


def _limit(count: float, bins: int) -> float:
    """Return what the largest of ``bins`` coherences of nothing exceeds one time in a hundred."""
    alone = 1.0 - math.pow(1.0 - LEVEL, 1.0 / bins)
    return 1.0 - math.pow(alone, 1.0 / (count - 1.0))


def _coherent_band(
    frequency: Floats, squared: Floats, pyy: Floats, limit: float
) -> tuple[float, float] | None:
    """Return the band around the most coherent power, with a margin on both sides."""
    coherent = squared > limit
    if not coherent.any():
        return None
    peak = int(np.argmax(np.where(coherent, squared * pyy, 0.0)))
    # A hole of one bin is chance.
    closed = coherent | (np.append(coherent[1:], False) & np.append(False, coherent[:-1]))
    low, high = next((a, b) for a, b in runs_of(closed) if a <= peak < b)
    nyquist = float(frequency[-1])
    top = min(float(frequency[high - 1]) * BAND_MARGIN, 2.0 * HIGHEST * nyquist)
    return float(frequency[low]) / BAND_MARGIN, top
