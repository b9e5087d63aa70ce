"""The criterion: minus the logarithm of the likelihood, as a sum of squares.

The whitened innovations of all manoeuvres, less what each one's own start, trims and times of jumps
explain of them (variable projection, Golub and Pereyra 1973), and the distance of the parameters
from what is known beforehand. One scale of all noise is eliminated.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.estimation.machine.products import cross
from yawid.lateral.model import AILERON, AT, PARAMETERS, RUDDER, Guess, system
from yawid.lateral.predictor import Predictor, innovations
from yawid.lateral.record import LEAST_LAG_S, Record

_RIDGE = 1e-13
"""Of start and trims, as a share of their power: it holds what the record does not show."""
COMMANDS = (AILERON, RUDDER, AILERON + 4, RUDDER + 4)
"""The columns of the commands' means and slopes among the inputs of a step."""
STATE_RUNS = (1, 2, 3, 4, 9, 10)
"""The runs of a record that begin with a unit of each state."""
_DIFFERENCE = 1e-5
"""Step of the slopes in scales."""


class Criterion:
    """The criterion of some manoeuvres. A point is ``x`` (n,): the free parameters in scales.

    ``free`` (n,) are the places of the free parameters in PARAMETERS, ``scale``, ``mean`` and
    ``spread`` (n,) their scales and priors (spread is inf without one), ``fixed``
    (len(PARAMETERS),) the values of the others.
    """

    def __init__(
        self, records: Sequence[Record], guess: Guess, priors: dict[str, tuple[float, float]]
    ) -> None:
        self.records = records
        self.airspeed_m_s = float(np.mean([each.motion.airspeed_m_s for each in records]))
        stays = {"log_sigma_p"}
        if not any(record.aileron_moves for record in records):
            stays |= {"L_delta_a", "N_delta_a"}
        self.free = np.array([AT[each.name] for each in PARAMETERS if each.name not in stays])
        rows = [PARAMETERS[i] for i in self.free]
        self.names = tuple(each.name for each in rows)
        self.fixed = np.array([guess.start[each.name] for each in PARAMETERS])
        self.scale = np.array([each.scale(guess) for each in rows])
        least = [each.least(guess) if each.least else -math.inf for each in rows]
        self.least = np.array(least) / self.scale
        self.is_noise = np.array([each.is_noise for each in rows])
        known = [
            priors.get(each.name) or (each.prior(guess) if each.prior else (0.0, math.inf))
            for each in rows
        ]
        self.mean, self.spread = np.array(known).T
        self.count = 3 * sum(int(np.count_nonzero(~each.unused)) for each in records)
        """Measurements."""

    def begin_with_noise_of(self, other: "Criterion", x: Floats) -> None:
        """Let the noise begin as it is at another criterion's point ``x`` (n,)."""
        its = self.free[self.is_noise]
        self.fixed[its] = other.theta(x[None])[0, its]

    def part(self, record: Record, x: Floats, held: float) -> "Criterion":
        """Return the criterion of one record that begins at ``x`` (n,).

        All parameters are held there with ``held`` scales as their sigma at most.
        """
        part = copy(self)
        part.records, part.fixed = [record], self.theta(x[None])[0]
        part.mean, part.spread = x * self.scale, np.minimum(self.spread, held * self.scale)
        part.count = 3 * int(np.count_nonzero(~record.unused))
        return part

    def start(self) -> Floats:
        """Return the point (n,) at which the fit begins."""
        return np.asarray(np.maximum(self.fixed[self.free] / self.scale, self.least), np.float64)

    def theta(self, x: Floats) -> Floats:
        """Return all parameters (v, len(PARAMETERS)) at the points ``x`` (v, n)."""
        theta = np.repeat(self.fixed[None], len(x), axis=0)
        theta[:, self.free] = x * self.scale
        return theta

    def at(self, x: Floats) -> "Point":
        """Return the innovations at a point ``x`` (n,).

        Raises:
            numpy.linalg.LinAlgError: the predictor does not exist there.
        """
        theta = self.theta(x[None])
        parts = [_part(each, theta) for each in self.records]
        e = np.concatenate([each.e for each in parts])
        if not np.isfinite(e).all():
            raise np.linalg.LinAlgError("the innovations are not finite")
        surprise = np.asarray((x * self.scale - self.mean) / self.spread, np.float64)
        return Point(x, e, surprise, parts)

    def total(self, point: "Point") -> float:
        """Return twice the negative logarithm of likelihood and priors at a point."""
        variance = point.power / self.count
        return self.count * math.log(variance) + float(point.surprise @ point.surprise)

    def slopes(self, point: "Point") -> tuple[Floats, Floats]:
        """Return the slopes (l, n) of the innovations at a point, with its own start and the rest.

        What they would change in start, trims and times is left out, which changes neither the
        slope of the criterion nor the information (Kaufman 1975). The information (n, n) that the
        innovations' sizes have further is returned as well.
        """
        theta = self.theta(point.x + _DIFFERENCE * np.eye(len(point.x)))
        pairs = zip(self.records, point.parts, strict=True)
        slopes, informations = zip(*(_slopes(*pair, theta) for pair in pairs), strict=True)
        return np.vstack(slopes), np.sum(informations, axis=0)


