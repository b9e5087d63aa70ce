"""How much better a fit with its rudder explains the yaw rate than free decay or another rudder.

With the poles fixed all of these are linear. For N blocks and the sum of squares S of the whitened
residual, twice the logarithm of the likelihood is -N log(S / N) up to a constant, so that the ratio
of two is N / 2 log(S_0 / S_1) nats.
"""

import math
from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.manoeuvre.fit import Fit, descended
from yawid.manoeuvre.projection import Problem, ar_of, whitened
from yawid.manoeuvre.record import Blocks

_STEPS = 3


class FreeDecay(NamedTuple):
    """What the rudder adds: the likelihood ratio in nats, and free decay's whitened residual."""

    nats: float
    e: Floats


def free_decay(fit: Fit) -> FreeDecay:
    """Return a fit of yaw rate against the free decay of its poles, each with its own AR."""
    problem = _of_yaw(fit, fit.blocks)
    X = problem.columns(fit.blocks.responses(fit.structure.poles(fit.theta)))
    X = X[:, fit.elements.size :]
    y, D = fit.blocks.y[None, :, :1], np.eye(1)[None]
    for _ in range(_STEPS):
        W, z = (whitened(fit.blocks, D, x)[0] for x in (X[None], y))
        beta = np.linalg.lstsq(W, z[:, 0], rcond=1e-10)[0]
        D = ar_of(fit.blocks, y[:, :, 0] - X @ beta)
    e = whitened(fit.blocks, D, y - (X @ beta)[:, None])[0, :, 0]
    own = fit.e[0]
    gain = math.log(float(e @ e) / float(own @ own)) - 2.0 * math.log(D[0, 0, 0] / fit.D[0, 0, 0])
    return FreeDecay(0.5 * len(e) * gain, e)


def shifted(fit: Fit, rows: Ints) -> Floats:
    """Return the nats (k,) by which a fit is better than with its inputs later by ``rows`` (k,).

    Poles and AR stay; what leaves a record at one end comes in at the other one.
    """
    record = fit.blocks.record
    u = np.concatenate([np.roll(record.u, k, axis=0) for k in rows.tolist()], axis=1)
    blocks = Blocks(record.with_inputs(u), fit.blocks.q)
    problem = _of_yaw(fit, blocks)
    X = problem.columns(blocks.responses(fit.structure.poles(fit.theta)))
    W = whitened(blocks, problem.D, X[None])[0]
    y = whitened(blocks, problem.D, blocks.y[None, :, :1])[0, :, 0]
    forced = fit.elements.size * len(rows)
    Q = np.linalg.qr(W[:, forced:])[0]
    left, e = (x - Q @ (Q.T @ x) for x in (W[:, :forced], y))
    left = left.reshape(len(y), len(rows), -1).transpose(1, 0, 2)
    left /= np.linalg.norm(left, axis=1, keepdims=True) + 1e-300
    power = left.transpose(0, 2, 1) @ left + 1e-10 * np.eye(left.shape[2])
    slope = left.transpose(0, 2, 1) @ e
    squares = e @ e - np.einsum("kc,kc->k", slope, np.linalg.solve(power, slope[..., None])[..., 0])
    own = fit.e[0]
    found: Floats = 0.5 * len(y) * np.log(squares / float(own @ own))
    return found


def freed(fit: Fit, rows: int) -> float:
    """Return the same for one shift, with the poles free to follow it."""
    blocks = Blocks(fit.blocks.record.shifted(rows), fit.blocks.q)
    e = descended(_of_yaw(fit, blocks), fit.theta, 5, 0.5)[1].e
    own = fit.e[0]
    return 0.5 * len(e) * math.log(float(e @ e) / float(own @ own))


def simulated(fit: Fit) -> tuple[Floats, Floats]:
    """Return yaw rate (N,) in blocks, and what inputs and initial states alone make of it."""
    problem = _of_yaw(fit, fit.blocks)
    X = problem.columns(fit.blocks.responses(fit.structure.poles(fit.theta)))
    y = fit.blocks.y[:, 0]
    return y, X @ np.linalg.lstsq(X, y, rcond=1e-10)[0]


def _of_yaw(fit: Fit, blocks: Blocks) -> Problem:
    return Problem(blocks, fit.structure, fit.D[:, :1, :1])
