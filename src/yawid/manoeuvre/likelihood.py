"""How much better a fit with its rudder explains the yaw rate than free decay or another rudder.

An aileron that is an input, too, stays what it is: only the rudder is taken away or moved.

With the poles fixed all of these are linear. For N blocks and the sum of squares S of the whitened
residual, twice the logarithm of the likelihood is -N log(S / N) up to a constant, so that the ratio
of two is N / 2 log(S_0 / S_1) nats.

Over wn and zeta the likelihood is a surface. At each of its points the other poles are those of the
least squares, to the second order: they start at their mean for this wn and zeta, and e loses what
a step of theirs takes off it. The contour k^2 / 2 nats below the top reaches k sigma of noise of wn
and of zeta.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.manoeuvre.fit import Fit, descended
from yawid.manoeuvre.projection import Problem, ar_of, whitened
from yawid.manoeuvre.responses import Blocks

_STEPS = 3
CONTOUR_SIGMAS, SURFACE_POINTS = 4.0, 11
"""How far the surface of the likelihood reaches, and its points, over wn and over zeta."""


def free_decay(fit: Fit) -> float:
    """Return the nats by which a fit is better than one without its rudder, each with its own AR.

    That has the free decay of the same poles, and what a further input makes of the yaw rate.
    """
    problem = fit.of_yaw()
    X = problem.columns(fit.blocks.responses(fit.structure.poles(fit.theta)))
    X = X[:, problem.mixing.shape[1] :]
    y, D = fit.blocks.y[None, :, :1], np.eye(1)[None]
    for _ in range(_STEPS):
        W, z = (whitened(fit.blocks, D, x)[0] for x in (X[None], y))
        beta = np.linalg.lstsq(W, z[:, 0], rcond=1e-10)[0]
        D = ar_of(fit.blocks, y[:, :, 0] - X @ beta)
    e = whitened(fit.blocks, D, y - (X @ beta)[:, None])[0, :, 0]
    own = fit.e[0]
    gain = math.log(float(e @ e) / float(own @ own)) - 2.0 * math.log(D[0, 0, 0] / fit.D[0, 0, 0])
    return 0.5 * len(e) * gain


def shifted(fit: Fit, rows: Ints) -> Floats:
    """Return the nats (k,) by which a fit is better than with its rudder later by ``rows`` (k,).

    Poles and AR stay, and further inputs; what leaves a record at one end comes in at the other.
    """
    problem = _later(fit, rows)
    blocks = problem.blocks
    X = problem.columns(blocks.responses(fit.structure.poles(fit.theta)))
    W = whitened(blocks, problem.D, X[None])[0]
    y = whitened(blocks, problem.D, blocks.y[None, :, :1])[0, :, 0]
    forced = problem.mixing.shape[1] * len(rows)
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
    e = descended(_later(fit, np.array([rows])), fit.theta, 5, 0.5).e
    own = fit.e[0]
    return 0.5 * len(e) * math.log(float(e @ e) / float(own @ own))


def _later(fit: Fit, rows: Ints) -> Problem:
    """Return the problem of rudders later by ``rows`` (k,), followed by the further inputs."""
    record = fit.blocks.record
    rudders = [np.roll(record.u[:, 0], k) for k in rows.tolist()]
    moved = replace(record, u=np.column_stack([*rudders, record.u[:, 1:]]))
    return fit.of_yaw(Blocks(moved, fit.blocks.q))


def simulated(fit: Fit) -> tuple[Floats, Floats]:
    """Return yaw rate (N,) in blocks, and what inputs and initial states alone make of it."""
    X = fit.of_yaw().columns(fit.blocks.responses(fit.structure.poles(fit.theta)))
    y = fit.blocks.y[:, 0]
    return y, X @ np.linalg.lstsq(X, y, rcond=1e-10)[0]


class Surface(NamedTuple):
    """By how many ``nats`` (m, n) a fit is better than with zeta (m,) and ``wn_rad_s`` (n,)."""

    wn_rad_s: Floats
    zeta: Floats
    nats: Floats


def surface(fit: Fit) -> Surface:
    """Return the likelihood of a fit of yaw rate over wn and zeta, its own being in the middle."""
    problem = fit.of_yaw()
    best = problem.at(fit.theta)
    least, rows = float(best.e @ best.e), len(best.e)
    C = np.linalg.pinv(best.J.T @ best.J)
    along = C[2:, :2] @ np.linalg.inv(C[:2, :2])
    reach = CONTOUR_SIGMAS * np.sqrt(np.diag(C)[:2] * least / rows)
    steps = reach[:, None] * np.linspace(-1.0, 1.0, SURFACE_POINTS)
    steps[1] = np.minimum(steps[1], -0.01 - fit.theta[1])
    nats = np.empty((SURFACE_POINTS, SURFACE_POINTS))
    for i, j in np.ndindex(nats.shape):
        pair = np.array([steps[0, j], steps[1, i]])
        point = problem.at(fit.theta + np.concatenate([pair, along @ pair]))
        others = point.J[:, 2:]
        left = point.e - others @ np.linalg.lstsq(others, point.e, rcond=None)[0]
        nats[i, j] = 0.5 * rows * math.log(float(left @ left) / least)
    wn, zeta = np.exp(fit.log_pair[:, None] + steps)
    return Surface(wn, zeta, nats)
