"""The projection: for given poles all else is linear, and only the poles are left to be searched.

Every structure is a sum of poles, so that each output y of the rudder and further inputs u_i is

    G_i(s) = sum_j 1/2 (r_ij / (s - p_j) + its conjugate) + sum_j c_ij / (s + a_j)
    y(t)   = sum_i G_i u_i + (free responses of the poles, in each run) + bias + v

    "2"     K (T s + 1) w^2 / (s^2 + 2 z w s + w^2): a pair alone             eq. 23
    "2L"    the same behind the servo's lag a: the residues sum to 0          eq. 23 / (s / a + 1)
    "3"     eq. 23 and a real mode next to it: roll, spiral
    "roll"  what the roll loop adds, too, a pair or two real modes, and a lag: fitted to yaw rate
            and roll, which have the same poles

With theta = log(w, z) of each pair and log(a), y = X(theta) beta + v is linear in the residues,
initial states and bias, beta. v is white or an AR(p) of the blocks, D(q) v = white of variance 1,
which acts on y and X alike. With P = I - D X (D X)^+ (Golub and Pereyra, 1973)

    e = P D y,   de/dtheta_j = -P D X_j beta - (D X)^+' (D X_j)' e,   X_j = dX/dtheta_j

Yaw rate and roll are whitened together, by an AR of both: gusts move both at once.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from yawid.blocks import Floats
from yawid.manoeuvre.responses import Blocks, Response
from yawid.physics.modes import Complexes

MOST_AR, ROWS_PER_LAG = 6, 20
"""The most lags of the AR, in blocks, and the fewest rows for each: BIC often takes fewer. On 84
rows six lags of two outputs made a roll loop out of noise. Chosen on 72 drawn flights."""
RIDGE: Final = 1e-5
"""What each unknown of a linear solution weighs by itself, where its column has the length 1: a row
of its own, so that columns that are alike leave it known. By calculation."""


class Structure(NamedTuple):
    """The poles of a model, complex pairs first; ``lagged``: its residues sum to 0."""

    name: str
    pairs: int
    reals: int
    lagged: bool = False

    def poles(self, theta: Floats) -> Complexes:
        """Return the poles of theta (pairs + reals,), one of each pair."""
        w, z = np.exp(theta[: 2 * self.pairs].reshape(-1, 2)).T
        pairs = w * (-z + 1j * np.sqrt(1.0 - z * z))
        return np.concatenate([pairs, -np.exp(theta[2 * self.pairs :])])

    def slopes(self, theta: Floats) -> list[list[complex]]:
        """Return the derivatives of each pole by its own elements of theta."""
        poles = self.poles(theta).tolist()
        w, z = np.exp(theta[: 2 * self.pairs].reshape(-1, 2)).T
        by_z = (w * z * (-1.0 - 1j * z / np.sqrt(1.0 - z * z))).tolist()
        return [list(each) for each in zip(poles, by_z, strict=False)] + [
            [p] for p in poles[self.pairs :]
        ]

    @property
    def mixing(self) -> Floats:
        """The matrix (columns, elements) from an input's elements of beta to its columns.

        A pair has a column for the real and one for the imaginary part of its response.
        """
        every = np.eye(2 * self.pairs + self.reals)
        if not self.lagged:
            return every
        every[-1, : 2 * self.pairs : 2] = -1.0
        return every[:, :-1]

    def residues(self, beta: Floats, inputs: int) -> Complexes:
        """Return the residues r (poles, inputs) that the first elements of beta stand for."""
        mixing = self.mixing
        width = mixing.shape[1]
        columns = mixing @ beta[: width * inputs].reshape(inputs, width).T
        pairs = columns[: 2 * self.pairs]
        return np.concatenate([pairs[::2] - 1j * pairs[1::2], columns[2 * self.pairs :]])


TWO, LAGGED, THREE = Structure("2", 1, 0), Structure("2L", 1, 1, True), Structure("3", 1, 1)
ROLL: Final = "roll"
WITH_ROLL, ROLL_REAL = Structure(ROLL, 2, 1), Structure(ROLL, 1, 3)


class Point(NamedTuple):
    """The fit at ``theta``, whitened rows being those of one output after the other, o N of them.

    ``e`` (o N,) is the whitened residual and ``v`` (o, N) the residual itself, ``J`` (o N,
    len(theta)) the slopes of e; ``beta`` (o, elements), ``columns`` (o N, o elements) D X and
    ``slopes`` (o N, len(theta)) D X_j beta.
    """

    theta: Floats
    e: Floats
    v: Floats
    J: Floats
    beta: Floats
    columns: Floats
    slopes: Floats


class Problem:
    """The projected fit of a structure to as many outputs o as the AR ``D`` (p + 1, o, o) has.

    The first output is the yaw rate, the second one roll.
    """

    def __init__(self, blocks: Blocks, structure: Structure, D: Floats) -> None:
        self.blocks, self.structure, self.D = blocks, structure, D
        self.outputs = D.shape[1]
        self.mixing = structure.mixing
        self._measured = blocks.y[:, : self.outputs].T
        self._y = whitened(blocks, D, self._measured[:, :, None]).ravel()

    def columns(self, responses: Sequence[Response]) -> Floats:
        """Return X (N, elements) at poles with these responses."""
        pairs, (N, inputs) = self.structure.pairs, responses[0].forced.shape
        poles = [part for i, r in enumerate(responses) for part in _parts(r.forced, i < pairs)]
        mixed = self.mixing.T @ np.stack(poles).reshape(len(poles), -1)
        forced = mixed.reshape(-1, N, inputs).transpose(1, 2, 0).reshape(N, -1)
        free = [part for i, r in enumerate(responses) for part in _parts(r.free, i < pairs)]
        return np.concatenate([forced, np.ones((N, 1)), *free], axis=1)

    def at(self, theta: Floats) -> Point:
        """Return the fit at theta."""
        responses = self.blocks.responses(self.structure.poles(theta))
        X = self.columns(responses)
        W, e, beta, Q, root = self._solved(X)
        slopes, turned = self._slopes(theta, responses, beta, e)
        J = Q @ (Q.T @ slopes - root.T @ turned) - slopes
        return Point(theta, e, self._measured - beta @ X.T, J, beta, W, slopes)

    def best_of(self, thetas: Sequence[Floats]) -> Floats:
        """Return the one of thetas with the least squares."""
        every = np.unique(np.concatenate([self.structure.poles(theta) for theta in thetas]))
        known = dict(zip(every.tolist(), self.blocks.responses(every), strict=True))

        def loss(theta: Floats) -> float:
            responses = [known[p] for p in self.structure.poles(theta).tolist()]
            e = self._solved(self.columns(responses))[1]
            return float(e @ e)

        return min(thetas, key=loss)

    def _solved(self, X: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Return D X, the whitened residual, beta, and Q and R^-1 of Q R = D X."""
        (N, m), o = X.shape, self.outputs
        wide = np.tensordot(self.D, lagged(self.blocks, X, len(self.D)), (0, 0))
        W = wide.transpose(0, 2, 1, 3).reshape(o * N, o * m)
        Q, root = orthogonal(W)
        beta = root @ (self._y @ Q)
        return W, self._y - W @ beta, beta.reshape(o, m), Q, root

    def _slopes(
        self, theta: Floats, responses: Sequence[Response], beta: Floats, e: Floats
    ) -> tuple[Floats, Floats]:
        """Return D X_j beta (o N, len(theta)), and (D X_j)' e (o elements, len(theta))."""
        of, inputs, runs = self.structure, len(self.blocks.u), len(self.blocks.runs)
        residues = np.stack([of.residues(each, inputs) for each in beta], axis=2)
        back = _adjoint(self.blocks, self.D, e.reshape(self.outputs, -1))
        forced = self.mixing.shape[1] * inputs
        at, row = forced + 1, 0
        moved, turned = [], []
        for i, (r, slopes) in enumerate(zip(responses, of.slopes(theta), strict=True)):
            is_pair = i < of.pairs
            free = beta[:, at : at + runs] + 0j
            if is_pair:
                free -= 1j * beta[:, at + runs : at + 2 * runs]
            v = r.forced_slope @ residues[i] + r.free_slope @ free.T
            g, h = back @ r.forced_slope, back @ r.free_slope
            for slope in slopes:
                moved.append((v * slope).real)
                base = np.zeros((self.outputs, inputs, len(self.mixing)))
                for part, of_base in enumerate(_parts(g * slope, is_pair)):
                    base[:, :, row + part] = of_base
                column = np.zeros(beta.shape)
                column[:, :forced] = (base @ self.mixing).reshape(self.outputs, -1)
                for part, of_free in enumerate(_parts(h * slope, is_pair)):
                    column[:, at + part * runs : at + (part + 1) * runs] = of_free
                turned.append(column.ravel())
            row, at = row + 1 + is_pair, at + runs * (1 + is_pair)
        wide = whitened(self.blocks, self.D, np.array(moved).transpose(2, 1, 0))
        return wide.reshape(-1, len(theta)), np.array(turned).T


