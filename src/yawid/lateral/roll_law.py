"""The airframe as flown: closed with the roll law that is found in the aileron.

Between its own movements the aileron does what the roll hold asks for, so that a regression which
leaves out the samples that fit worst finds the hold's gains although the aileron is moved as well.
On JSBSim's flights they are within a few per cent of the simulated hold. ArduPlane filters the rate
that it asks for by 3 Hz: without that lag of the roll angle wn closed was 3 % too high.
"""

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import AILERON, AT, ROLL, RUDDER, Law, P, R, airframe
from yawid.lateral.record import Record, lagged_lines

KEPT = 0.7
"""The part of the samples that the regression keeps: the others are the aileron's own movements."""
LEAST_EXPLAINED = 0.95
"""The part of the aileron in these samples that roll and p must explain."""
LEAST_OF_ROLL = 0.05
"""The least part of the aileron, as a standard deviation, that follows the roll angle: without it p
follows the aileron, and not the aileron p."""
MOST_STEPS = 20
"""The most steps of a regression; each begins with the samples that fitted best before."""
ROLL_LAGS_S = (0.0, 0.03, 0.06, 0.1)
"""Lags of the roll angle in the hold that are tried; the one that explains the aileron best is it.
That is the filter's with what else is late, as the servo's output."""
LEAST_LAG_S = 1e-3


def roll_law(record: Record) -> Law | None:
    """Return the law between the aileron's own movements, None without one.

    An aileron that rests has one without gains.
    """
    if not record.aileron_moves:
        return Law()
    aileron, known = record.commanded(0.0, 0.0)[:, :1], ~record.missing
    best: tuple[float, Law | None] = LEAST_EXPLAINED, None
    for lag_s in ROLL_LAGS_S:
        roll = lagged_lines(record.y[:, 2][None], lag_s, record.sample_time_s)[0]
        rows = np.column_stack([aileron, roll, record.y[:, 0]])[known]
        _, gains, explained = trimmed_regression(rows, rows, int(KEPT * len(rows)))
        of_roll = abs(gains[0]) * rows[:, 1].std() / rows[:, 0].std()
        if explained > best[0] and of_roll > LEAST_OF_ROLL:
            best = explained, Law(-float(gains[0]), -float(gains[1]), lag_s)
    return best[1]


def trimmed_regression(first: Floats, rows: Floats, kept: int) -> tuple[float, Floats, float]:
    """Regress the first column of ``rows`` (n, 1 + m) on the others, without those that fit worst.

    A constant is regressed on, too.
    Returned are the least sum of squares over ``kept`` rows, the coefficients (m,), and R^2 there.
    The rows with which it begins are the ``first`` (least trimmed squares, Rousseeuw 1984).
    """
    some = first
    for _ in range(MOST_STEPS):
        columns = np.column_stack([some[:, 1:], np.ones(len(some))])
        found = np.linalg.lstsq(columns, some[:, 0], rcond=None)[0]
        left = (rows[:, 0] - rows[:, 1:] @ found[:-1] - found[-1]) ** 2
        order = np.argsort(left, kind="stable")[:kept]
        before, some = some, rows[order]
        if np.array_equal(before, some):
            break
    loss, power = float(left[order].sum()), float(np.var(some[:, 0])) * kept
    return loss, np.asarray(found[:-1], np.float64), 1.0 - loss / power if power > 0.0 else 0.0


def dutch_roll_closed(theta: Floats, airspeed_m_s: float, law: Law) -> Floats:
    """Return wn in rad/s and zeta (v, 2) of parameters ``theta`` (v, n) under a roll law.

    Of several pairs of poles it is the one with the most energy in the yaw rate's answer to the
    rudder; NaN where no pair oscillates.
    """
    pair = modal(*closed(theta, airspeed_m_s, law), np.eye(7)[R])[0][:, 0]
    found = np.stack([np.abs(pair), -pair.real / np.abs(pair)], axis=1)
    return np.where((pair.imag > 1e-6)[:, None], found, np.nan)


def modal(whole: Floats, drive: Floats, seen: Floats) -> tuple[np.ndarray, np.ndarray]:
    """Return poles and residues (v, n) of A (v, n, n) and B (v, n, 1) to the output ``seen`` (n,).

    The first pole is that of the pair with the most energy in it, and the second its conjugate.
    """
    poles, vectors = np.linalg.eig(whole)
    residues = seen @ vectors * np.linalg.solve(vectors, drive.astype(complex))[..., 0]
    energy = np.abs(residues) ** 2 / (2.0 * np.abs(poles.real) + np.finfo(float).tiny)
    first = np.where(poles.imag > 1e-6, energy, -1.0).argmax(axis=1)[:, None]
    near = np.abs(poles - np.conj(np.take_along_axis(poles, first, axis=1))).argsort(axis=1)
    order = np.hstack([first, near[near != first].reshape(len(near), -1)])
    return np.take_along_axis(poles, order, axis=1), np.take_along_axis(residues, order, axis=1)


def closed(theta: Floats, airspeed_m_s: float, law: Law) -> tuple[Floats, Floats]:
    """Return A (v, 7, 7) and the rudder's B (v, 7, 1) under a roll law.

    The states are beta, p, r, roll, the aileron behind its servo, the law's roll angle and its
    integral.
    """
    A, B = airframe(theta, airspeed_m_s)
    servo_s = np.maximum(theta[:, AT["servo_lag"]], LEAST_LAG_S)
    whole, drive = np.zeros((len(theta), 7, 7)), np.zeros((len(theta), 7, 1))
    whole[:, :4, :4], whole[:, :4, 4] = A[:, :4, :4], B[:, :4, AILERON]
    whole[:, 4, 4], whole[:, 4, P] = -1.0 / servo_s, -law.rate_gain / servo_s
    whole[:, 4, 5], whole[:, 4, 6] = -law.roll_gain / servo_s, -law.integral_gain / servo_s
    held = 1.0 / max(law.roll_lag_s, LEAST_LAG_S)
    whole[:, 5, ROLL], whole[:, 5, 5], whole[:, 6, 5] = held, -held, 1.0
    drive[:, :4, 0] = B[:, :4, RUDDER]
    return whole, drive
