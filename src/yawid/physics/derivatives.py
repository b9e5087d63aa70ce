"""From theta to the yaw channel of paper eq. 22-23: K, T, omega, xi and the four derivatives.

With r the yaw rate and u the rudder (positive nose right, the paper's -delta_H), eq. 22 at gamma =
0 is r' = -a_omega r - a_beta beta + a_delta u, beta' = r - a_z beta, and eq. 23 for the rate

    r/u = K (T s + 1) omega^2 / (s^2 + 2 xi omega s + omega^2),

    T = 1/a_z,  omega^2 = a_omega a_z + a_beta,  2 xi omega = a_omega + a_z,  K = a_delta a_z /
    omega^2,

four numbers one way and four the other. theta gives the poles p_i and residues R_i of r/u exactly,
the zero-order hold undone; for na = 2 that is the model above. With more poles, the Dutch roll
stays and the others are lags in series: they are divided out with their DC gain of one, and the
numerator that is left is fitted by K omega^2 (T s + 1) over 0.3 to 3 omega; how badly it fits is
the reduction's error.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from yawid.blocks import Floats
from yawid.config import ArmaxOrders
from yawid.physics.modes import Complexes, dutch_roll_index, poles_and_residues

NAMES = (
    "K",
    "T_theta_s",
    "omega_beta",
    "xi_beta",
    "a_z_beta",
    "a_my_omega_y",
    "a_my_beta",
    "a_my_delta_h",
)
LARGEST_ERROR = 0.3
"""Relative misfit over 0.3 to 3 omega above which the model is no yaw channel of eq. 23."""
_BAND = np.geomspace(0.3, 3.0, 15)
_STEP = 1e-6
_FAR = 1e9
"""Where in rad/s a pole is put that must not be felt."""


def yaw_channel(
    theta: Floats, orders: ArmaxOrders, sample_time_s: float, *, mean_output: bool = False
) -> tuple[Floats, Floats]:
    """Return the numbers (n, 8), in the order of NAMES, and the reduction's error (n,).

    ``mean_output``: the output is the mean rate over the interval before, as with the yaw angle.
    NaN where there is no mode or, for na < 2, no such model.
    """
    n = len(theta)
    if orders.na < 2 or not orders.nb or orders.nb[0] == 0:
        return np.full((n, len(NAMES)), np.nan), np.full(n, np.nan)
    z, p, residues = poles_and_residues(theta, orders, sample_time_s, mean_output=mean_output)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if orders.na > 2:
            p, residues = _without_alternating(z, p, residues)
        pair = _pair(p, residues, sample_time_s)
        a, b = (np.take_along_axis(p, i[:, None], axis=1)[:, 0] for i in pair)
        omega = np.sqrt((a * b).real)
        xi = -(a + b).real / (2.0 * omega)
        n1, n0, error = _numerator(p, residues, pair, omega)
        values = _derivatives(n0 / omega**2, n1 / n0, omega, xi)
    return values, error


def _derivatives(K: Floats, T: Floats, omega: Floats, xi: Floats) -> Floats:
    a_z = 1.0 / T
    a_omega = 2.0 * xi * omega - a_z
    a_beta = omega**2 - a_omega * a_z
    a_delta = K * omega**2 * T
    return np.stack([K, T, omega, xi, a_z, a_omega, a_beta, a_delta], axis=1)


def _without_alternating(
    z: Complexes, p: Complexes, residues: Complexes
) -> tuple[Complexes, Complexes]:
    """Move poles without a continuous counterpart (z <= 0) to z = 0, their DC gain kept.

    Nothing an aircraft does alternates from sample to sample: such a pole models delay or noise.
    """
    residues = residues.copy()
    alternating = np.isnan(p) & np.isfinite(z)
    for q in range(p.shape[1]):
        factor = (z - z[:, q, None]) / (z * (1.0 - z[:, q, None]))
        residues = np.where(alternating[:, q, None], residues * factor, residues)
    return np.where(alternating, -_FAR, p), np.where(alternating, 0.0, residues)


def _pair(p: Complexes, residues: Complexes, sample_time_s: float) -> tuple[Any, Any]:
    """Return the columns of the two poles of the yaw mode: both for na = 2, else the Dutch roll."""
    n, na = p.shape
    if na == 2:
        return np.zeros(n, int), np.ones(n, int)
    first = dutch_roll_index(p, residues, sample_time_s)
    rows = np.arange(n)
    mirrored = np.abs(p - np.conj(p[rows, np.maximum(first, 0)])[:, None])
    second = np.argmin(np.nan_to_num(mirrored, nan=np.inf), axis=1)
    return np.where(first < 0, 0, first), np.where(first < 0, 0, second)


def _numerator(
    p: Complexes, residues: Complexes, pair: tuple[Any, Any], omega: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return n1, n0 of n1 s + n0 over the pair's polynomial, and the relative misfit."""
    rows = np.arange(len(p))
    a, b = p[rows, pair[0]], p[rows, pair[1]]
    if p.shape[1] == 2:
        n1 = residues.sum(axis=1).real
        n0 = -(residues[:, 0] * p[:, 1] + residues[:, 1] * p[:, 0]).real
        return n1, n0, np.zeros(len(p))
    s = 1j * omega[:, None] * _BAND
    response = (residues[:, None, :] / (s[:, :, None] - p[:, None, :])).sum(axis=2)
    others = np.ones_like(s)
    for i in range(p.shape[1]):
        lag = 1.0 - s / p[:, i, None]
        own = (pair[0] == i) | (pair[1] == i)
        others = others * np.where(own[:, None], 1.0, lag)
    wanted = response * others * (s - a[:, None]) * (s - b[:, None])
    # Relative weights; n0 meets the real part and n1 omega the imaginary one, so both are apart.
    weight = 1.0 / np.abs(wanted) ** 2
    n0 = (weight * wanted.real).sum(axis=1) / weight.sum(axis=1)
    n1 = (weight * wanted.imag * s.imag).sum(axis=1) / (weight * s.imag**2).sum(axis=1)
    misfit = np.abs(n0[:, None] + n1[:, None] * s - wanted) ** 2 * weight
    return n1, n0, np.sqrt(misfit.mean(axis=1))


