"""The starts of the fit: equation error on finite Fourier transforms, with kinematic sideslip.

In the frequency domain the first equation of ``model.py`` gives the sideslip that p, r and roll
imply, for a given Y_beta. With it, the equations of p and r are linear in their derivatives
(Morelli and Klein 2016, chapter 7). Roll is no regressor: it does not enter the moments, and under
a roll hold it would pass for the aileron. Neither Y_beta nor N_delta_a is sought: where the aileron
only follows, noise gives them values from which the fit ended in a false minimum in 17 of 40
flights, and in 1 from this start.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.record import Record
from yawid.quantities.airspeed import GRAVITY

_Y_BETA, _N_R = -0.1, -0.2
"""Of the middle frequency: Y_beta at the start, and N_r of a plain one."""
_FREQUENCIES = 60
_STEP = 0.05
"""The largest step in rad/s of the spectrum in which the band is sought."""
_P_ROW = ("L_beta", "L_p", "L_r", "L_delta_a", "L_delta_r")
_R_ROW = ("N_beta", "N_p", "N_r", "N_delta_a", "N_delta_r")
_AILERON = _P_ROW.index("L_delta_a")


class _Transforms(NamedTuple):
    """One manoeuvre's transforms (f,): signals, the derivatives of p and r, exp(-jwT), that of 1.

    ``turn`` is g/V.
    """

    p: np.ndarray
    r: np.ndarray
    roll: np.ndarray
    aileron: np.ndarray
    rudder: np.ndarray
    p_slope: np.ndarray
    r_slope: np.ndarray
    end: np.ndarray
    one: np.ndarray
    turn: float


def equation_error(
    records: Sequence[Record], lag_s: float, w: Floats, middle: float
) -> dict[str, float]:
    """Return Y_beta and the derivatives of p and r by name, at the frequencies ``w`` (f,)."""
    parts = [_transforms(record, w, lag_s) for record in records]
    pitch, Y_beta = float(np.mean([record.pitch for record in records])), _Y_BETA * middle
    columns = np.vstack(
        [_columns(each, w, Y_beta, pitch, i, len(parts)) for i, each in enumerate(parts)]
    )
    if not any(record.aileron_moves for record in records):
        columns[:, _AILERON] = 0.0
    p_row = _least_squares(columns, np.concatenate([each.p_slope for each in parts]))
    columns[:, _AILERON] = 0.0
    r_row = _least_squares(columns, np.concatenate([each.r_slope for each in parts]))
    rows = zip((*_P_ROW, *_R_ROW), (*p_row, *r_row), strict=True)
    return {"Y_beta": Y_beta} | dict(rows)


def plain(middle: float) -> dict[str, float]:
    """Return the derivatives of r of an aircraft whose wn is the middle frequency in rad/s."""
    return {"N_beta": middle**2, "N_p": 0.0, "N_r": _N_R * middle}


def band(records: Sequence[Record]) -> tuple[float, Floats]:
    """Return the middle of r's power, and frequencies (f,) from a quarter of it to its end.

    They are in rad/s.
    """
    Ts = records[0].sample_time_s
    count = max(math.ceil(math.tau / (_STEP * Ts)), *(len(each.y) for each in records))
    w = np.arange(count // 2 + 1) * math.tau / (count * Ts)
    chosen = (w >= 0.25) & (w < 0.8 * math.pi / Ts)
    spectra = [np.fft.rfft(each.y[:, 1] * np.hanning(len(each.y)), count) for each in records]
    power = np.sum(np.abs(spectra) ** 2, axis=0)[chosen]
    w = w[chosen]
    power = np.maximum(power - np.median(power[len(w) // 2 :]), 0.0)  # less the noise's
    share = np.cumsum(power) / max(float(np.sum(power)), np.finfo(float).tiny)
    middle, last = (float(w[np.count_nonzero(share[:-1] < x)]) for x in (0.5, 0.95))
    high = min(max(3.0 * middle, 1.3 * last), 0.8 * math.pi / Ts)
    longest = max(float(record.times_s[-1]) for record in records)
    return middle, np.linspace(max(0.25 * middle, math.tau / longest), high, _FREQUENCIES)


def _transforms(record: Record, w: Floats, lag_s: float) -> _Transforms:
    y, last = record.y, record.times_s[-1]
    kernel = np.exp(-1j * np.outer(w, record.times_s)) * record.sample_time_s
    kernel[:, [0, -1]] *= 0.5
    end = np.exp(-1j * w * last)
    u = record.commanded(lag_s, 0.0)
    p, r, roll, aileron, rudder = (kernel @ np.column_stack([y, u - u.mean(axis=0)])).T
    p_slope, r_slope = (1j * w * x + y[-1, i] * end - y[0, i] for i, x in ((0, p), (1, r)))
    one = (1.0 - end) / (1j * w)
    turn = GRAVITY / record.airspeed_m_s
    return _Transforms(p, r, roll, aileron, rudder, p_slope, r_slope, end, one, turn)


def _columns(
    of: _Transforms, w: Floats, Y_beta: float, pitch: float, number: int, count: int
) -> np.ndarray:
    """Return the regressors (f, 5 + 3 count): beta, p, r, inputs, and each manoeuvre's nuisances.

    These are the sideslip at start and end, and the trim.
    """
    lag = 1.0 / (1j * w - Y_beta)
    beta = (pitch * of.p - of.r + of.turn * of.roll) * lag
    found = np.zeros((len(w), 5 + 3 * count), complex)
    found[:, :5] = np.stack([beta, of.p, of.r, of.aileron, of.rudder], axis=1)
    found[:, 5 + 3 * number : 8 + 3 * number] = np.stack([lag, lag * of.end, of.one], axis=1)
    return found


def _least_squares(columns: np.ndarray, y: np.ndarray) -> list[float]:
    """Return the first five real coefficients."""
    both, target = np.vstack([columns.real, columns.imag]), np.concatenate([y.real, y.imag])
    size = np.linalg.norm(both, axis=0) + 1e-12
    found, *_ = np.linalg.lstsq(both / size, target, rcond=1e-9)
    return [float(x) for x in (found / size)[:5]]
