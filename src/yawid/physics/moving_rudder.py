"""The continuous model that answers a rudder moving at any time, from one of means taken as held.

A rudder that moves between the samples is known by its mean over each of them, and an ARMAX model
takes that mean as held. Each weakens what moves at w by sinc(w Ts / 2), so that the
model's response is too large by the square: by 2 % at half a radian a sample, by 9 % at one. Some
of its poles make up for that, or alternate from sample to sample, and are no motion of the
aircraft. So its response is evaluated on the unit circle, put right, and a rational G(s) is fitted
to it: the Dutch roll's poles stay, the numerator and the other poles follow.
"""

from typing import Final

import numpy as np

from yawid.blocks import Bools, Floats, Ints
from yawid.config.estimator import ArmaxOrders
from yawid.physics.modes import Complexes, discrete_poles

LOWEST, HIGHEST, HIGHEST_OF_RATE = 0.1, 3.0, 0.25
"""The response is fitted from this part of wn to this multiple of it, or this part of the rate."""
POINTS: Final = 40
STEPS: Final = 3
"""Steps of Sanathanan and Koerner, each weighted by the denominator of the one before."""
Fit = tuple[Complexes, Complexes]
"""Poles and residues (n, m)."""
STAYS: Final = 1e-2
"""The weight of a relative change of the other poles' polynomial over that of the response."""
NEAR, NEARNESS = 4.0, 0.35
"""How much more the response weighs at wn than far away, and over which part of ln(w / wn)."""


def frequencies(p: Complexes, pair: Ints, sample_time_s: float) -> Floats:
    """Return the frequencies (n, k) in rad/s over which models with poles ``p`` (n, m) are fitted.

    ``pair`` (n,) is the column of the Dutch roll; where it is -1, wn is that of the slowest poles.
    """
    size = np.sort(np.abs(p), axis=1)
    slowest = np.sqrt(np.maximum(size[:, 0] * size[:, min(1, p.shape[1] - 1)], 1e-6))
    wn = np.where(pair >= 0, np.abs(p[np.arange(len(p)), pair]), slowest)
    top = np.minimum(HIGHEST * wn, HIGHEST_OF_RATE * 2.0 * np.pi / sample_time_s)
    growth = np.maximum(top / wn, 1.2) / LOWEST
    found: Floats = LOWEST * wn[:, None] * growth[:, None] ** np.linspace(0.0, 1.0, POINTS)
    return found


def of_pair(p: Complexes, pair: Ints) -> Bools:
    """Return which of the poles (n, m) are those of the Dutch roll at the columns ``pair`` (n,)."""
    pole = p[np.arange(len(p)), pair][:, None]
    apart = np.minimum(np.abs(p - pole), np.abs(p - np.conj(pole)))
    return (apart < 1e-9 * np.abs(pole)) & (pair >= 0)[:, None]


def response(
    theta: Floats, orders: ArmaxOrders, sample_time_s: float, w: Floats,
    *, held: bool, mean_output: bool,
) -> Complexes:  # fmt: skip
    """Return the continuous response (n, k) at w (n, k) of models theta (n, p) without dead time.

    ``held``: the rudder was held from sample to sample; else it moved, and was known by its mean.
    """
    z = np.exp(-1j * w * sample_time_s)
    den, num = np.ones_like(z), np.zeros_like(z)
    for i in range(orders.na):
        den += theta[:, i, None] * z ** (i + 1)
    for i in range(orders.nb[0]):
        num += theta[:, orders.na + i, None] * z ** (i + 1)
    hold = (1.0 - z) / (1j * w * sample_time_s)
    found: Complexes = num / den / (hold**2 if mean_output else hold)
    return found if held else found * np.abs(hold) ** 2


