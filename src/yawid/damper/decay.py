"""The free decay after the pilot's rudder: the damped sine that fits it.

The servo's output holds the damper's part, so the pilot's is what is left of it: v = u + K e, with
e the yaw rate less the wanted turn. The decay is where v rests again. Where a servo's lag is near
wn the damped sine is not the Dutch roll: it is compared with that of a predicted response only.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi, sqrt, tau
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from yawid.blocks import Floats
from yawid.damper.autopilots import Law

RESTS: Final = 0.15
"""The pilot's rudder rests where it is within this part of its largest movement of its median."""
LEAST_PERIODS, MOST_PERIODS = 1.0, 2.5
"""A decay lasts at least so many periods, and is fitted over so many at most."""
LEAST_SAMPLES: Final = 10
GROUPS: Final = 8
"""The groups of decays that are left out one after the other: their scatter gives sigma."""


@dataclass(frozen=True, slots=True)
class Sine:
    """A damped sine: wn in rad/s, zeta, and their sigmas; NaN where there are too few decays."""

    wn_rad_s: float
    zeta: float
    wn_std: float = np.nan
    zeta_std: float = np.nan


def pilots_rudder(law: Law, gain: float, u: Floats, error: Floats, sample_time_s: float) -> Floats:
    """Return the rudder (n,) that the pilot moved, less its rest, from the servo's output u (n,).

    ``error`` (n,) is what the damper feeds back, in rad/s. u is the mean over the sample that
    follows, and so is the damper's part.
    """
    n = 1 << int(np.ceil(np.log2(2 * len(u))))
    w = 2.0 * pi * np.fft.rfftfreq(n, sample_time_s)
    mean = np.sinc(w * sample_time_s / (2.0 * pi)) * np.exp(0.5j * w * sample_time_s)
    spectrum = np.fft.rfft(error - np.median(error), n)
    spectrum = spectrum * law.at(1j * np.maximum(w, 1e-6), gain) * mean
    v: Floats = u + np.fft.irfft(spectrum, n)[: len(u)]
    return v - np.median(v)


def decays_in(v: Floats, sample_time_s: float, wn: float) -> list[slice]:
    """Return the samples of the free decays after movements v (n,), for a mode of wn rad/s."""
    moved = np.flatnonzero(np.abs(v) > RESTS * np.max(np.abs(v)))
    period = tau / (wn * sample_time_s)
    least, most = (max(round(n * period), LEAST_SAMPLES) for n in (LEAST_PERIODS, MOST_PERIODS))
    # The sample after the last movement is the mean of both; the next one is of the rest alone.
    starts = [(i + 2, j) for i, j in pairwise([*moved.tolist(), len(v)]) if j - i - 2 >= least]
    return [slice(i, min(j, i + most)) for i, j in starts]


def damped_sine(parts: Sequence[Floats], sample_time_s: float, wn: float) -> Sine | None:
    """Return the one damped sine, with an offset, that fits all these decays; None without any.

    Each part (k,) has its own amplitude, phase and offset. ``wn`` is where to begin, in rad/s.
    """
    parts = [each for each in parts if len(each) >= LEAST_SAMPLES and np.isfinite(each).all()]
    if not parts:
        return None
    wn_found, zeta = _fitted(parts, sample_time_s, wn)
    groups = [parts[i::GROUPS] for i in range(GROUPS)] if len(parts) > GROUPS else [
        [each] for each in parts
    ]  # fmt: skip
    if len(groups) < 3:
        return Sine(wn_found, zeta)
    left = np.array([
        _fitted([each for other in groups if other is not group for each in other],
                sample_time_s, wn_found)
        for group in groups
    ])  # fmt: skip
    std = np.sqrt((len(groups) - 1) * left.var(axis=0))
    return Sine(wn_found, zeta, *std.tolist())


def _fitted(parts: Sequence[Floats], sample_time_s: float, wn: float) -> tuple[float, float]:
    def left(point: Floats) -> Floats:
        return np.concatenate([*_residuals(parts, sample_time_s, float(point[0]), float(point[1]))])

    bounds = [0.3 * wn, -0.2], [3.0 * wn, 0.99]
    fits = [least_squares(left, [wn, zeta], bounds=bounds) for zeta in (0.15, 0.5)]
    best = min(fits, key=lambda each: float(each.cost))
    return float(best.x[0]), float(best.x[1])


def _residuals(
    parts: Sequence[Floats], sample_time_s: float, wn: float, zeta: float
) -> Iterator[Floats]:
    root = wn * sqrt(max(1.0 - zeta**2, 1e-6))
    for part in parts:
        t = sample_time_s * np.arange(len(part))
        envelope = np.exp(-zeta * wn * t)
        columns = np.stack(
            [envelope * np.cos(root * t), envelope * np.sin(root * t), np.ones(len(t))], axis=1
        )
        yield columns @ np.linalg.lstsq(columns, part, rcond=None)[0] - part