def orthogonal(A: Floats) -> tuple[Floats, Floats]:
    """Return Q (n, m) and R^-1 (m, m) of A (n, m) = Q R, with ``RIDGE``.

    Normal equations would lose twice as many digits: then two processors, which round the last
    digit each in its own way, differ in the third digit of a sigma.
    """
    size = np.sqrt(np.einsum("ij,ij->j", A, A)) + 1e-300
    Q, R = np.linalg.qr(np.concatenate([A / size, RIDGE * np.eye(len(size))]))
    return Q[: len(A)], np.linalg.inv(R) / size[:, None]


def _parts(x: Complexes, is_pair: bool) -> tuple[Floats, ...]:
    return (x.real, x.imag) if is_pair else (x.real,)


def lagged(blocks: Blocks, x: Floats, count: int) -> Floats:
    """Return x (N, m) later by 0, 1, ... blocks, (count, N, m); before each run it is 0."""
    found = np.zeros((count, *x.shape))
    for run in blocks.each():
        for i in range(count):
            found[i, run][i:] = x[run][: run.stop - run.start - i]
    return found


def whitened(blocks: Blocks, D: Floats, x: Floats) -> Floats:
    """Return D(q) x of x (o, N, m) in each run, before which it is 0."""
    o, N, m = x.shape
    late = lagged(blocks, x.transpose(1, 0, 2).reshape(N, o * m), len(D))
    found: Floats = np.tensordot(D, late.reshape(-1, N, o, m), ([0, 2], [0, 2]))
    return found


