"""From theta to poles, modes and the Dutch roll, for a whole block of estimates at once.

The estimated model is a continuous one sampled with a zero-order hold, so that a discrete pole z is
exactly the continuous pole s = ln(z) / Ts in rad/s, with wn = |s| and zeta = -Re(s) / |s|. Their
sigma is that of the delta method: with A(z) = z^na + a1 z^(na-1) + ... and its derivative A'(z) at
a simple root,

    dz/da_i = -z^(na-i) / A'(z),   ds = dz / (z Ts),   dwn = Re(conj(s) ds) / |s|.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Columns, EstimateBlock, Floats, Ints, ModesBlock, finite
from yawid.config.estimator import ArmaxOrders

Complexes = NDArray[np.complex128]

LOWEST_DUTCH_ROLL_HZ = 0.05
"""Lowest natural frequency of a pole that may be the Dutch roll."""
HIGHEST_DUTCH_ROLL_OF_RATE = 0.4
"""Its highest natural frequency, as a share of the sample rate."""


def orders_of(parameters: Sequence[str]) -> ArmaxOrders:
    """Return the orders of a model, for its first input, from the names of its parameters.

    nk, which the names do not contain, is 1: it has no effect where one pair of poles oscillates.
    """
    na, nc = (sum(name[0] == letter for name in parameters) for letter in "ac")
    nb = sum(name[0] == "b" and name[1:].isdigit() for name in parameters)
    return ArmaxOrders(na=na, nb=(nb,), nc=nc, nk=(1,))


@dataclass(frozen=True, slots=True)
class Poles(Columns):
    """The poles of rows of a (n, na): discrete ``z``, continuous ``s`` in rad/s, and A'(z)."""

    z: Complexes
    s: Complexes
    slopes: Complexes


def poles_of(a: Floats, sample_time_s: float) -> Poles:
    """Return the poles (n, na) of coefficients ``a`` (n, na), z^na + a1 z^(na-1) + ...

    Rows are sorted by |ln z|, then by the imaginary part; a row that is not finite, or all 0 before
    the first estimate, is NaN. ``s`` in rad/s is NaN where z has no continuous counterpart, too: on
    the negative real axis or at 0.
    """
    n, na = a.shape
    if na == 0:
        nothing = np.zeros((n, 0), np.complex128)
        return Poles(nothing, nothing, nothing)
    companion = np.zeros((n, na, na))
    good = np.isfinite(a).all(axis=1) & (a != 0.0).any(axis=1)
    companion[:, 0, :] = np.where(good[:, None], -a, 0.0)
    companion[:, np.arange(1, na), np.arange(na - 1)] = 1.0
    z: Complexes = np.linalg.eigvals(companion).astype(np.complex128)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ln_z = np.log(z)
        key = np.nan_to_num(np.abs(ln_z), posinf=1e3)
        # |ln z| of a conjugate pair differs in its last bits; rounding keeps the pair together.
        order = np.lexsort((z.imag, np.round(key, 9)))
        z, ln_z = (np.take_along_axis(x, order, axis=1) for x in (z, ln_z))
        z[~good] = np.nan
        # Only s becomes NaN: the slopes at the other poles need the distance to this z.
        continuous = (z.imag != 0.0) | (z.real > 0.0)
        s = np.where(continuous, ln_z / sample_time_s, np.nan).astype(np.complex128)
        return Poles(z, s, without_each(z[:, :, None] - z[:, None, :]))


def modes(
    estimates: EstimateBlock,
    orders: ArmaxOrders,
    sample_time_s: float,
    *,
    mean_output: bool = False,
) -> ModesBlock:
    """Return continuous poles, their wn and zeta with sigma, and the Dutch roll, for n estimates.

    Sigma is NaN where the estimates have no covariance. The yaw channel is left empty, see
    :mod:`yawid.physics.stage`. A pole on the negative real axis or at 0 has no continuous
    counterpart and is NaN; unstable poles are reported as they are, with zeta < 0. For
    ``mean_output`` see :func:`residues_of`.
    """
    n, na = len(estimates), orders.na
    theta = estimates.theta
    poles = poles_of(theta[:, :na], sample_time_s)
    discrete = discrete_residues(theta, poles, orders)
    residues = residues_of(discrete, poles, sample_time_s, mean_output=mean_output)
    s = poles.s
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        wn = np.abs(s)
        zeta = -s.real / wn
        wn_std, zeta_std = np.full((n, na), np.nan), np.full((n, na), np.nan)
        if estimates.covariance is not None:
            covariance = estimates.covariance[:, :na, :na]
            wn_std, zeta_std = _sigmas(poles, covariance, sample_time_s)
    best = dutch_roll_index(s, residues, sample_time_s)
    columns = (wn, wn_std, zeta, zeta_std)
    for column in (s, *columns):
        _leave_one_nan(column)
    dutch_roll = np.full((n, 4), np.nan)
    if na:
        picked = [np.take_along_axis(c, np.maximum(best, 0)[:, None], axis=1) for c in columns]
        dutch_roll = np.where(best[:, None] >= 0, np.concatenate(picked, axis=1), np.nan)
    nothing = np.empty((n, 0))
    return ModesBlock(s, wn, wn_std, zeta, zeta_std, dutch_roll, nothing, nothing)


def _leave_one_nan(values: Complexes | Floats) -> None:
    """Give all NaNs the same bits: their sign depends on how many rows are computed at once."""
    parts = values.view(np.float64)
    parts[np.isnan(parts)] = np.nan


