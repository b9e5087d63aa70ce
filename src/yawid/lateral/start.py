"""The starts of the fit: equation error, with kinematic sideslip.

The first equation of ``model.py`` gives the sideslip that p, r and roll imply, for a given Y_beta.
With it, the equations of p and r are linear in their derivatives. Both sides go twice through a lag
of the middle frequency w, so that nothing need be differentiated (state-variable filters, Young
1981): w s / (s + w)^2 of a signal is w times the difference of its first lag and its second. Roll
is no regressor: it does not enter the moments, and under a roll hold it would pass for the aileron.
Neither Y_beta nor N_delta_a is sought: where the aileron only follows, noise gives them values from
which the fit ended in a false minimum in 17 of 40 flights.
"""

import math
from collections.abc import Sequence

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.record import Record, lagged_lines
from yawid.quantities.airspeed import GRAVITY

_Y_BETA, N_R = -0.1, -0.2
"""Of the middle frequency: Y_beta at the start, and N_r of a plain one."""
_FILTER = 4.0
"""The filter over the middle frequency: with 1 two of the three starts of a fast aircraft ended in
false minima, with 2 one of them, with 4 and 8 none."""
_STEP = 0.05
"""The largest step in rad/s of the spectrum in which the middle is sought."""
_P_ROW = ("L_beta", "L_p", "L_r", "L_delta_a", "L_delta_r")
_R_ROW = ("N_beta", "N_p", "N_r", "N_delta_a", "N_delta_r")
_AILERON = _P_ROW.index("L_delta_a")


def equation_error(records: Sequence[Record], lag_s: float, middle: float) -> dict[str, float]:
    """Return Y_beta and the derivatives of p and r by name; ``middle`` is that of r in rad/s."""
    rows = np.vstack([_regression(record, lag_s, middle) for record in records])
    columns, p_slope, r_slope = rows[:, :5], rows[:, 5], rows[:, 6]
    columns[:, _AILERON] *= any(record.aileron_moves for record in records)
    p_row, *_ = np.linalg.lstsq(columns, p_slope)
    columns[:, _AILERON] = 0.0
    r_row, *_ = np.linalg.lstsq(columns, r_slope)
    derivatives = zip((*_P_ROW, *_R_ROW), (*p_row.tolist(), *r_row.tolist()), strict=True)
    return {"Y_beta": _Y_BETA * middle} | dict(derivatives)


def middle_of(records: Sequence[Record]) -> float:
    """Return the frequency in rad/s that halves r's power."""
    Ts = records[0].sample_time_s
    count = max(math.ceil(math.tau / (_STEP * Ts)), *(len(each.y) for each in records))
    w = np.arange(count // 2 + 1) * math.tau / (count * Ts)
    chosen = (w >= 0.25) & (w < 0.8 * math.pi / Ts)
    spectra = [np.fft.rfft(each.y[:, 1] * np.hanning(len(each.y)), count) for each in records]
    power = np.sum(np.abs(spectra) ** 2, axis=0)[chosen]
    power = np.maximum(power - np.median(power[len(power) // 2 :]), 0.0)  # less the noise's
    share = np.cumsum(power) / max(float(np.sum(power)), np.finfo(float).tiny)
    return float(w[chosen][np.count_nonzero(share[:-1] < 0.5)])


def _regression(record: Record, lag_s: float, middle: float) -> Floats:
    """Return beta, p, r and inputs, then the derivatives of p and r (n, 7), all filtered.

    The trims, and what sideslip and filters hold at the start, are projected out.
    """
    t, Ts, (p, r, roll) = record.times_s, record.sample_time_s, record.y.T
    rate = -_Y_BETA * middle
    moved = record.pitch * p - r + GRAVITY / record.motion.airspeed_m_s * roll
    beta = lagged_lines(moved[None], 1.0 / rate, Ts) / rate
    signals = np.vstack([beta, p, r, record.commanded(lag_s, 0.0).T, np.exp(-rate * t)])
    w = _FILTER * middle
    once = lagged_lines(signals, 1.0 / w, Ts)
    twice = lagged_lines(once, 1.0 / w, Ts)
    fades = np.exp(-w * t)
    nuisance = np.stack([twice[5], np.ones(len(t)), fades, t * fades], axis=1)[~record.missing]
    found = np.vstack([twice[:5], w * (once - twice)[1:3]]).T[~record.missing]
    found -= nuisance @ np.linalg.lstsq(nuisance, found)[0]
    return np.asarray(found, np.float64)
