"""Whether the rudder drives the mode found: squared coherence of rudder and yaw rate at it.

A vibration line, an engine or a gust has its own frequency, and a model that may put a pole
anywhere puts one there. Where the rudder has no part in what the yaw does at that frequency, it is
not the aircraft's answer to its rudder.
"""

import math
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats, runs_of

SEGMENTS = 8
"""Fewer Welch segments tell nothing: the test abstains."""
PERIODS = (4.0, 3.0)
"""Periods of the mode in one segment; the fewer where the record is short."""
AROUND = 0.2
"""Part of wn around it within which the coherence is looked at: doublets have holes in theirs."""
LEVEL = 0.01
OVERLAP_LOSS = 1.0 + 2.0 / 36.0
"""Welch (1967): segments under a Hann window that overlap by half count for so much fewer."""
LINE_BINS = 2
BAND_MARGIN = 1.4
HIGHEST = 0.9
"""Part of half the rate at which a recommended band ends at the latest."""
SHORTEST = 16
FINE_S = 25.0
"""Length of the segments by which a line is told from its surroundings."""


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


@dataclass(frozen=True, slots=True)
class _Spectra:
    """Squared coherence and yaw-rate power (n,) over frequency in Hz, by so many segments."""

    frequency: Floats
    squared: Floats
    power: Floats
    segments: int

    @property
    def count(self) -> float:
        """How many independent segments theirs are worth."""
        return self.segments / OVERLAP_LOSS


def coherence_at(u: Floats, y: Floats, wn_rad_s: float, sample_time_s: float) -> Coherence | None:
    """Return the coherence of ``u`` and ``y`` (n,) at wn; None where the record is too short.

    NaN samples are left out: segments lie within runs of known ones.
    """
    runs = [slice(a, b) for a, b in runs_of(np.isfinite(u) & np.isfinite(y))]
    mode_hz = wn_rad_s / (2.0 * math.pi)
    for periods in PERIODS:
        length = max(2 * math.ceil(0.5 * periods / mode_hz / sample_time_s), SHORTEST)
        if len(_starts(runs, length)) >= SEGMENTS:
            break
    else:
        return None
    found = _spectra(u, y, runs, length, sample_time_s)
    near = np.abs(found.frequency - mode_hz) <= AROUND * mode_hz
    near[np.argmin(np.abs(found.frequency - mode_hz))] = True
    fine = _spectra(u, y, runs, _fine_length(runs, length, sample_time_s), sample_time_s)
    near_fine = np.abs(fine.frequency - mode_hz) <= AROUND * mode_hz
    peak = int(np.argmax(np.where(near_fine, fine.power, 0.0)))
    line = slice(max(peak - LINE_BINS, 0), peak + LINE_BINS + 1)
    return Coherence(
        float(found.squared[near].max()),
        _limit(found.count, int(near.sum())),
        found.segments,
        float(fine.frequency[peak]),
        float(fine.power[line].sum() / fine.power.sum()),
        _coherent_band(fine),
    )


def _starts(runs: list[slice], length: int) -> list[int]:
    """Return where the segments of this length begin that overlap by half."""
    return [i for run in runs for i in range(run.start, run.stop - length + 1, length // 2)]


def _fine_length(runs: list[slice], least: int, sample_time_s: float) -> int:
    """Return the longest length up to 25 s that still gives enough segments, ``least`` does."""
    most = 2 * round(0.5 * FINE_S / sample_time_s)
    lengths = range(most, least, -2)
    return next((n for n in lengths if len(_starts(runs, n)) >= SEGMENTS), least)


def _spectra(
    u: Floats, y: Floats, runs: list[slice], length: int, sample_time_s: float
) -> _Spectra:
    """Average the spectra of segments under a Hann window, each without mean and slope."""
    starts = _starts(runs, length)
    rows = np.array(starts)[:, None] + np.arange(length)
    window = np.hanning(length + 1)[:-1]
    of_u, of_y = (np.fft.rfft(window * _detrended(x[rows]), axis=1)[:, 1:] for x in (u, y))
    puu, pyy = (np.mean(np.abs(s) ** 2, axis=0) for s in (of_u, of_y))
    both = puu * pyy
    puy = np.mean(np.conj(of_u) * of_y, axis=0)
    squared = np.where(both > 0.0, np.abs(puy) ** 2 / np.where(both > 0.0, both, 1.0), 0.0)
    frequency = np.arange(1, length // 2 + 1) / (length * sample_time_s)
    return _Spectra(frequency, squared, pyy, len(starts))


def _detrended(x: Floats) -> Floats:
    """Return the segments (m, length) without their means and slopes."""
    t = np.arange(x.shape[1]) - 0.5 * (x.shape[1] - 1)
    slope = x @ t / (t @ t)
    detrended: Floats = x - x.mean(axis=1, keepdims=True) - slope[:, None] * t
    return detrended


def _limit(count: float, bins: int) -> float:
    """Return what the largest of ``bins`` coherences of nothing exceeds one time in a hundred."""
    alone = 1.0 - math.pow(1.0 - LEVEL, 1.0 / bins)
    return 1.0 - math.pow(alone, 1.0 / (count - 1.0))


def _coherent_band(found: _Spectra) -> tuple[float, float] | None:
    """Return the band around the most coherent power, with a margin on both sides."""
    coherent = found.squared > _limit(found.count, len(found.frequency))
    if not coherent.any():
        return None
    peak = int(np.argmax(np.where(coherent, found.squared * found.power, 0.0)))
    # A hole of one bin is chance.
    closed = coherent | (np.append(coherent[1:], False) & np.append(False, coherent[:-1]))
    low, high = next((a, b) for a, b in runs_of(closed) if a <= peak < b)
    top = min(BAND_MARGIN * found.frequency[high - 1], HIGHEST * found.frequency[-1])
    return float(found.frequency[low]) / BAND_MARGIN, float(top)
