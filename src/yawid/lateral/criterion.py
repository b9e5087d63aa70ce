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

from yawid.blocks import Floats
from yawid.estimation.machine.products import cross
from yawid.lateral.model import AT, PARAMETERS, Guess, system
from yawid.lateral.predictor import Predictor, whitened
from yawid.lateral.record import Record

_RIDGE = 1e-13
"""Of start and trims, as a share of their power: it holds what the record does not show."""
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

    def slopes(self, point: "Point") -> Floats:
        """Return the slopes (l, n) of the innovations at a point, with its own start and the rest.

        What they would change in start, trims and times is left out, which changes neither the
        slope of the criterion nor the information (Kaufman 1975).
        """
        theta = self.theta(point.x + _DIFFERENCE * np.eye(len(point.x)))
        pairs = zip(self.records, point.parts, strict=True)
        return np.vstack([_slopes(record, theta, part) for record, part in pairs])


@dataclass(frozen=True, slots=True)
class Part:
    """One manoeuvre at a point: its predictor, its start, trims and times ``own`` (8 + j,).

    ``e`` (3 n + j,) are the innovations and those times over their sigma, ``columns``
    (3 n + j, 8 + j) what a unit of ``own`` adds to them, and ``power`` their products.
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

    def loss(self, variance: float) -> float:
        """Return the criterion for a given scale of the noise."""
        return float(self.e @ self.e) / variance + float(self.surprise @ self.surprise)


def _part(record: Record, theta: Floats) -> Part:
    """Return one manoeuvre at the parameters ``theta`` (1, len(PARAMETERS))."""
    pair = _pair(theta[0])
    inputs, later = record.inputs(*pair), record.later(*pair)
    model = system(theta, record.motion.airspeed_m_s, record.pitch)
    predictor = Predictor.of(model, record.sample_time_s)
    y, u = (np.zeros((9 + len(later), *x.shape)) for x in (record.y, inputs))
    y[0], u[0], u[9:] = record.y, inputs, later
    units = np.eye(9 + len(later), 8, -1)  # one run with the record, one of each unit
    runs = whitened(predictor, y, u, record.unused, units[:, :4], units[:, 4:]).reshape(len(u), -1)
    e, columns = runs[0], np.ascontiguousarray(runs[1:].T)
    power, slope = cross(columns, columns), cross(columns, e)
    power += np.diag(_RIDGE * np.diag(power) + np.finfo(float).tiny)
    noise = math.sqrt(float(np.mean((e - columns @ np.linalg.solve(power, slope)) ** 2)))
    known = np.eye(len(later), len(power), 8) * noise / record.jump_std_s
    e, columns = np.append(e, np.zeros(len(later))), np.vstack([columns, known])
    power += known.T @ known
    own = np.asarray(-np.linalg.solve(power, slope), np.float64)
    return Part(predictor, own, columns, power, e + columns @ own)


def _pair(theta: Floats) -> tuple[float, float]:
    return float(theta[AT["servo_lag"]]), float(theta[AT["delay"]])


def _slopes(record: Record, theta: Floats, part: Part) -> Floats:
    """Return the slopes (3 n + j, v) of one manoeuvre's innovations to the parameters (v, ...)."""
    pairs = [_pair(each) for each in theta]
    inputs = {pair: record.inputs(*pair, part.own[8:].tolist()) for pair in set(pairs)}
    u, own = np.stack([inputs[pair] for pair in pairs]), np.tile(part.own[:8], (len(theta), 1))
    model = system(theta, record.motion.airspeed_m_s, record.pitch)
    predictor = Predictor.of(model, record.sample_time_s, part.predictor)
    runs = whitened(predictor, record.y[None], u, record.unused, own[:, :4], own[:, 4:])
    found = (runs.reshape(len(theta), -1) - part.e[: record.y.size]).T / _DIFFERENCE
    slopes = np.pad(
        found, ((0, len(record.jumps)), (0, 0))
    )  # times stay: their distances have none
    return slopes - part.columns @ np.linalg.solve(part.power, part.columns.T @ slopes)
