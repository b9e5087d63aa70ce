"""The predictor: what p, r and roll should be one sample ahead, by the steady Kalman filter.

All functions work on v variants of a model at once, because the fit needs its slope along every
parameter. A leading axis of 1 stands for all v.
"""

import math
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import System
from yawid.lateral.motion import Flags


@dataclass(frozen=True, slots=True)
class Predictor:
    """A model sampled, and its steady filter: v variants.

    x(k+1) = Phi x(k) + drive u(k) + trim c + K e(k). ``P`` is the covariance of the prediction,
    ``Q`` that of a step's noise; ``whiten`` (v, 3, 3) is the
    inverse of S's lower Cholesky factor L and ``log_det`` (v,) the logarithm of L's determinant.
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
        from scipy.linalg import solve_discrete_are  # it takes long to load, and few runs need it

        half, area, moment = exponential(model.A, sample_time_s / 2.0)
        Phi, moment = half @ half, moment + half @ (moment + 0.5 * sample_time_s * area)
        area = area + half @ area
        Q = model.Q + 4.0 * _around(half, model.Q) + _around(Phi, model.Q)  # Simpson's rule
        Q = Q * sample_time_s / 6.0
        if not (np.isfinite(Q).all() and np.isfinite(model.R).all()):
            raise np.linalg.LinAlgError("the model is not finite")
        if near is None:
            pairs = zip(Phi, model.C, Q, model.R, strict=True)
            P = np.array([solve_discrete_are(F.T, C.T, Q, R) for F, C, Q, R in pairs])
        else:
            P = _sum_around(Phi - near.K @ model.C, Q + _around(near.K, model.R))
        K, whiten, log_det = _gain(Phi, model.C, P, model.R)
        sloped = (0.5 * sample_time_s * area - moment) @ model.B
        drive, trim = np.concatenate([area @ model.B, sloped], axis=2), area[:, :, :4]
        return cls(Phi, model.C, drive, trim, K, P, Q, whiten, log_det)


def exponential(A: Floats, time_s: float) -> tuple[Floats, Floats, Floats]:
    """Return exp(A t), the integrals of exp(A s) and s exp(A s) from 0 to t, for A (v, n, n).

    A line as input makes its value and its slope states of a larger system (Van Loan 1978).
    """
    from scipy.linalg import expm  # it takes long to load, and few runs need it

    if not np.isfinite(A).all():
        raise np.linalg.LinAlgError("the model is not finite")
    v, n, _ = A.shape
    larger = np.zeros((v, 3 * n, 3 * n))
    larger[:, :n, :n], larger[:, : 2 * n, n:] = A, np.eye(2 * n)
    Phi, area, ramp = np.split(expm(larger * time_s)[:, :n], 3, axis=2)
    return Phi, area, time_s * area - ramp


def _around(Phi: Floats, Q: Floats) -> Floats:
    return np.asarray(Phi @ Q @ Phi.swapaxes(1, 2), np.float64)


def _sum_around(F: Floats, Q: Floats) -> Floats:
    """Return the sum (v, n, n) of F^i Q F^i' over all i from 0: X = F X F' + Q solved."""
    v, n, _ = Q.shape
    twice = np.einsum("vij,vkl->vikjl", F, F).reshape(v, n * n, n * n)
    return np.linalg.solve(np.eye(n * n) - twice, Q.reshape(v, -1, 1)).reshape(Q.shape)


def _gain(Phi: Floats, C: Floats, P: Floats, R: Floats) -> tuple[Floats, Floats, Floats]:
    """Return K (v, 6, 3), the whitening (v, 3, 3) and log det L (v,) of S = L L' = C P C' + R."""
    seen = P @ C.swapaxes(1, 2)
    factor = np.linalg.cholesky(C @ seen + R)
    whiten = np.linalg.inv(factor)
    K = Phi @ seen @ (whiten.swapaxes(1, 2) @ whiten)
    return K, whiten, np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)


def unused(missing: Flags) -> Flags:
    """Return which samples (n,) show nothing: those of a gap, and as many after it.

    The filter sees lines over a gap, and its innovations after it are larger.
    """
    found = missing.copy()
    for begin, end in np.flatnonzero(np.diff(missing, prepend=False, append=False)).reshape(-1, 2):
        found[begin : 2 * end - begin] = True
    return found


def whitened(of: Predictor, y: Floats, u: Floats, start: Floats, trim: Floats) -> Floats:
    """Return the whitened innovations (v, n, 3).

    ``y`` (v, n, 3) are p, r and roll, ``u`` (v, n, 8) the inputs' means and slopes over each step,
    ``start`` (v, 4) are the first four states of the first sample and ``trim`` (v, 4) the trims,
    whose number of rows is v. The whitening has a mean determinant of 1, so that the sum of squares
    has its least where the likelihood is largest, whatever the scale of the noise.

    The run is cut into about sqrt(n) blocks of about sqrt(n) samples, which are run through side by
    side: from rest, to find the state at the start of each, and then from there.
    """
    v, n = len(start), y.shape[1]
    length = math.isqrt(n - 1) + 1
    blocks = -(-n // length)
    known = np.zeros((len(u), blocks * length, 11))
    known[:, :n, :8], known[:, :n, 8:] = u, y
    known = known.reshape(-1, blocks, length, 11).transpose(2, 0, 1, 3)
    into = np.concatenate([of.drive, of.K], axis=2).swapaxes(1, 2)
    pushed = known @ into + trim[:, None] @ of.trim.swapaxes(1, 2)
    Ft = (of.Phi - of.K @ of.C).swapaxes(1, 2)
    rest = np.zeros_like(pushed[0])
    for each in pushed:
        rest = rest @ Ft + each
    states, over_block = np.empty((length, *rest.shape)), np.linalg.matrix_power(Ft, length)
    X = np.hstack([start, np.zeros((v, 2))])[:, None]
    for b in range(blocks):
        states[0, :, b] = X[:, 0]
        X = X @ over_block + rest[:, b : b + 1]
    for i, each in enumerate(pushed[:-1]):
        np.matmul(states[i], Ft, out=states[i + 1])
        states[i + 1] += each
    whiten = (of.whiten * np.exp(of.log_det / 3.0)[:, None, None]).swapaxes(1, 2)
    found = (known[..., 8:] - states @ of.C.swapaxes(1, 2)) @ whiten
    return np.asarray(found.transpose(1, 2, 0, 3).reshape(v, -1, 3)[:, :n], np.float64)
