"""From theta to the yaw channel of paper eq. 22-23: K, T, omega, xi and the four derivatives.

r is the yaw rate in rad/s and u the rudder, positive nose right (the paper's -delta_H), in half
travels or, with ``--rudder-max-deg``, in rad; K in rad/s and a_delta in 1/s^2 are per that unit.
Eq. 22 at gamma = 0, and eq. 23 for the rate, are::

    r'    = -a_omega r - a_beta beta + a_delta u                                    (22)
    beta' = r - a_z beta                                                            (22)
    r/u   = K (T s + 1) omega^2 / (s^2 + 2 xi omega s + omega^2)                    (23)

    T = 1/a_z            omega^2 = a_omega a_z + a_beta
    K = a_delta a_z / omega^2      2 xi omega = a_omega + a_z

Four numbers of one kind give the four of the other. theta gives the poles p_i and the residues R_i
of r/u exactly, because the zero-order hold is undone; for na = 2 these are the model above. With
more poles, the yaw mode stays and the others count as lags in series with a DC gain of 1: to r/u
times (1 - s/p) for each of them and times the polynomial of the yaw mode, K omega^2 (T s + 1) is
fitted over 0.3 to 3 omega. The misfit is the error of the reduction. With z = exp(s Ts),

    r/u = sum of R_i / (s - p_i),   or   B(z) / A(z) z Ts s / (z - 1)

where a pole z <= 0 has an effect. It has no continuous counterpart: its response alternates from
sample to sample, which no motion of an aircraft does. It is no lag, and stays in the response.

The yaw mode is the Dutch roll or, where no pole oscillates, the two slowest real poles other than
the servo's. The servo's pole is the real one nearest to 1/tau where its lag tau is given. Otherwise
it is the fastest one, whose removal changes the response least: by |s/p| for a pole at p.
"""

import numpy as np
from numpy.polynomial.polynomial import polyval

from yawid.blocks import Floats, Ints
from yawid.config.estimator import ArmaxOrders
from yawid.physics.modes import (
    Complexes,
    Poles,
    discrete_residues,
    dutch_roll_index,
    poles_of,
    residues_of,
)
from yawid.quantities.table import REDUCTION_ERROR, YAW_CHANNEL

SERVO = list(YAW_CHANNEL).index("servo_tau_s")
LARGEST_ERROR = 0.3
"""With a larger relative misfit over 0.3 to 3 omega the model is not of the form of eq. 23."""
_BAND = np.geomspace(0.3, 3.0, 15)
"""Frequencies of the reduction, over omega."""
_STEP = 1e-6
"""Smallest step of the central differences, in units of theta."""
_OF_NYQUIST = 0.8
"""Where a pole alternates, the frequencies of the reduction end at this part of Nyquist's."""
CANCELLED = 0.01
"""An alternating pole has no effect with at most this share of the sum of all |residues|: a zero
lies on it."""


def yaw_channel(
    theta: Floats,
    orders: ArmaxOrders,
    sample_time_s: float,
    *,
    mean_output: bool = False,
    poles: Poles | None = None,
) -> tuple[Floats, Floats]:
    """Return the numbers of eq. 22-23 (n, 9) and the error of the reduction (n,).

    The numbers have the order and units of ``quantities.table.YAW_CHANNEL``. ``theta`` (n, p) and
    its ``poles``, where the caller has them. ``mean_output``: the output is the mean rate over the
    interval before the sample, as with the yaw angle. NaN where there is no yaw
    mode, and for na < 2 or without B. The servo's lag alone is NaN where no pole is left for it.
    """
    n = len(theta)
    if orders.na < 2 or not orders.nb or orders.nb[0] == 0:
        return np.full((n, len(YAW_CHANNEL)), np.nan), np.full(n, np.nan)
    if poles is None:
        poles = poles_of(theta[:, : orders.na], sample_time_s)
    p = poles.s.copy()
    discrete = discrete_residues(theta, poles, orders)
    residues = residues_of(discrete, poles, sample_time_s, mean_output=mean_output)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        yaw, servo = np.arange(2) + np.zeros((n, 1), int), np.full(n, np.nan)
        if orders.na > 2:
            yaw, servo = _yaw_and_servo(p, residues, sample_time_s)
        mode = np.take_along_axis(p, yaw, axis=1)
        omega = np.sqrt(mode.prod(axis=1).real)
        xi = -mode.sum(axis=1).real / (2.0 * omega)
        if orders.na == 2:
            n1, error = residues.sum(axis=1).real, np.zeros(n)
            n0 = -(residues[:, 0] * p[:, 1] + residues[:, 1] * p[:, 0]).real
        else:
            size = np.abs(discrete)
            # size is NaN at z = 0, which is a delay
            has_effect = size > CANCELLED * np.nansum(size, axis=1, keepdims=True)
            rows = np.flatnonzero(np.any(np.isnan(p) & has_effect, axis=1))
            w = omega[:, None] * _BAND
            w[rows] = np.minimum(w[rows], _OF_NYQUIST * np.pi / sample_time_s)
            sampled = _sampled(theta[rows], orders, sample_time_s, w[rows], 1 + mean_output)
            n1, n0, error = _numerator(p, residues, yaw, w, rows, sampled)
        K, T = n0 / omega**2, n1 / n0
        a_z = 1.0 / T
        a_omega = 2.0 * xi * omega - a_z
        a_beta, a_delta = omega**2 - a_omega * a_z, K * omega**2 * T
        values = np.stack([K, T, omega, xi, a_z, a_omega, a_beta, a_delta, -1.0 / servo], axis=1)
    return values, error


