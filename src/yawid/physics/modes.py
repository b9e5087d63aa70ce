"""From theta to poles and modes, and the Dutch roll among them, for a whole block at once.

The estimated model is the zero-order-hold sampling of a continuous one, so a discrete pole z is
the continuous pole s = ln(z) / Ts exactly. wn = |s|, zeta = -Re(s) / |s|. Their sigma comes by the
delta method: with A(z) = z^na + a1 z^(na-1) + ... and its derivative A'(z) at a simple root,

    dz/da_i = -z^(na-i) / A'(z),   ds = dz / (z Ts),   dwn = Re(conj(s) ds) / |s|.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import EstimateBlock, Floats, ModesBlock
from yawid.config import ArmaxOrders

Complexes = NDArray[np.complex128]

LOWEST_DUTCH_ROLL_HZ = 0.05
HIGHEST_DUTCH_ROLL_OF_RATE = 0.4


def discrete_poles(a: Floats) -> Complexes:
    """Return the roots (n, na) of z^na + a1 z^(na-1) + ... for coefficients ``a`` (n, na).

    Rows are sorted by frequency, then by the sign of the imaginary part; a row of theta not yet
    estimated or not finite is NaN.
    """
    n, na = a.shape
    companion = np.zeros((n, na, na))
    good = np.isfinite(a).all(axis=1) & (a != 0.0).any(axis=1)
    companion[:, 0, :] = np.where(good[:, None], -a, 0.0)
    companion[:, np.arange(1, na), np.arange(na - 1)] = 1.0
    z: Complexes = np.linalg.eigvals(companion).astype(np.complex128)
    with np.errstate(divide="ignore", invalid="ignore"):
        key = np.nan_to_num(np.abs(np.log(z)), posinf=1e3)
    # Conjugates differ in the last bits of |ln z|; rounding keeps them side by side.
    row = np.arange(n)[:, None] + np.zeros((1, na), int)
    by_frequency = np.lexsort((z.imag.ravel(), np.round(key, 9).ravel(), row.ravel()))
    z = z.ravel()[by_frequency].reshape(n, na)
    z[~good] = np.nan
    return z


def modes(estimates: EstimateBlock, orders: ArmaxOrders, sample_time_s: float) -> ModesBlock:
    """Return continuous poles, their wn and zeta with sigma, and the Dutch roll, a row each.

    A pole on the negative real axis or at zero has no continuous counterpart and is NaN; unstable
    poles are reported as they are, with zeta < 0.
    """
    n, na = len(estimates), orders.na
    z = discrete_poles(estimates.theta[:, :na])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # NaN only the pole itself: the others' slopes still need its distance.
        continuous = (z.imag != 0.0) | (z.real > 0.0)
        s = np.where(continuous, np.log(z) / sample_time_s, np.nan).astype(np.complex128)
        wn = np.abs(s)
        zeta = -s.real / wn
        wn_std, zeta_std = np.full((n, na), np.nan), np.full((n, na), np.nan)
        if estimates.covariance is not None:
            covariance = estimates.covariance[:, :na, :na]
            wn_std, zeta_std = _sigmas(z, s, covariance, sample_time_s)
        b = estimates.theta[:, na : na + orders.nb[0]] if orders.nb else np.zeros((n, 0))
        energy = _energies(z, s, b, orders.nk[0] if orders.nk else 1)
    dutch_roll = _dutch_roll(s, wn, energy, sample_time_s, (wn, wn_std, zeta, zeta_std))
    return ModesBlock(s, wn, wn_std, zeta, zeta_std, dutch_roll)


def _slopes(z: Complexes) -> Complexes:
    """Return A'(z) at each of its roots: the product of its distances to the others."""
    distance = z[:, :, None] - z[:, None, :]
    distance[:, np.arange(z.shape[1]), np.arange(z.shape[1])] = 1.0
    slope: Complexes = np.prod(distance, axis=2)
    return slope


def _sigmas(
    z: Complexes, s: Complexes, covariance: Floats, sample_time_s: float
) -> tuple[Floats, Floats]:
    """Return sigma of wn and zeta (n, na) of every pole by the delta method."""
    na = z.shape[1]
    powers = z[:, :, None] ** np.arange(na - 1, -1, -1)
    ds = -powers / _slopes(z)[:, :, None] / (z[:, :, None] * sample_time_s)
    wn = np.abs(s)[:, :, None]
    dwn = (np.conj(s)[:, :, None] * ds).real / wn
    dzeta = -ds.real / wn + s.real[:, :, None] / wn**2 * dwn
    # Per-row matrix products, not einsum: the bits of a row must not depend on the block's length.
    wn_std, zeta_std = (
        np.sqrt(np.maximum((np.matmul(d, covariance) * d).sum(axis=2), 0.0)) for d in (dwn, dzeta)
    )
    return wn_std, zeta_std


def _energies(z: Complexes, s: Complexes, b: Floats, nk: int) -> Floats:
    """Return |R|^2 / (2 |Re s|) of every pole, R its residue in the continuous model from u to r.

    Sampling through a zero-order hold turns R/(s - p) into R (z_p - 1)/p / (z - z_p); undone here.
    """
    na = z.shape[1]
    lags = nk + np.arange(b.shape[1])
    numerator = (b[:, None, :] * z[:, :, None] ** (-lags)).sum(axis=2)
    residue = numerator * z**na / _slopes(z) * s / (z - 1.0)
    energy: Floats = np.abs(residue) ** 2 / (2.0 * np.abs(s.real))
    return energy


def _dutch_roll(
    s: Complexes, wn: Floats, energy: Floats, sample_time_s: float, columns: tuple[Floats, ...]
) -> Floats:
    """Return (wn, wn_std, zeta, zeta_std) of the pair with the most energy, else NaN."""
    high = 2.0 * np.pi * HIGHEST_DUTCH_ROLL_OF_RATE / sample_time_s
    fits = (s.imag > 0.0) & (wn >= 2.0 * np.pi * LOWEST_DUTCH_ROLL_HZ) & (wn <= high)
    score = np.where(fits & np.isfinite(energy), energy, -1.0)
    if score.shape[1] == 0:
        return np.full((len(s), 4), np.nan)
    best = np.argmax(score, axis=1)[:, None]
    picked = np.concatenate([np.take_along_axis(c, best, axis=1) for c in columns], axis=1)
    return np.where(np.take_along_axis(score, best, axis=1) >= 0.0, picked, np.nan)


def mode_list(block: ModesBlock, row: int = -1) -> list[dict[str, Any]]:
    """Return one row's modes for the summary: pairs once, absent where not finite."""
    found = []
    for i, s in enumerate(block.poles[row]):
        if not np.isfinite(s) or s.imag < 0.0:
            continue
        values = {
            "wn_rad_s": block.wn[row, i],
            "wn_std": block.wn_std[row, i],
            "zeta": block.zeta[row, i],
            "zeta_std": block.zeta_std[row, i] if s.imag > 0.0 else np.nan,
            "period_s": 2.0 * np.pi / s.imag if s.imag > 0.0 else np.nan,
            "time_constant_s": -1.0 / s.real if s.real != 0.0 else np.nan,
        }
        kind = "oscillatory" if s.imag > 0.0 else "real"
        found.append({"kind": kind} | finite(values))
    return found


def finite(values: dict[str, Any]) -> dict[str, Any]:
    """Return the entries that are finite, as floats: in JSON absent means not applicable."""
    return {name: float(value) for name, value in values.items() if np.isfinite(value)}