@dataclass(frozen=True, slots=True)
class Part:
    """One manoeuvre at a point: predictor; start, trims, times, factors ``own`` (8 + j + m,).

    ``e`` (3 n + j,) are the innovations and those times over their sigma, ``columns``
    (3 n + j, 8 + j + m) what a unit of ``own`` adds to them, and ``power`` their products.
    """

    predictor: Predictor
    own: Floats
    columns: Floats
    power: Floats
    e: Floats


@dataclass(frozen=True, slots=True)
class Point:
    """The whitened innovations and times of jumps ``e`` (l,) at ``x`` (n,), 0 where missing.

    ``surprise`` (n,) is the distance from what is known beforehand, in sigma.
    """

    x: Floats
    e: Floats
    surprise: Floats
    parts: list[Part]

    @property
    def power(self) -> float:
        """The sum of squares of ``e``, the same whatever the number of threads."""
        return float(np.square(self.e).sum())

    def loss(self, variance: float) -> float:
        """Return the criterion for a given scale of the noise."""
        return self.power / variance + float(self.surprise @ self.surprise)


def _part(record: Record, theta: Floats) -> Part:
    """Return one manoeuvre at the parameters ``theta`` (1, len(PARAMETERS))."""
    pair = pair_of(theta[0])
    model = system(theta, record.motion.airspeed_m_s, record.pitch)
    predictor = Predictor.of(model, record.sample_time_s)
    count, n = len(record.jumps), len(record.y)
    surface, first, added = record.later(*pair)
    fades = np.exp(-record.sample_time_s / max(pair[0], LEAST_LAG_S)) ** np.arange(n)
    known = np.column_stack([record.inputs(*pair), record.y, np.ones(n), fades, record.large])
    # A run of the record, then of each unit of start, trim, gust, of commands that fade, and of c.
    k = record.large.shape[1]
    into, seen = np.zeros((15 + k, 6, 13 + k)), np.zeros((15 + k, 3, 13 + k))
    start = np.zeros((6, 15 + k))
    into[0, :, :8], into[0, :, 8:11], seen[0, :, 8:11] = (
        predictor.drive[0],
        predictor.K[0],
        np.eye(3),
    )
    into[5:9, :, 11] = predictor.trim[0].T
    into[11:15, :, 12] = predictor.drive[0][:, COMMANDS].T
    into[range(15, 15 + k), :, range(13, 13 + k)] = predictor.drive[0][:, record.large_into].T
    start[range(6), STATE_RUNS] = 1.0
    runs = innovations(predictor, known, into, seen, start)
    units = np.ascontiguousarray(runs[:, :, [*STATE_RUNS, *range(11, 15)]])
    moved = _moved(predictor, units, surface, first, added)
    columns = np.dstack([runs[:, :, 1:9], moved, runs[:, :, 15:]])
    for each in (runs, columns):
        each[record.unused] = 0.0
    e, columns = runs[:, :, 0].ravel(), columns.reshape(-1, 8 + count + k)
    power, slope = cross(columns, columns), cross(columns, e)
    power += np.diag(_RIDGE * np.diag(power) + np.finfo(float).tiny)
    noise = math.sqrt(float(np.mean((e - columns @ np.linalg.solve(power, slope)) ** 2)))
    known = np.eye(count, len(power), 8) * noise / record.jump_std_s
    e, columns = np.append(e, np.zeros(count)), np.vstack([columns, known])
    power += known.T @ known
    own = np.asarray(-np.linalg.solve(power, slope), np.float64)
    return Part(predictor, own, columns, power, e + columns @ own)


