"""The fit of a manoeuvre: the poles of each structure by variable projection, with their sigma.

The grid over (log w, log z) of eq. 23 leaves no start to be lost from: all of its poles are
simulated at once. Levenberg's and Marquardt's steps follow its best minima, then the structures
(``projection.py`` has the equations) take over, white or with an AR, whichever has the least

    BIC = N log(e'e / N) - 2 N log D_0 + k log N

Sigma: with A = D [X_j beta, X], F = s^2 (A'A)^-1 is Fisher's, R = (A'A)^-1 M (A'A)^-1 that of
Newey and West, M being the Bartlett sum of the scores A_k e_k. The covariance of poles and
residues is the least matrix that is above both.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.manoeuvre.projection import (
    LAGGED,
    ROLL,
    ROLL_REAL,
    THREE,
    TWO,
    WITH_ROLL,
    Point,
    Problem,
    Structure,
    ar_of,
    orthogonal,
)
from yawid.manoeuvre.responses import LEAST_BLOCKS, Blocks, Record, block_size
from yawid.physics.modes import Complexes

PER_PERIOD: Final = 16
"""Blocks in a period of w. With the raw samples of a fine grid BIC prefers a resonance of the noise
at half the rate: at 50 Hz a business jet had 1.54 rad/s instead of 1.36."""
LEAST_ROWS, MOST_ROWS, FEWEST_ROWS = 80, 1200, 24
"""Blocks are shorter than that where they would be fewer than the first: the steps found nine
parameters in nine blocks. The grid's are longer where they would be more than the second, and there
is no fit of fewer samples than the third. By counting."""
GRID_W, GRID_Z = 36, (0.08, 0.25, 0.7)
"""The grid's frequencies, and its damping ratios: twice as many led to no other end in 242 drawn
flights, simulated aircraft and releases."""
MOST_STARTS: Final = 3
"""Minima of the grid that are followed."""
FINE_S: Final = 0.05
"""The grid's blocks in s."""
LEAST_W, MOST_W, OF_RATE = 0.25, 30.0, 0.6
"""The frequencies searched in rad/s, and the highest as a part of pi / Ts."""
_RIDGE: Final = 1e-10
TRIALS: Final = 3
"""Trials of a step that a descent has on average, before it ends where it is."""
LIGHTEST: Final = 0.002
"""A lighter pair is at an edge of the search, and has no vote."""
AR_ROUNDS: Final = 2
WORTH_BIC: Final = 20.0
"""What the aileron or large motion as an input, or a turn that is removed, must take off the least
BIC. Without it an aileron that hardly moved made wn 10 % wrong in gusts (chosen on 24 drawn flights
whose aileron is moved, too), in straight flight a removed turn made zeta of a 737 .03 worse (seed
8201), and a release of a linear aircraft was 5 % off with large motion."""
SMALL: Final = "_small"
"""What is added to a structure's name where large motion is an input."""


