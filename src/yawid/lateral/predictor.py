"""The predictor: what p, r and roll should be one sample ahead, by the steady Kalman filter.

All functions work on v variants of a model at once, because the fit needs its slope along every
parameter. The innovations are linear in the state at the start and in the trims; they are returned
as columns, so that the fit can eliminate these.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import STATES, System
from yawid.lateral.motion import Flags

COLUMNS = 9
"""Columns of the innovations: the record's own, four of the state at the start, four of trims."""
_OF_STATE, _OF_TRIMS = slice(1, 5), slice(5, COLUMNS)
_TERMS, _SMALL = 8, 0.25
"""Terms of the series of the exponential, whose argument is halved until it is as small as this."""
_MOST_DOUBLINGS, _SETTLED = 40, 1e-12
SETTLE_S = 1.5
"""Time after a gap in s until the filter's covariance is the steady one again."""


@dataclass(frozen=True, slots=True)
class Predictor:
    """A model sampled, and its steady filter: v variants.

    x(k+1) = Phi x(k) + drive u(k) + trim c + K e(k). ``P`` is the covariance of the prediction,
    ``Q`` that of a step's noise, ``R`` that of the measurements; ``whiten`` (v, 3, 3) is the
    inverse of S's lower Cholesky factor L and ``log_det`` (v,) the logarithm of L's determinant.
    """

    Phi: Floats
    C: Floats
    drive: Floats
    trim: Floats
    K: Floats
    P: Floats
    Q: Floats
    R: Floats
    whiten: Floats
    log_det: Floats
    settle: int

    @classmethod
    def of(cls, model: System, sample_time_s: float) -> "Predictor":
        """Return the predictor of a model.

        Raises:
            numpy.linalg.LinAlgError: a covariance is singular or not finite.
        """
        Phi, area, moment = exponential(model.A, sample_time_s)
        half, *_ = exponential(model.A, sample_time_s / 2.0)
        Q = model.Q + 4.0 * _around(half, model.Q) + _around(Phi, model.Q)  # Simpson's rule
        Q = Q * sample_time_s / 6.0
        P = steady_covariance(Phi, model.C, Q, model.R)
        K, whiten, log_det = _gain(Phi, model.C, P, model.R)
        sloped = (0.5 * sample_time_s * area - moment) @ model.B
        drive, trim = np.concatenate([area @ model.B, sloped], axis=2), area[:, :, :4]
        settle = math.ceil(SETTLE_S / sample_time_s)
        return cls(Phi, model.C, drive, trim, K, P, Q, model.R, whiten, log_det, settle)


def exponential(A: Floats, time_s: float) -> tuple[Floats, Floats, Floats]:
    """Return exp(A t), the integrals of exp(A s) and s exp(A s) from 0 to t, for A (v, n, n)."""
    size = float(np.abs(A).sum(axis=2).max()) * time_s
    if not math.isfinite(size):
        raise np.linalg.LinAlgError("the model is not finite")
    halvings = max(0, math.ceil(math.log2(max(size, 1e-9) / _SMALL)))
    step = time_s / 2.0**halvings
    Ah = A * step
    term = np.asarray(np.broadcast_to(np.eye(A.shape[1]), A.shape), np.float64)
    Phi, area, moment = term, term, 0.5 * term
    for i in range(1, _TERMS + 1):
        term = term @ Ah / i
        Phi, area, moment = Phi + term, area + term / (i + 1), moment + term / (i + 2)
    area, moment = area * step, moment * step**2
    for _ in range(halvings):
        moment = moment + Phi @ (moment + step * area)
        area = area + Phi @ area
        Phi, step = Phi @ Phi, 2.0 * step
    return Phi, area, moment


def _around(Phi: Floats, Q: Floats) -> Floats:
    return np.asarray(Phi @ Q @ Phi.swapaxes(1, 2), np.float64)


def steady_covariance(Phi: Floats, C: Floats, Q: Floats, R: Floats) -> Floats:
    """Return the steady covariance (v, 6, 6) of the prediction, by doubling (Chu et al. 2004)."""
    one = np.eye(len(STATES))
    A, G, H = Phi.swapaxes(1, 2), C.swapaxes(1, 2) @ np.linalg.inv(R) @ C, Q
    for _ in range(_MOST_DOUBLINGS):
        AW = A @ np.linalg.inv(one + G @ H)
        more = A.swapaxes(1, 2) @ H @ np.linalg.solve(one + G @ H, A)
        G = G + AW @ G @ A.swapaxes(1, 2)
        A = AW @ A
        G, H = 0.5 * (G + G.swapaxes(1, 2)), H + 0.5 * (more + more.swapaxes(1, 2))
        if np.abs(more).max() <= _SETTLED * np.abs(H).max():
            break
    return H


def _gain(Phi: Floats, C: Floats, P: Floats, R: Floats) -> tuple[Floats, Floats, Floats]:
    """Return K (v, 6, 3), the whitening (v, 3, 3) and log det L (v,) of S = L L' = C P C' + R."""
    seen = P @ C.swapaxes(1, 2)
    factor = np.linalg.cholesky(C @ seen + R)
    whiten = np.linalg.inv(factor)
    K = Phi @ seen @ (whiten.swapaxes(1, 2) @ whiten)
    return K, whiten, np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)


