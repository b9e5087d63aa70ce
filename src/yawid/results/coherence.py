"""The test whether the rudder drives the mode found: the squared coherence of rudder and yaw rate.

Vibration, an engine and gusts have frequencies of their own, and the estimator may place a pole at
one of them. Where rudder and yaw rate are not coherent at the frequency of a mode, the mode is not
the aircraft's response to its rudder.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats, runs_of
from yawid.results.reasons import Reason

SEGMENTS = 8
"""The least number of Welch segments: with fewer, the test gives no result."""
PERIODS = (4.0, 3.0)
"""Periods of the mode in one segment: the first, or the second where the record is too short."""
AROUND = 0.2
"""The largest coherence within ± this part of wn counts: a doublet's spectrum has gaps."""
LEVEL = 0.01
"""The probability that unrelated signals exceed the limit."""
OVERLAP_LOSS = 1.0 + 2.0 / 36.0
"""The factor by which Hann-windowed segments that overlap by half count as fewer (Welch 1967)."""
LINE_BINS = 2
"""Frequency bins on either side of a peak that count as part of it."""
BAND_MARGIN = 1.4
"""The factor by which a recommended band is wider than the coherent part, on either side."""
HIGHEST = 0.9
"""The highest upper corner of a recommended band, as a part of half the sample rate."""
RATE_OF_BAND = 5.0
"""The sample rate for a band, in multiples of its upper corner: on a finer grid, neighbouring
samples differ too little."""
NEAR = 2.0
"""A mode up to this many times the upper corner of the recommended band may be the Dutch roll."""
SHORTEST = 16
"""The least length of a segment in samples."""
FINE_S = 25.0
"""The greatest length in s of the longer segments, which resolve a narrow spectral line."""


@dataclass(frozen=True, slots=True)
class Coherence:
    """The squared coherence at the mode, and the limit that chance exceeds in 1 case of 100.

    ``peak_hz`` is the frequency of the largest yaw-rate power near the mode, and ``peak_share`` the
    part that this peak has of all the yaw-rate power. ``band_hz`` (low, high) is the band to
    recommend, made from the coherent part of the spectrum; None where nothing is coherent.
    """

    squared: float
    limit: float
    segments: int
    peak_hz: float
    peak_share: float
    band_hz: tuple[float, float] | None

    @property
    def driven(self) -> bool:
        """Whether the rudder drives the mode: the coherence reaches the limit."""
        return self.squared >= self.limit


@dataclass(frozen=True, slots=True)
class _Spectra:
    """Squared coherence and yaw-rate power (n,) over frequency in Hz, averaged over segments."""

    frequency: Floats
    squared: Floats
    power: Floats
    segments: int

    @property
    def count(self) -> float:
        """The number of independent segments that are worth as much as these overlapping ones."""
        return self.segments / OVERLAP_LOSS


def coherence_at(
    u: Floats, y: Floats, wn_rad_s: float, sample_time_s: float, tries: int = 1
) -> Coherence | None:
    """Return the coherence of ``u`` and ``y`` (n,) at wn; None where the record is too short.

    ``wn_rad_s`` is the mode's natural frequency in rad/s. Segments lie within runs of finite
    samples; NaN samples are left out. Chance exceeds the limit in 1 case of 100 ``tries``.
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
        _limit(found.count, int(near.sum()), tries),
        found.segments,
        float(fine.frequency[peak]),
        float(fine.power[line].sum() / fine.power.sum()),
        _coherent_band(fine),
    )


def coherence_reasons(wn_rad_s: float, found: Coherence | None) -> Iterator[Reason]:
    """Judge whether the rudder drives the mode found; too short a record gives no reason.

    Far above the band in which the rudder moves the yaw, the mode may be a vibration, which a band
    leaves out. Near that band it may well be the Dutch roll, and something else moves it.
    """
    if found is None or found.driven:
        return
    mode_hz, band, remedy = wn_rad_s / (2.0 * math.pi), found.band_hz, {}
    if band is None:
        why = "rudder and yaw rate are coherent at no frequency, so something else moves the yaw"
    elif band[0] <= mode_hz <= band[1]:
        why = (
            "it may be the Dutch roll itself, moved by gusts, by the aileron or by a free "
            "oscillation: the rudder must move more at this frequency"
        )
    else:
        rate = float(f"{RATE_OF_BAND * band[1]:.2g}")
        what = "vibration or gusts" if mode_hz > band[1] else "a slow motion such as a turn"
        if band[1] < mode_hz <= NEAR * band[1]:
            what = "the Dutch roll itself, moved by gusts, or a vibration, which a band leaves out"
        why = f"{what}; try --band {band[0]:.2g},{band[1]:.2g} with --rate {rate:g}"
        remedy = {"band": tuple(float(f"{edge:.2g}") for edge in band), "rate": rate}
    yield Reason(
        "mode_not_driven",
        f"the rudder does not drive the mode found at {wn_rad_s:.3g} rad/s ({mode_hz:.2f} Hz): its "
        f"squared coherence is {found.squared:.2f}, and chance alone gives {found.limit:.2f}; "
        f"{100 * found.peak_share:.0f} % of the yaw rate's power is at {found.peak_hz:.2f} Hz: "
        f"{why}",
        remedy,
    )


def _starts(runs: list[slice], length: int) -> list[int]:
    """Return the first rows of all segments of this length; neighbours overlap by half."""
    return [i for run in runs for i in range(run.start, run.stop - length + 1, length // 2)]


def _fine_length(runs: list[slice], least: int, sample_time_s: float) -> int:
    """Return the longest segment, at most 25 s, that still gives enough; ``least`` does."""
    most = 2 * round(0.5 * FINE_S / sample_time_s)
    lengths = range(most, least, -2)
    return next((n for n in lengths if len(_starts(runs, n)) >= SEGMENTS), least)


def _spectra(
    u: Floats, y: Floats, runs: list[slice], length: int, sample_time_s: float
) -> _Spectra:
    """Return the spectra averaged over Hann-windowed segments, each without mean and slope."""
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


def _limit(count: float, bins: int, tries: int = 1) -> float:
    """Return what the largest of ``bins`` coherences exceeds by chance in 1 of 100 ``tries``."""
    alone = 1.0 - math.pow(1.0 - LEVEL / tries, 1.0 / bins)
    return 1.0 - math.pow(alone, 1.0 / (count - 1.0))


def _coherent_band(found: _Spectra) -> tuple[float, float] | None:
    """Return the band (low, high) in Hz around the largest coherent power, with its margins."""
    coherent = found.squared > _limit(found.count, len(found.frequency))
    if not coherent.any():
        return None
    peak = int(np.argmax(np.where(coherent, found.squared * found.power, 0.0)))
    # A gap of a single bin is due to chance: it is closed.
    closed = coherent | (np.append(coherent[1:], False) & np.append(False, coherent[:-1]))
    low, high = next((a, b) for a, b in runs_of(closed) if a <= peak < b)
    top = min(BAND_MARGIN * found.frequency[high - 1], HIGHEST * found.frequency[-1])
    return float(found.frequency[low]) / BAND_MARGIN, float(top)