def residues_of(
    discrete: Complexes, poles: Poles, sample_time_s: float, *, mean_output: bool = False
) -> Complexes:
    """Return the residues R (n, na) of the continuous model, the sum of R/(s - p).

    ``discrete`` (n, na) are those of :func:`discrete_residues`. A zero-order hold turns each term
    into R (z_p - 1)/p / (z - z_p). Where the output is the mean over the interval before the sample
    (``mean_output``), that discrete residue is R (z_p - 1)^2 / (p^2 Ts z_p) instead. Both are
    undone here exactly.
    """
    z, s = poles.z, poles.s
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        residues = discrete * s / (z - 1.0)
        return residues * s * sample_time_s * z / (z - 1.0) if mean_output else residues


def discrete_residues(theta: Floats, poles: Poles, orders: ArmaxOrders) -> Complexes:
    """Return the residues r (n, na) of B / A, the sum of r/(z - z_p), of the first input.

    A dead time, nk above 1, is left out: the model's gain and zeros are those without it.
    """
    nb, nk = (orders.nb[0], min(orders.nk[0], 1)) if orders.nb else (0, 1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        powers = poles.z[:, :, None] ** (-(nk + np.arange(nb)))
        # Not by an operator, of which NumPy swaps the factors in long blocks.
        terms = np.multiply(theta[:, None, orders.na : orders.na + nb], powers)
        return np.asarray(terms.sum(axis=2) * poles.z**orders.na / poles.slopes)


def dutch_roll_index(s: Complexes, residues: Complexes, sample_time_s: float) -> Ints:
    """Return the column (n,) of the Dutch roll, -1 where no pole oscillates in its band.

    It is the oscillatory pole with the most energy |R|^2/(2 |Re s|) in its impulse response, of
    0.05 Hz to 0.4 times the sample rate. ``s`` (n, na) in rad/s, ``residues`` (n, na).
    """
    if s.shape[1] == 0:
        return np.full(len(s), -1)
    low = 2.0 * np.pi * LOWEST_DUTCH_ROLL_HZ
    high = 2.0 * np.pi * HIGHEST_DUTCH_ROLL_OF_RATE / sample_time_s
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        wn = np.abs(s)
        energy = np.abs(residues) ** 2 / (2.0 * np.abs(s.real))
        fits = (s.imag > 0.0) & (wn >= low) & (wn <= high) & np.isfinite(energy)
    score = np.where(fits, energy, -1.0)
    best = np.argmax(score, axis=1)
    return np.where(score[np.arange(len(s)), best] >= 0.0, best, -1)


def without_each(x: Complexes) -> Complexes:
    """Return the products (..., m) over the last axis (m,), the k-th without its k-th factor.

    The axis before the last one is k, or of length 1 where all k have the same factors.
    """
    return np.asarray(np.where(np.eye(x.shape[-1], dtype=bool), 1.0, x).prod(axis=-1))


def _sigmas(poles: Poles, covariance: Floats, sample_time_s: float) -> tuple[Floats, Floats]:
    """Return sigma of wn in rad/s and of zeta (n, na) for every pole, by the delta method."""
    z, s, na = poles.z, poles.s, poles.z.shape[1]
    powers = np.empty((*z.shape, na), np.complex128)
    for i in range(na):  # one column at a time: all at once takes three times as long
        np.power(z, na - 1 - i, out=powers[:, :, i])
    ds = -powers / poles.slopes[:, :, None] / (z[:, :, None] * sample_time_s)
    wn = np.abs(s)[:, :, None]
    dwn = (np.conj(s)[:, :, None] * ds).real / wn
    dzeta = -ds.real / wn + s.real[:, :, None] / wn**2 * dwn
    # A matrix product for each row, not einsum: its bits must not depend on the block's length.
    wn_std, zeta_std = (
        np.sqrt(np.maximum((np.matmul(d, covariance) * d).sum(axis=2), 0.0)) for d in (dwn, dzeta)
    )
    return wn_std, zeta_std


def pair_poles(wn_rad_s: float, zeta: float, sample_time_s: float) -> Complexes:
    """Return the two poles (2,) of a mode in the z plane; they are real where zeta is 1 or more."""
    root = np.sqrt(complex(zeta**2 - 1.0))
    return np.asarray(np.exp(wn_rad_s * sample_time_s * (-zeta + np.array([root, -root]))))


def damping_lines() -> list[Complexes]:
    """Return five lines of constant zeta, 0.1 to 0.9, in the upper half of the z plane, (60,)."""
    lines = []
    for zeta in (0.1, 0.3, 0.5, 0.7, 0.9):
        root = np.sqrt(1.0 - zeta**2)
        lines.append(np.exp((-zeta + 1j * root) * np.linspace(0.0, np.pi / root, 60)))
    return lines


def mode_list(block: ModesBlock) -> list[dict[str, Any]]:
    """Return the modes of the last row for the summary, a pair once; only finite numbers.

    Frequencies are in rad/s, periods and time constants in s.
    """
    found = []
    for i, s in enumerate(block.poles[-1]):
        if not np.isfinite(s) or s.imag < 0.0:
            continue
        values = {
            "wn_rad_s": block.wn[-1, i],
            "wn_std": block.wn_std[-1, i],
            "zeta": block.zeta[-1, i],
            "zeta_std": block.zeta_std[-1, i] if s.imag > 0.0 else np.nan,
            "period_s": 2.0 * np.pi / s.imag if s.imag > 0.0 else np.nan,
            "time_constant_s": -1.0 / s.real if s.real != 0.0 else np.nan,
        }
        kind = "oscillatory" if s.imag > 0.0 else "real"
        found.append({"kind": kind} | finite(values))
    return found