@dataclass(frozen=True, slots=True)
class Fit:
    """A structure fitted to a manoeuvre.

    ``theta`` and the residues' elements of yaw rate's beta have the ``covariance``, in this order.
    ``D`` (p + 1, o, o) is the AR polynomial and ``e`` (o, N) the whitened residual.
    ``pair`` is the one that is meant, and ``at_bound`` says that it ended where the search does.
    ``inputs`` is how many of the blocks' inputs are the record's own: a further one is large motion
    (:mod:`yawid.manoeuvre.large`), whose elements are left out.
    """

    blocks: Blocks
    structure: Structure
    theta: Floats
    elements: Floats
    covariance: Floats
    bic: float
    D: Floats
    e: Floats
    at_bound: bool
    inputs: int
    pair: int = 0

    @property
    def is_small(self) -> bool:
        """Whether large motion is an input, so that this is the small motion's."""
        return len(self.blocks.u) > self.inputs

    @property
    def name(self) -> str:
        """The structure's name, with ``SMALL`` where large motion is an input."""
        return self.structure.name + (SMALL if self.is_small else "")

    @property
    def log_pair(self) -> Floats:
        """The logarithms of wn in rad/s and zeta (2,)."""
        return self.theta[2 * self.pair : 2 * self.pair + 2]

    @property
    def pair_std(self) -> tuple[float, float]:
        """The sigmas of log wn and of zeta."""
        at = 2 * self.pair
        log_w, log_z = np.sqrt(np.diag(self.covariance)[at : at + 2]).tolist()
        return log_w, log_z * float(np.exp(self.log_pair[1]))

    def of_yaw(self, blocks: Blocks | None = None) -> Problem:
        """Return the problem of its yaw rate alone, with its inputs or with those of other blocks.

        Its AR is the yaw rate's own.
        """
        blocks = self.blocks if blocks is None else blocks
        return Problem(blocks, self.structure, self.D[:, :1, :1])

    def with_pair(self, wn_rad_s: float, zeta: float) -> "Fit":
        """Return a fit of yaw rate with its pair at wn and zeta; what is linear is solved again."""
        theta, problem = self.theta.copy(), self.of_yaw()
        theta[2 * self.pair : 2 * self.pair + 2] = math.log(wn_rad_s), math.log(zeta)
        return finished(problem, problem.at(theta), self.inputs)

    def simulated(self) -> tuple[Floats, Floats]:
        """Return the yaw rate r (n,) by a fit of yaw rate alone, and its pair's angle b (n,).

        They are 0 where it has no blocks.
        """
        beta, poles = self.of_yaw().at(self.theta).beta[0], self.structure.poles(self.theta)
        fine = Blocks(self.blocks.record, 1, LEAST_BLOCKS * self.blocks.q)
        responses = fine.responses(poles)
        swung = [
            each._replace(forced=k * each.forced, free=k * each.free)
            for k, each in zip((1.0 / poles[0], *np.zeros(len(poles) - 1)), responses, strict=True)
        ]
        of = self.of_yaw(fine)
        r, b = np.zeros((2, len(fine.record.u)))
        r[fine.rows] = of.columns(responses) @ beta
        swing = of.columns(swung) @ beta
        b[fine.rows] = swing - swing.mean()
        return r, b

    def response(self, w: Floats) -> tuple[Complexes, Complexes]:
        """Return G(jw) (inputs, n) at w (n,) in rad/s, and the slopes (parameters, inputs, n).

        The parameters are those of ``covariance``.
        """
        of, inputs, s = self.structure, self.inputs, 1j * w
        residues = of.residues(self.elements, inputs)
        basis, by_theta = [], []
        for i, (p, slopes) in enumerate(
            zip(of.poles(self.theta).tolist(), of.slopes(self.theta), strict=True)
        ):
            r, is_pair = residues[i][:, None], i < of.pairs
            terms = [(1.0, 1.0), (1j, -1j)] if is_pair else [(1.0, 0.0)]
            half = 0.5 if is_pair else 1.0
            basis += [
                half * (np.conj(c) / (s - p) + np.conj(d) / (s - np.conj(p))) for c, d in terms
            ]
            for dp in slopes:
                moved = r * dp / (s - p) ** 2
                if is_pair:
                    moved = moved + np.conj(r * dp) / (s - np.conj(p)) ** 2
                by_theta.append(half * moved)
        columns = of.mixing.T @ np.stack(basis)
        width = len(columns)
        G = self.elements.reshape(inputs, width) @ columns
        by_beta = np.zeros((inputs, width, inputs, len(w)), complex)
        by_beta[np.arange(inputs), :, np.arange(inputs)] = columns
        return G, np.concatenate([np.stack(by_theta), by_beta.reshape(-1, inputs, len(w))])


def limits(blocks: Blocks, of: Structure) -> tuple[Floats, Floats]:
    """Return the least and the largest theta of a structure."""
    fast = math.log(0.9 * math.pi / blocks.step_s)
    pair, real = ((-2.0, fast), (math.log(1e-3), -0.005)), ((-3.5, fast + 1.0),)
    other = ((-2.0, fast), (math.log(0.04), math.log(0.99)))
    found = pair + other * (of.pairs - 1) + real * of.reals
    low, high = np.array(found).T
    return low, high