def with_sigma(
    theta: Floats,
    covariance: Floats,
    orders: ArmaxOrders,
    sample_time_s: float,
    *,
    mean_output: bool = False,
) -> tuple[Floats, Floats, float]:
    """Return values (8,), their sigma (8,) by the delta method and the error, for one theta (p,).

    ``covariance`` (p, p). The Jacobian is taken by central differences, each step in proportion to
    the parameter's sigma.
    """
    count = orders.na + (orders.nb[0] if orders.nb else 0)
    steps = _STEP + 1e-3 * np.sqrt(np.maximum(np.diag(covariance)[:count], 0.0))
    shifts = np.zeros((2 * count, len(theta)))
    shifts[:count, :count] = np.diag(steps)
    shifts[count:] = -shifts[:count]
    stack = np.concatenate([theta[None], theta[None] + shifts])
    values, error = yaw_channel(stack, orders, sample_time_s, mean_output=mean_output)
    jacobian = (values[1 : count + 1] - values[count + 1 :]).T / (2.0 * steps)
    with np.errstate(invalid="ignore"):
        variance = np.einsum("ki,ij,kj->k", jacobian, covariance[:count, :count], jacobian)
        return values[0], np.sqrt(np.maximum(variance, 0.0)), float(error[0])


def summary_of(
    theta: Floats,
    covariance: Floats,
    orders: ArmaxOrders,
    sample_time_s: float,
    *,
    mean_output: bool = False,
) -> dict[str, dict[str, float]]:
    """Return {name: {value, std}} for the JSON summary, empty where eq. 23 does not hold."""
    values, std, error = with_sigma(
        theta, covariance, orders, sample_time_s, mean_output=mean_output
    )
    if not (np.isfinite(values).all() and np.isfinite(std).all() and error <= LARGEST_ERROR):
        return {}
    return {
        name: {"value": float(value), "std": float(sigma)}
        for name, value, sigma in zip(NAMES, values, std, strict=True)
    }