def _yaw_and_servo(p: Complexes, residues: Complexes, sample_time_s: float) -> tuple[Ints, Floats]:
    """Return the columns (n, 2) of the yaw mode's poles, and the servo's pole (n,) or NaN.

    Rows of ``p`` without a yaw mode become NaN.
    """
    rows = np.arange(len(p))
    first = dutch_roll_index(p, residues, sample_time_s)
    mirrored = np.abs(p - np.conj(p[rows, np.maximum(first, 0)])[:, None])
    oscillating = np.stack([first, np.argmin(np.nan_to_num(mirrored, nan=np.inf), axis=1)], axis=1)

    real = np.where(p.imag == 0.0, p.real, np.nan)
    lag = np.where(real < 0.0, real, np.nan)
    nearest = np.argmin(np.nan_to_num(-np.abs(lag), nan=np.inf), axis=1)
    servo = lag[rows, nearest]
    # Without a third real pole both belong to the yaw mode, and none to the servo.
    servo[(first < 0) & (np.isfinite(real).sum(axis=1) < 3)] = np.nan
    speed = np.nan_to_num(np.abs(real), nan=np.inf)
    speed[rows, nearest] = np.where(np.isnan(servo), speed[rows, nearest], np.inf)
    slowest = np.argsort(speed, axis=1, kind="stable")[:, :2]
    yaw = np.where(first[:, None] >= 0, oscillating, slowest)
    overdamped = np.isfinite(np.take_along_axis(speed, slowest, axis=1)).all(axis=1)
    p[(first < 0) & ~overdamped] = np.nan
    return yaw, servo


def _sampled(
    theta: Floats, orders: ArmaxOrders, sample_time_s: float, w: Floats, holds: int
) -> Complexes:
    """Return the response (n, k) at w (n, k) of B / A without dead time, its holds undone."""
    x = np.exp(-1j * w * sample_time_s)
    a, b = (each.T[:, :, None] for each in np.split(theta, [orders.na], axis=1))
    num, den = (polyval(x, each, tensor=False) for each in (b[: orders.nb[0]], a))
    hold = (1.0 - x) / (1j * w * sample_time_s)
    # 1/x in place of x times num and den: NumPy swaps the factors of a product in long blocks.
    found: Complexes = num / (1.0 / x + den) / hold**holds
    return found


def _numerator(
    p: Complexes, residues: Complexes, yaw: Ints, w: Floats, rows: Ints, sampled: Complexes
) -> tuple[Floats, Floats, Floats]:
    """Return n1 and n0 (n,) of the numerator n1 s + n0 of eq. 23, and its relative misfit (n,).

    ``sampled`` (m, k) is the response at w (n, k) of ``rows`` (m,). That of the others is num/den,
    real polynomials of s: at s = jw even powers are real, and odd ones imaginary.
    """
    num, den = np.zeros((2, len(p), p.shape[1] + 1), complex)
    den[:, 0] = 1.0
    lag = np.isfinite(p)
    for i in range(p.shape[1]):
        pole, counts = p[:, i, None], lag[:, i, None]
        longer = np.roll(num, 1, axis=1) - pole * num + residues[:, i, None] * den
        num = np.where(counts, longer, num)
        den = np.where(counts, np.roll(den, 1, axis=1) - pole * den, den)
    is_yaw = (yaw[:, :, None] == np.arange(p.shape[1])).any(axis=1)
    size = np.where(lag & ~is_yaw, -1.0 / p, 1.0).prod(axis=1)[:, None]
    c, of_rows = (num * size).real.T, den[rows] * size[rows]
    even, odd = (polyval(-(w**2), each[:, :, None], tensor=False) for each in (c[::2], c[1::2]))
    # Not by an operator, of which NumPy swaps the factors in long blocks.
    wanted = np.multiply(sampled, polyval(1j * w[rows], of_rows.T[:, :, None], tensor=False))
    even[rows], odd[rows] = wanted.real, wanted.imag / w[rows]
    # n0 fits the even part and n1 the odd one, each alone; their weights are relative.
    weight = 1.0 / (even**2 + (w * odd) ** 2)
    n0 = (even * weight).sum(axis=1) / weight.sum(axis=1)
    n1 = (odd * w**2 * weight).sum(axis=1) / (w**2 * weight).sum(axis=1)
    misfit = ((even - n0[:, None]) ** 2 + (w * (odd - n1[:, None])) ** 2) * weight
    return n1, n0, np.sqrt(misfit.mean(axis=1))