def descended(problem: Problem, theta: Floats, steps: int = 12, tolerance: float = 1e-2) -> Point:
    """Return the point of the least squares near theta, by Levenberg and Marquardt.

    The steps end where twice the logarithm of the likelihood gains less than the tolerance.
    """
    low, high = limits(problem.blocks, problem.structure)
    theta = np.clip(theta, low, high)
    point, damping = problem.at(theta), 1e-3
    loss, rows = float(point.e @ point.e), len(point.e)
    for _ in range(steps * TRIALS):
        slope = point.J.T @ point.e
        stuck = ((theta <= low) & (slope > 0.0)) | ((theta >= high) & (slope < 0.0))
        J = np.where(stuck, 0.0, point.J)  # a bound that would be passed holds its element
        power, slope = J.T @ J, J.T @ point.e
        ridge = damping * np.diag(power) + 1e-12 * np.trace(power) + 1e-300
        move = -np.linalg.solve(power + np.diag(ridge), slope)
        new = np.clip(theta + move * min(1.0, 0.7 / np.abs(move).max(initial=1e-12)), low, high)
        if rows * abs(float(slope @ (new - theta))) < tolerance * loss:
            break
        there = problem.at(new)
        found = float(there.e @ there.e)
        if not found < loss:
            damping *= 6.0
            continue
        gain, loss = rows * math.log(loss / max(found, 1e-300)), found
        theta, point, damping, steps = new, there, max(damping / 5.0, 1e-9), steps - 1
        if gain < tolerance or steps == 0:
            break
    return point


def grid(blocks: Blocks) -> list[Floats]:
    """Return theta of the best minima of eq. 23's squares over the grid, the best one first.

    All poles of the grid are filtered at once. Each run's free responses are eliminated from the
    normal equations of the rest: residues, bias and the yaw rate itself.
    """
    low = max(LEAST_W, 2.0 * math.pi / (len(blocks) * blocks.step_s))
    ws = np.geomspace(low, min(MOST_W, OF_RATE * math.pi / blocks.step_s), GRID_W)
    z = np.array(GRID_Z)
    p: Complexes = (ws[:, None] * (-z + 1j * np.sqrt(1.0 - z * z))).ravel()
    (L, a, _, _), (d, b, _, _) = blocks.weights(p)
    drive, mean = blocks.u @ d.T, blocks.u @ b.T
    rest = 2 * len(drive) + 2
    total = np.zeros((len(p), rest, rest))
    for run in blocks.each():
        n = run.stop - run.start
        x = np.zeros((n, len(drive), len(p)), complex)
        for k, each in enumerate(drive[:, run].transpose(1, 0, 2)[:-1]):
            np.multiply(L, x[k], out=x[k + 1])
            x[k + 1] += each
        free = a * np.exp(p * (blocks.step_s * np.arange(n))[:, None])
        forced = (a * x).transpose(1, 0, 2) + mean[:, run]
        still = [np.broadcast_to(v[:, None], free.shape) for v in (np.ones(n), blocks.y[run, 0])]
        rows = [free.real, free.imag, *forced.real, *forced.imag, *still]
        power = np.empty((len(p), len(rows), len(rows)))
        for i, one in enumerate(rows):
            for j, other in enumerate(rows[: i + 1]):
                power[:, i, j] = power[:, j, i] = np.einsum("ng,ng->g", one, other)
        total += _eliminated(power, 2)
    loss = _eliminated(total, rest - 1)[:, 0, 0].reshape(len(ws), len(z))
    around = np.pad(loss, 1, constant_values=np.inf)
    near = np.lib.stride_tricks.sliding_window_view(around, (3, 3)).min(axis=(2, 3))
    at = sorted((float(loss[i, j]), i, j) for i, j in np.argwhere(loss <= near).tolist())
    return [np.log([ws[i], z[j]]) for _, i, j in at[:MOST_STARTS]]