def _moved(of: Predictor, runs: Floats, surface: Ints, first: Ints, added: Floats) -> Floats:
    """Return what jumps that are later by 1 s add to the innovations (n, 3, j).

    ``runs`` (n, 3, 10) are those of each unit of state, and of mean and slope of each command while
    they fade; the others are as ``Record.later`` returns them. Each jump is run to where its
    command only fades, and from there on it is a sum of those.
    """
    n, head, count = len(runs), added.shape[2] - 1, len(first)
    found, x, jumps = np.zeros((n, 3, count)), np.zeros((count, 6)), np.arange(count)
    F, seen = (of.Phi - of.K @ of.C)[0].T, -(of.whiten @ of.C)[0].T
    drive = of.drive[0].T[[surface, surface + 4]]
    for k in range(head):
        found[first + k, :, jumps] = x @ seen
        x = x @ F + (added[:, :, k, None] * drive).sum(axis=0)
    by = np.hstack([x, np.zeros((count, 4))])
    by[jumps, 6 + surface], by[jumps, 8 + surface] = added[:, :, head]
    for row, at in enumerate(first + head):
        found[at:, :, row] = np.einsum("nca,a->nc", runs[: n - at], by[row])
    return found


def pair_of(theta: Floats) -> tuple[float, float]:
    """Return servo lag and delay in s of parameters (n,)."""
    return float(theta[AT["servo_lag"]]), float(theta[AT["delay"]])


def _slopes(record: Record, part: Part, theta: Floats) -> tuple[Floats, Floats]:
    """Return the slopes (3 n + j, v) of one manoeuvre's innovations to the parameters (v, ...).

    The information (v, v) of their sizes: with M the change of L over L, the innovations' squares
    have the sum of M_ij^2, and Fisher's is the sum of M_ij^2 + M_ij M_ji. M is triangular.
    """
    model = system(theta, record.motion.airspeed_m_s, record.pitch)
    predictor = Predictor.of(model, record.sample_time_s, part.predictor)
    trim = predictor.trim @ part.own[4:8, None]
    into = np.concatenate([predictor.drive, predictor.K, trim], axis=2)
    start, seen = np.append(part.own[:4], [0.0, 0.0])[:, None], np.eye(3, 12, 8)
    slopes = np.zeros((len(part.e), len(theta)))  # those of the times' distances stay 0
    runs = slopes[: record.y.size].reshape(*record.y.shape, -1)
    pairs = [pair_of(each) for each in theta]
    for pair in sorted(set(pairs), key=pairs.count, reverse=True):
        # The inputs that most variants have are given to all, so that few are run by themselves.
        which = [i for i, each in enumerate(pairs) if each == pair]
        run = slice(None) if len(which) > 1 else slice(which[0], which[0] + 1)
        inputs = record.inputs(*pair, part.own[8:])
        known = np.column_stack([inputs, record.y, np.ones(len(inputs))])
        states = start.repeat(len(into[run]), axis=1)
        runs[:, :, run] = innovations(predictor.some(run), known, into[run], seen, states)
    runs[record.unused] = 0.0
    runs -= part.e[: record.y.size].reshape(*record.y.shape, 1)
    slopes /= _DIFFERENCE
    slopes -= part.columns @ np.linalg.solve(part.power, cross(part.columns, slopes))
    its, here = (np.diagonal(of.whiten, axis1=1, axis2=2) for of in (predictor, part.predictor))
    sizes = np.log(its / here)
    return slopes, np.count_nonzero(~record.unused) * (sizes @ sizes.T) / _DIFFERENCE**2
