"""The predictor: what p, r and roll should be one sample ahead, by the steady Kalman filter.

All functions work on v variants of a model at once, because the fit needs its slope along every
parameter. A leading axis of 1 stands for all v.
"""

import math
from dataclasses import dataclass, fields

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.machine.products import simulated
from yawid.lateral.model import System
from yawid.lateral.motion import Flags

LARGEST, TERMS = 0.5, 14
"""The size of A t up to which so many terms of its power series have all bits."""
DOUBLINGS, TINY = 60, 1e-12
"""The most doublings of the time, and what may be left then of a start: Newton's step follows."""


@dataclass(frozen=True, slots=True)
class Predictor:
    """A model sampled, and its steady filter: v variants.

    x(k+1) = Phi x(k) + drive u(k) + trim c + K e(k). ``P`` is the covariance of the prediction,
    ``Q`` that of a step's noise; ``whiten`` (v, 3, 3) is the
    inverse of S's lower Cholesky factor L, times the cube root of its determinant, so that the sum
    of squares of what it whitens has its least where the likelihood is largest, whatever the scale
    of the noise. ``log_det`` (v,) is the logarithm of L's determinant.
    """

    Phi: Floats
    C: Floats
    drive: Floats
    trim: Floats
    K: Floats
    P: Floats
    Q: Floats
    whiten: Floats
    log_det: Floats

    @classmethod
    def of(
        cls, model: System, sample_time_s: float, near: "Predictor | None" = None
    ) -> "Predictor":
        """Return the predictor of a model.

        Next to a predictor whose model is ``near``, the covariance is that of one step of Newton's
        method (Kleinman 1968) from there: its error is the square of the distance.

        Raises:
            numpy.linalg.LinAlgError: a covariance is singular or not finite.
        """
        half, area, moment = exponential(model.A, sample_time_s / 2.0)
        Phi, moment = half @ half, moment + half @ (moment + 0.5 * sample_time_s * area)
        area = area + half @ area
        Q = model.Q + 4.0 * _around(half, model.Q) + _around(Phi, model.Q)  # Simpson's rule
        Q = Q * sample_time_s / 6.0
        if not (np.isfinite(Q).all() and np.isfinite(model.R).all()):
            raise np.linalg.LinAlgError("the model is not finite")
        if near is None:
            K, *_ = _gain(Phi, model.C, _steady(Phi, model.C, Q, model.R), model.R)
        else:
            K = near.K
        P = _sum_around(Phi - K @ model.C, Q + _around(K, model.R))
        K, whiten, log_det = _gain(Phi, model.C, P, model.R)
        sloped = (0.5 * sample_time_s * area - moment) @ model.B
        drive, trim = np.concatenate([area @ model.B, sloped], axis=2), area[:, :, :4]
        return cls(Phi, model.C, drive, trim, K, P, Q, whiten, log_det)

    def some(self, which: slice) -> "Predictor":
        """Return these of the variants."""
        return Predictor(*(getattr(self, each.name)[which] for each in fields(self)))


def exponential(A: Floats, time_s: float) -> tuple[Floats, Floats, Floats]:
    """Return exp(A t), the integrals of exp(A s) and s exp(A s) from 0 to t, for A (v, n, n).

    Their power series over a part of t is doubled until it is t (scaling and squaring).
    """
    if not np.isfinite(A).all():
        raise np.linalg.LinAlgError("the model is not finite")
    size = float(np.abs(A).sum(axis=2).max()) * time_s
    doublings = max(0, math.ceil(math.log2(max(size / LARGEST, 1.0))))
    h = time_s / 2.0**doublings
    term = np.broadcast_to(np.eye(A.shape[2]), A.shape)
    Phi, area, moment = np.zeros((3, *A.shape))
    for m in range(1, TERMS + 1):
        Phi, area = Phi + term, area + h / m * term
        moment, term = moment + h * h / (m + 1) * term, h / m * term @ A
    for _ in range(doublings):
        moment, area = moment + Phi @ (moment + h * area), area + Phi @ area
        Phi, h = Phi @ Phi, 2.0 * h
    return Phi, area, moment


def _steady(Phi: Floats, C: Floats, Q: Floats, R: Floats) -> Floats:
    """Return the steady covariance of the prediction (v, n, n).

    Each step doubles the time since a start without any knowledge (Chu, Fan, Lin and Wang 2004).
    """
    A, X, eye = Phi.swapaxes(1, 2), Q, np.eye(Phi.shape[1])
    G = C.swapaxes(1, 2) @ np.linalg.solve(R, C)
    for _ in range(DOUBLINGS):
        W = np.linalg.solve(eye + G @ X, np.concatenate([A, G], axis=2))
        A_W, G_W = np.split(W, 2, axis=2)
        G, X, A = G + A @ G_W @ A.swapaxes(1, 2), X + A.swapaxes(1, 2) @ X @ A_W, A @ A_W
        if np.abs(A).max() < TINY:
            break
    return X


def _around(Phi: Floats, Q: Floats) -> Floats:
    return np.asarray(Phi @ Q @ Phi.swapaxes(1, 2), np.float64)


def _sum_around(F: Floats, Q: Floats) -> Floats:
    """Return the sum (v, n, n) of F^i Q F^i' over all i from 0: X = F X F' + Q solved."""
    v, n, _ = Q.shape
    twice = np.einsum("vij,vkl->vikjl", F, F).reshape(v, n * n, n * n)
    return np.linalg.solve(np.eye(n * n) - twice, Q.reshape(v, -1, 1)).reshape(Q.shape)


def _gain(Phi: Floats, C: Floats, P: Floats, R: Floats) -> tuple[Floats, Floats, Floats]:
    """Return K (v, 6, 3), ``whiten`` (v, 3, 3) and log det L (v,) of S = L L' = C P C' + R."""
    seen = P @ C.swapaxes(1, 2)
    factor = np.linalg.cholesky(C @ seen + R)
    whiten = np.linalg.inv(factor)
    K = Phi @ seen @ (whiten.swapaxes(1, 2) @ whiten)
    log_det = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return K, whiten * np.exp(log_det / 3.0)[:, None, None], log_det


def unused(missing: Flags) -> Flags:
    """Return which samples (n,) show nothing: those of a gap, and as many after it.

    The filter sees lines over a gap, and its innovations after it are larger.
    """
    found = missing.copy()
    for begin, end in np.flatnonzero(np.diff(missing, prepend=False, append=False)).reshape(-1, 2):
        found[begin : 2 * end - begin] = True
    return found


def innovations(of: Predictor, known: Floats, into: Floats, seen: Floats, start: Floats) -> Floats:
    """Return the whitened innovations (n, 3, v) of v variants.

    ``known`` (n, m) are what goes by ``into`` (v, 6, m) into the next state and what is measured by
    ``seen`` (3, m) or (v, 3, m). ``start`` (6, v) are the states of the first sample.
    """
    whiten, m = of.whiten, known.shape[1]
    matrix = np.empty((start.shape[1], 9, m + 6))  # innovations and next state, of known and state
    matrix[:, :3, :m], matrix[:, 3:, :m] = whiten @ seen, into
    matrix[:, :3, m:], matrix[:, 3:, m:] = -whiten @ of.C, of.Phi - of.K @ of.C
    return simulated(np.ascontiguousarray(matrix.transpose(1, 2, 0)), start, known)