def _eliminated(power: Floats, first: int) -> Floats:
    """Return normal equations (g, n, n) without their ``first`` unknowns."""
    size = np.sqrt(np.maximum(np.einsum("gii->gi", power), 0.0)) + 1e-150
    unit = power / (size[:, :, None] * size[:, None, :])
    own = unit[:, :first, :first] + _RIDGE * np.eye(first)
    rest = unit[:, first:, first:] - unit[:, first:, :first] @ np.linalg.solve(
        own, unit[:, :first, first:]
    )
    found: Floats = rest * (size[:, first:, None] * size[:, None, first:])
    return found


def unknowns(problem: Problem, point: Point) -> int:
    """Return how many numbers a fit found, those of the AR included."""
    found = len(point.theta) + point.beta.size + (len(problem.D) - 1) * problem.outputs**2
    return int(found)


def bic_of(problem: Problem, point: Point) -> float:
    """Return the BIC of a fit that ended at a point."""
    rows, N = len(point.e), len(problem.blocks)
    bic = rows * math.log(float(point.e @ point.e) / rows + 1e-300)
    bic -= 2.0 * N * math.log(np.linalg.det(problem.D[0]))
    return bic + unknowns(problem, point) * math.log(N)


def finished(problem: Problem, point: Point, inputs: int | None = None, pair: int = 0) -> Fit:
    """Return the fit at a point, where the steps ended, with so many of its ``inputs``, or all."""
    blocks, of, theta = problem.blocks, problem.structure, point.theta
    inputs = len(blocks.u) if inputs is None else inputs
    forced = problem.mixing.shape[1] * inputs
    low, high = limits(blocks, of)
    own = slice(2 * pair, 2 * pair + 2)
    low[own.start + 1] = math.log(LIGHTEST)
    return Fit(
        blocks, of, theta, point.beta[0, :forced],
        _covariance(problem, point, len(theta) + forced), bic_of(problem, point), problem.D,
        point.e.reshape(-1, len(blocks)), bool(((theta <= low) | (theta >= high))[own].any()),
        inputs, pair,
    )  # fmt: skip


def _covariance(problem: Problem, point: Point, first: int) -> Floats:
    """Return the covariance of the ``first`` parameters."""
    N = len(problem.blocks)
    A = np.concatenate([point.slopes, point.columns], axis=1)
    Q, root = orthogonal(A)
    scores = (Q * point.e[:, None]).reshape(problem.outputs, N, -1).sum(axis=0)
    lags = max(2, min(N // 8, PER_PERIOD))
    M = scores.T @ scores
    for i in range(1, lags):
        one = scores[i:].T @ scores[:-i]
        M += (1.0 - i / lags) * (one + one.T)
    free = max(len(A) - unknowns(problem, point), 1)
    root = root[:first]
    F = root @ root.T * (float(point.e @ point.e) / free)
    R = root @ M @ root.T * (len(A) / free)
    unit = np.sqrt(np.diag(F))
    F, R = F / np.outer(unit, unit), R / np.outer(unit, unit)
    size_F, V = np.linalg.eigh(F)
    root = V * np.sqrt(np.maximum(size_F, 1e-12))
    inner, T = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, R).T))
    half = (root @ T) * np.sqrt(np.maximum(inner, 1.0)) * unit[:, None]
    found: Floats = half @ half.T
    return found