def whitened(predictor: Predictor, y: Floats, u: Floats, missing: Flags) -> Floats:
    """Return the whitened innovations (v, n, 3, COLUMNS), 0 where the measurement is missing.

    ``y`` (n, 3) are p, r and roll, ``u`` (v, n, 8) the inputs' means and slopes over each step,
    ``missing`` (n,) is True where y is not known. In a gap the predictor runs on, with the
    covariance that belongs to it until SETTLE_S later. The whitening has a mean determinant of 1,
    so that the sum of squares has its least where the likelihood is largest, whatever the scale of
    the noise.
    """
    found = np.zeros((len(u), *y.shape, COLUMNS))
    X = np.zeros((len(u), len(STATES), COLUMNS))
    X[:, :4, _OF_STATE] = np.eye(4)
    log_det = np.zeros(len(u))
    for start, stop, is_steady in _runs(missing, predictor.settle):
        its = slice(start, stop)
        if is_steady:
            found[:, its], X = _steady(predictor, y[its], u[:, its], X)
            log_det += (stop - start) * predictor.log_det
        else:
            found[:, its], X, some = _unsettled(predictor, y[its], u[:, its], missing[its], X)
            log_det += some
    known = len(missing) - np.count_nonzero(missing)
    return found * np.exp(log_det / (3 * known))[:, None, None, None]


def _runs(missing: Flags, settle: int) -> Iterator[tuple[int, int, bool]]:
    """Yield runs of samples (start, stop, whether the steady filter holds)."""
    n, unsettled = len(missing), missing.copy()
    for at in np.flatnonzero(missing):
        unsettled[at : at + settle + 1] = True
    edges = [0, *(np.flatnonzero(np.diff(unsettled)) + 1).tolist(), n]
    for start, stop in pairwise(edges):
        if stop > start:
            yield start, stop, not unsettled[start]


def _steady(of: Predictor, y: Floats, u: Floats, X: Floats) -> tuple[Floats, Floats]:
    """Return the whitened innovations of a run and the states (v, 6, COLUMNS) after it.

    The run is cut into about sqrt(n) blocks of about sqrt(n) samples, which are run through side by
    side from rest; then each block gets what the state at its start adds.
    """
    v, n, _ = u.shape
    length = math.isqrt(n - 1) + 1
    blocks = -(-n // length)
    F = of.Phi - of.K @ of.C
    pushed = np.zeros((v, blocks * length, len(STATES)))
    pushed[:, :n] = u @ of.drive.swapaxes(1, 2) + y @ of.K.swapaxes(1, 2)
    pushed = pushed.reshape(v, blocks, length, len(STATES))
    rest = np.zeros((v, blocks, length + 1, len(STATES)))
    powers, trims = np.zeros((v, length + 1, 6, 6)), np.zeros((v, length + 1, 6, 4))
    powers[:, 0] = np.eye(6)
    Ft = F.swapaxes(1, 2)
    for i in range(length):
        rest[:, :, i + 1] = rest[:, :, i] @ Ft + pushed[:, :, i]
        powers[:, i + 1] = F @ powers[:, i]
        trims[:, i + 1] = F @ trims[:, i] + of.trim
    starts = np.empty((v, blocks, len(STATES), COLUMNS))
    for b in range(blocks):
        starts[:, b] = X
        X = powers[:, length] @ X
        X[:, :, 0] += rest[:, b, length]
        X[:, :, _OF_TRIMS] += trims[:, length]
    WC = of.whiten @ of.C
    seen = (WC[:, None] @ powers[:, :length]).reshape(v, 1, 3 * length, len(STATES))
    found = -(seen @ starts).reshape(v, blocks, length, 3, COLUMNS)
    found[..., 0] -= rest[:, :, :length] @ WC.swapaxes(1, 2)[:, None]
    found[..., _OF_TRIMS] -= (WC[:, None] @ trims[:, :length])[:, None]
    found = found.reshape(v, blocks * length, 3, COLUMNS)[:, :n]
    found[..., 0] += y @ of.whiten.swapaxes(1, 2)
    last = n - (blocks - 1) * length
    X = powers[:, last] @ starts[:, -1]
    X[:, :, 0] += rest[:, -1, last]
    X[:, :, _OF_TRIMS] += trims[:, last]
    return found, X


def _unsettled(
    of: Predictor, y: Floats, u: Floats, missing: Flags, X: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the same of a run with gaps, sample by sample, and the sum of log det L (v,)."""
    found, log_det, P = np.zeros((len(u), *y.shape, COLUMNS)), np.zeros(len(u)), of.P
    for k in range(len(missing)):
        e = -of.C @ X
        e[:, :, 0] += y[k]
        push = (of.drive @ u[:, k, :, None])[:, :, 0]
        X = of.Phi @ X
        X[:, :, 0] += push
        X[:, :, _OF_TRIMS] += of.trim
        if missing[k]:
            P = _around(of.Phi, P) + of.Q
            continue
        K, whiten, some = _gain(of.Phi, of.C, P, of.R)
        X = X + K @ e
        found[:, k] = whiten @ e
        log_det = log_det + some
        spread = np.asarray(np.linalg.inv(whiten.swapaxes(1, 2) @ whiten), np.float64)
        P = np.asarray(_around(of.Phi, P) + of.Q - _around(K, spread), np.float64)
    return found, X, log_det