def followed(p: Complexes, stays: Bools, kept: Bools, w: Floats, G: Complexes) -> Fit:
    """Return poles and residues (n, m) with the response G (n, k) at w (n, k) in rad/s.

    ``p`` (n, m) in rad/s: some of them ``stays``, others that are ``kept`` move, and the rest has
    no effect.
    """
    poles, residues = p.copy(), np.zeros_like(p)
    masks = np.concatenate([stays, kept & ~stays], axis=1)
    for mask in np.unique(masks, axis=0):
        first, second = (np.flatnonzero(each) for each in np.split(mask, 2))
        at = np.ix_((masks == mask).all(axis=1), np.r_[first, second])
        if len(first) + len(second):
            rows = at[0].ravel()
            poles[at], residues[at] = _fitted(p[at], len(first), w[rows], G[rows])
    return poles, residues


def _fitted(p: Complexes, stay: int, w: Floats, G: Complexes) -> Fit:
    """Return poles and residues (n, m); the first ``stay`` poles do."""
    scale = w[:, :1] / LOWEST
    x: Complexes = np.asarray(1j * w / scale, np.complex128)
    p = p / scale
    wanted: Complexes = G * np.prod(x[:, :, None] - p[:, None, :stay], axis=2)
    start = den = _polynomial(p[:, stay:])
    for _ in range(STEPS if p.shape[1] > stay else 0):
        den = _step(wanted, x, start, den, p.shape[1])[1]
    others = discrete_poles(den[:, -2::-1])  # roots of any polynomial
    # A pole in the right half plane is no lag of an aircraft: then these stay as well.
    lost: Bools = np.any(np.maximum(others.real, p[:, stay:].real) >= 0.0, axis=1)
    den = np.where(lost[:, None], start, den)
    others = np.where(lost[:, None], p[:, stay:], others)
    poles: Complexes = np.concatenate([p[:, :stay], others], axis=1)
    num = _step(wanted, x, den, den, p.shape[1], moves=False)[0]
    apart = poles[:, :, None] - poles[:, None, :] + np.eye(p.shape[1])
    return poles * scale, _values(num, poles) / np.prod(apart, axis=2) * scale


def _step(
    wanted: Complexes, x: Complexes, start: Floats, before: Floats, terms: int,
    *, moves: bool = True,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return num (n, terms) and den (n, m + 1), lowest power first, with num / den as ``wanted``.

    ``start`` is the den that the new one is near to, ``before`` the one that weights.
    """
    free = start.shape[1] - 1 if moves else 0
    weight = 1.0 + NEAR * np.exp(-((np.log(np.abs(x)) / NEARNESS) ** 2))
    weight /= np.abs(wanted * _values(before, x))
    powers = x[:, :, None] ** np.arange(max(terms, free))
    columns = np.concatenate([powers[:, :, :terms], -wanted[:, :, None] * powers[:, :, :free]], 2)
    columns, right = columns * weight[:, :, None], wanted * _values(start, x) * weight
    rows, aim = (np.concatenate([z.real, z.imag], axis=1) for z in (columns, right))
    normal = rows.transpose(0, 2, 1) @ rows
    size = np.maximum(np.abs(start[:, :free]), 1e-3)
    i = np.arange(terms, terms + free)
    normal[:, i, i] += (STAYS / size) ** 2
    found = np.linalg.solve(normal, rows.transpose(0, 2, 1) @ aim[:, :, None])[:, :, 0]
    den = start.copy()
    den[:, :free] += found[:, terms:]
    return found[:, :terms], den


def _values(coefficients: Floats, x: Complexes) -> Complexes:
    """Return polynomials (n, m), lowest power first, at x (n, k)."""
    powers = x[:, :, None] ** np.arange(coefficients.shape[1])
    found: Complexes = (powers * coefficients[:, None, :]).sum(axis=2)
    return found


def _polynomial(roots: Complexes) -> Floats:
    """Return the real polynomials (n, m + 1), lowest power first, with roots (n, m)."""
    found = np.ones((len(roots), 1), complex)
    for each in roots.T:
        found = np.pad(found, ((0, 0), (1, 0))) - each[:, None] * np.pad(found, ((0, 0), (0, 1)))
    return found.real