def first_of(record: Record, q: int | None = None) -> Fit | None:
    """Return the fit "2" of yaw rate alone, None where there is too little to fit.

    See :func:`fits_of`.
    """
    rows = int(np.diff(record.runs).sum())
    coarse = Blocks(record, max(1, round(FINE_S / record.sample_time_s), rows // MOST_ROWS))
    if len(coarse) < FEWEST_ROWS or not (coarse.y[:, 0].any() and coarse.u[0].any()):
        return None
    problem = Problem(coarse, TWO, np.eye(1)[None])
    found = [descended(problem, each, 6, 0.1) for each in grid(coarse)]
    log_w, log_z = min(found, key=lambda each: float(each.e @ each.e)).theta
    pair = np.array([log_w, max(log_z, math.log(0.02))])
    q = q or block_size(record, math.exp(log_w), PER_PERIOD, LEAST_ROWS)
    return _fitted(Blocks(record, q), TWO, [pair])


def fits_of(record: Record, q: int | None = None, first: Fit | None = None) -> list[Fit]:
    """Return the fits of a manoeuvre: "2", "2L", "3", and "roll" where the record has roll.

    There is none of too few samples, or where yaw rate or rudder do not move. ``q`` is the size of
    the blocks, else it follows from the period: the BIC of two lists can be compared only if it is
    the same. ``first`` is the fit of :func:`first_of`, where it is known.
    """
    first = first or first_of(record, q)
    if first is None:
        return []
    blocks, pair = first.blocks, first.theta
    fits = [first] + [
        _fitted(blocks, of, [np.append(pair, pair[0] + each) for each in lags])
        for of, lags in ((LAGGED, (0.6, 1.2, 2.0)), (THREE, (-1.9, -1.1, -0.3, 0.4, 1.1)))
    ]
    best = min(fits, key=lambda fit: fit.bic)
    return [*fits, _with_roll(blocks, best.theta[:2])] if record.y.shape[1] > 1 else fits


def refitted(fit: Fit, blocks: Blocks) -> Fit:
    """Return the fit of the same structure, from where it ended, to blocks with more inputs."""
    if fit.structure.name != ROLL:
        return _fitted(blocks, fit.structure, [fit.theta], fit.inputs)
    point = Problem(blocks, fit.structure, fit.D).at(fit.theta)
    return finished(*_with_ar(blocks, fit.structure, point), fit.inputs, fit.pair)


def _fitted(
    blocks: Blocks, of: Structure, starts: Sequence[Floats], inputs: int | None = None
) -> Fit:
    """Return the fit of yaw rate alone, white or AR."""
    problem = Problem(blocks, of, np.eye(1)[None])
    white = descended(problem, problem.best_of(starts) if len(starts) > 1 else starts[0])
    ends = [(problem, white), _with_ar(blocks, of, white)]
    return finished(*min(ends, key=lambda end: bic_of(*end)), inputs)


def _with_ar(blocks: Blocks, of: Structure, point: Point) -> tuple[Problem, Point]:
    """Return the problem and the point with the AR of its own residual."""
    for _ in range(AR_ROUNDS):
        problem = Problem(blocks, of, ar_of(blocks, point.v))
        point = descended(problem, point.theta)
    return problem, point


def _with_roll(blocks: Blocks, pair: Floats) -> Fit:
    """Return the fit of yaw rate and roll; whether its loop is a pair or two real modes is seen."""
    w, lags = pair[0], (0.2, 1.2)
    starts = {
        WITH_ROLL: [
            np.array([*pair, w + math.log(k), math.log(z), w + lag])
            for k in (0.5, 0.8, 1.5)
            for z in (0.35, 0.7)
            for lag in lags
        ],
        ROLL_REAL: [np.array([*pair, w - 1.0, w + x, w + lag]) for x in (0.4, 0.9) for lag in lags],
    }
    point = Problem(blocks, WITH_ROLL, np.eye(2)[None]).at(starts[WITH_ROLL][0])
    D = ar_of(blocks, point.v)
    found = []
    for of, each in starts.items():
        problem = Problem(blocks, of, D)
        found.append((of, descended(problem, problem.best_of(each), 4)))
    of, point = min(found, key=lambda one: float(one[1].e @ one[1].e))
    problem, point = _with_ar(blocks, of, point)
    (own,), pairs = TWO.poles(pair), of.poles(point.theta)[: of.pairs]
    return finished(problem, point, pair=int(np.argmin(np.abs(np.log(pairs / own)))))


def best_alone(fits: Sequence[Fit], *, small: bool = False) -> Fit | None:
    """Return the fit of yaw rate alone with the least BIC, None without one.

    It is one of the proportional fits, or of those of ``small`` motion.
    """
    alone = (fit for fit in fits if fit.structure.name != ROLL and fit.is_small == small)
    return min(alone, key=lambda fit: fit.bic, default=None)