def with_sigma(
    theta: Floats,
    covariance: Floats,
    orders: ArmaxOrders,
    sample_time_s: float,
    *,
    mean_output: bool = False,
) -> tuple[Floats, Floats]:
    """Return the numbers of :func:`yaw_channel` and their sigma (n, 2, 9), and the error (n,).

    They are NaN where eq. 23 does not hold: a number but the servo's lag has no sigma, or the error
    is large. ``theta`` (n, p), ``covariance`` (n, p, p). Sigma is that of the delta method. The
    Jacobian is taken by central differences, with steps of 1e-6 plus a thousandth of each
    parameter's sigma.
    """
    n, count = len(theta), orders.na + (orders.nb[0] if orders.nb else 0)
    variances = np.diagonal(covariance, axis1=1, axis2=2)[:, :count]
    steps = _STEP + 1e-3 * np.sqrt(np.maximum(variances, 0.0))
    shifts = np.zeros((count, n, theta.shape[1]))
    shifts[np.arange(count), :, np.arange(count)] = steps.T
    stack = np.concatenate([theta[None], theta + shifts, theta - shifts])
    # B does not move the poles, and finding the same ones again would take most of the time.
    moved = np.r_[0, 1 : orders.na + 1, count + 1 : count + 1 + orders.na]
    same = np.zeros((len(stack), 1), int)
    same[moved, 0] = np.arange(len(moved))
    poles = poles_of(stack[moved, :, : orders.na].reshape(-1, orders.na), sample_time_s)
    values, error = yaw_channel(
        stack.reshape(-1, theta.shape[1]), orders, sample_time_s, mean_output=mean_output,
        poles=poles.select((same * n + np.arange(n)).ravel()),
    )  # fmt: skip
    values = values.reshape(2 * count + 1, n, len(YAW_CHANNEL))
    jacobian = (values[1 : count + 1] - values[count + 1 :]) / (2.0 * steps.T[:, :, None])
    jacobian = np.ascontiguousarray(jacobian.transpose(1, 2, 0))
    with np.errstate(invalid="ignore"):
        # A matrix product for each row: its bits must not depend on the length of the block.
        product = np.matmul(jacobian, covariance[:, :count, :count])
        std = np.sqrt(np.maximum((product * jacobian).sum(axis=2), 0.0))
    numbers, rest = np.stack([values[0], std], axis=1), np.arange(len(YAW_CHANNEL)) != SERVO
    finite = np.isfinite(numbers)
    known = finite[:, :, rest].all(axis=(1, 2)) & (error[:n] <= LARGEST_ERROR)
    # All NaNs have the same bits, because files are compared bit for bit.
    return np.where(known[:, None, None] & finite, numbers, np.nan), error[:n]


def summary_of(
    theta: Floats,
    covariance: Floats,
    orders: ArmaxOrders,
    sample_time_s: float,
    *,
    mean_output: bool = False,
) -> dict[str, dict[str, float]]:
    """Return {name: {value, std}} for the JSON summary, empty where eq. 23 does not hold.

    ``theta`` (p,) and its ``covariance`` (p, p); the rest as in :func:`yaw_channel`.
    """
    [numbers], error = with_sigma(
        theta[None], covariance[None], orders, sample_time_s, mean_output=mean_output
    )
    found = {
        name: {"value": float(value), "std": float(sigma)}
        for name, value, sigma in zip(YAW_CHANNEL, *numbers, strict=True)
        if np.isfinite(value) and np.isfinite(sigma)
    }
    if found and orders.na > 2:  # the error has no sigma
        found[REDUCTION_ERROR] = {"value": float(error[0]), "std": 0.0}
    return found
