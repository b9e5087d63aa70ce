"""The free decay after the pilot's rudder: the damped sine that fits it.

The decay is where the pilot's rudder rests again. Where a servo's lag is near
wn the damped sine is not the Dutch roll: it is compared with that of a predicted response only.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import tau
from typing import Final

import numpy as np
from msgspec.structs import replace
from scipy.optimize import least_squares

from yawid.answers.damper_report import Decay
from yawid.blocks import Floats
from yawid.damper.autopilots import Law
from yawid.damper.loop import pilots_rudder
from yawid.models.flown import Flown
from yawid.physics.continuous import pole_of

RESTS: Final = 0.15
"""The pilot's rudder rests where it is within this part of its largest movement of its median."""
LEAST_PERIODS, MOST_PERIODS = 1.0, 2.5
"""A decay lasts at least so many periods, and is fitted over so many at most."""
LEAST_SAMPLES: Final = 10
GROUPS: Final = 8
"""The groups of decays that are left out one after the other: their scatter gives sigma."""


def pilots_part(flown: Flown, law: Law, gain: float, turn: float) -> tuple[Floats, Floats]:
    """Return the rudder that the pilot moved in a manoeuvre, and what the damper fed back, (n,).

    ``turn`` is the part of the turn rate taken off the yaw rate. Over gaps both are on lines.
    """
    t, good = np.arange(len(flown.y)), flown.known
    u, r = (np.interp(t, t[good], x[good]) for x in (flown.u[:, 0], flown.y))
    error = r - turn * np.nan_to_num(flown.turn_rate)
    return pilots_rudder(law, gain, u, error, flown.sample_time_s), error


def decays_in(v: Floats, sample_time_s: float, wn: float) -> list[slice]:
    """Return the samples of the free decays after movements v (n,), for a mode of wn rad/s."""
    moved = np.flatnonzero(np.abs(v) > RESTS * np.max(np.abs(v)))
    period = tau / (wn * sample_time_s)
    least, most = (max(round(n * period), LEAST_SAMPLES) for n in (LEAST_PERIODS, MOST_PERIODS))
    # The sample after the last movement is the mean of both; the next one is of the rest alone.
    starts = [(i + 2, j) for i, j in pairwise([*moved.tolist(), len(v)]) if j - i - 2 >= least]
    return [slice(i, min(j, i + most)) for i, j in starts]


def damped_sine(parts: Sequence[Floats], sample_time_s: float, wn: float) -> Decay | None:
    """Return the one damped sine, with an offset, that fits all these decays; None without any.

    Each part (k,) has its own amplitude, phase and offset. ``wn`` is where to begin, in rad/s.
    """
    parts = [each for each in parts if len(each) >= LEAST_SAMPLES and np.isfinite(each).all()]
    if not parts:
        return None
    wn_found, zeta = _fitted(parts, sample_time_s, wn)
    found = Decay(wn_rad_s=wn_found, zeta=zeta, decays=len(parts))
    groups = min(GROUPS, len(parts))
    if groups < 3:
        return found
    left = [
        _fitted([each for j, each in enumerate(parts) if j % groups != i], sample_time_s, wn_found)
        for i in range(groups)
    ]
    wn_std, zeta_std = np.sqrt((groups - 1) * np.var(left, axis=0)).tolist()
    return replace(found, wn_std=wn_std, zeta_std=zeta_std)


def _fitted(parts: Sequence[Floats], sample_time_s: float, wn: float) -> tuple[float, float]:
    def left(point: Floats) -> Floats:
        pole, rows = pole_of(float(point[0]), point[1]), []
        for part in parts:
            swing = np.exp(pole * sample_time_s * np.arange(len(part)))
            columns = np.column_stack([swing.real, swing.imag, np.ones(len(part))])
            rows.append(columns @ np.linalg.lstsq(columns, part, rcond=None)[0] - part)
        return np.concatenate(rows)

    bounds = [0.3 * wn, -0.2], [3.0 * wn, 0.99]
    fits = [least_squares(left, [wn, zeta], bounds=bounds) for zeta in (0.15, 0.5)]
    best = min(fits, key=lambda each: each.cost)
    return float(best.x[0]), float(best.x[1])