def _adjoint(blocks: Blocks, D: Floats, e: Floats) -> Floats:
    """Return what multiplies x (o, N) in the product of e (o, N) and D(q) x."""
    early = np.zeros((len(D), *e.shape))
    for run in blocks.each():
        for i in range(len(D)):
            early[i, :, run.start : run.stop - i] = e[:, run.start + i : run.stop]
    found: Floats = np.tensordot(D, early, ([0, 1], [0, 1]))
    return found


def ar_of(blocks: Blocks, v: Floats) -> Floats:
    """Return the AR polynomial D (p + 1, o, o) that makes v (o, N) white, of variance 1.

    Its order has the least BIC; before each run v is 0.
    """
    o, N = v.shape
    most = min(MOST_AR, N // (ROWS_PER_LAG * o))
    wide = lagged(blocks, v.T, most + 1).transpose(1, 0, 2).reshape(N, -1)
    power = wide.T @ wide
    power += 1e-9 * np.diag(np.diag(power)) + 1e-300 * np.eye(len(power))
    least, best = math.inf, np.eye(o)[None]
    for p in range(most + 1):
        past = slice(o, o * (p + 1))
        A = np.linalg.solve(power[past, past], power[past, :o])
        S = (power[:o, :o] - power[:o, past] @ A) / N
        bic = N * float(np.linalg.slogdet(S)[1]) + p * o * o * math.log(N)
        if bic < least:
            D0 = np.linalg.inv(np.linalg.cholesky(S))
            parts = -A.T.reshape(o, p, o).transpose(1, 0, 2)
            least, best = bic, np.concatenate([D0[None], D0 @ parts])
    return best
