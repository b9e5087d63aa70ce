"""The airframe as flown: closed with the roll law that is found in the aileron.

Between its own movements the aileron does what the roll hold asks for, so that a regression which
leaves out the samples that fit worst finds the hold's gains although the aileron is moved as well.
On JSBSim's flights they are within a few per cent of the simulated hold.
"""

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import AILERON, AT, ROLL, RUDDER, Law, P, R, airframe
from yawid.lateral.record import Record

KEPT = 0.7
"""The part of the samples that the regression keeps: the others are the aileron's own movements."""
LEAST_EXPLAINED = 0.95
"""The part of the aileron in these samples that roll and p must explain."""
LEAST_OF_ROLL = 0.05
"""The least part of the aileron, as a standard deviation, that follows the roll angle: without it p
follows the aileron, and not the aileron p."""
MOST_STEPS = 20
"""The most steps of a regression; each begins with the samples that fitted best before."""
_LEAST_LAG_S = 1e-3


def roll_law(record: Record) -> Law | None:
    """Return the law between the aileron's own movements, None without one.

    An aileron that rests has one without gains.
    """
    if not record.aileron_moves:
        return Law()
    aileron = record.commanded(0.0, 0.0)[:, :1]
    rows = np.hstack([aileron, record.y[:, [2, 0]]])[~record.missing]
    _, law, explained = trimmed_regression(rows, rows, int(KEPT * len(rows)))
    of_roll = abs(law[0]) * rows[:, 1].std() / rows[:, 0].std()
    if not (explained > LEAST_EXPLAINED and of_roll > LEAST_OF_ROLL):
        return None
    return Law(-float(law[0]), -float(law[1]))


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

    The aileron follows it behind the servo's lag. Of several pairs of poles it is the one with the
    most energy in the yaw rate's answer to the rudder; NaN where no pair oscillates.
    """
    A, B = airframe(theta, airspeed_m_s)
    lag_s = np.maximum(theta[:, AT["servo_lag"]], _LEAST_LAG_S)
    whole, drive = np.zeros((len(theta), 5, 5)), np.zeros((len(theta), 5, 1))
    whole[:, :4, :4], whole[:, :4, 4] = A[:, :4, :4], B[:, :4, AILERON]
    whole[:, 4, 4], drive[:, :4, 0] = -1.0 / lag_s, B[:, :4, RUDDER]
    whole[:, 4, ROLL], whole[:, 4, P] = -law.roll_gain / lag_s, -law.rate_gain / lag_s
    poles, vectors = np.linalg.eig(whole)
    residues = vectors[:, R] * np.linalg.solve(vectors, drive.astype(complex))[..., 0]
    energy = np.abs(residues) ** 2 / (2.0 * np.abs(poles.real) + np.finfo(float).tiny)
    energy = np.where(poles.imag > 1e-6, energy, -1.0)
    pair = np.take_along_axis(poles, energy.argmax(axis=1)[:, None], axis=1)[:, 0]
    found = np.stack([np.abs(pair), -pair.real / np.abs(pair)], axis=1)
    return np.where((energy.max(axis=1) < 0.0)[:, None], np.nan, found)
