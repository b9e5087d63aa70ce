"""The criterion: minus the logarithm of the likelihood, as a sum of squares.

The whitened innovations of all manoeuvres, less what each one's own start and trims explain of them
(variable projection, Golub and Pereyra 1973), and the distance of the parameters from what is known
beforehand. One scale of all noise is eliminated.
"""

import math
from collections.abc import Sequence

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import AT, PARAMETERS, SIZES, Guess, system
from yawid.lateral.predictor import Predictor, whitened
from yawid.lateral.record import Record

_RIDGE = 1e-13
"""Of the start and the trims, as a share of their power: it holds what the record does not show."""


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
        self.is_size = np.array([each.name in SIZES for each in rows])
        known = [
            priors.get(each.name) or (each.prior(guess) if each.prior else (0.0, math.inf))
            for each in rows
        ]
        self.mean, self.spread = np.array(known).T
        self.count = 3 * sum(int(np.count_nonzero(~each.missing)) for each in records)
        """Measurements."""

    def start(self) -> Floats:
        """Return the point (n,) at which the fit begins."""
        return np.asarray(np.maximum(self.fixed[self.free] / self.scale, self.least), np.float64)

    def theta(self, x: Floats) -> Floats:
        """Return all parameters (v, len(PARAMETERS)) at the points ``x`` (v, n)."""
        theta = np.repeat(self.fixed[None], len(x), axis=0)
        theta[:, self.free] = x * self.scale
        return theta

    def errors(self, x: Floats) -> Floats:
        """Return the whitened innovations (v, l) at the points ``x`` (v, n), 0 where missing.

        Raises:
            numpy.linalg.LinAlgError: at one of the points the predictor does not exist.
        """
        theta = self.theta(x)
        return np.concatenate([_errors(each, theta) for each in self.records], axis=1)

    def surprise(self, x: Floats) -> Floats:
        """Return the distances (v, n) of the points from what is known beforehand, in sigma."""
        return np.asarray((x * self.scale - self.mean) / self.spread, np.float64)


def _errors(record: Record, theta: Floats) -> Floats:
    """Return the innovations (v, 3 n) of one manoeuvre, less those of its start and trims."""
    lags, delays = (theta[:, AT[name]].tolist() for name in ("servo_lag", "delay"))
    pairs = list(zip(lags, delays, strict=True))
    made = {pair: record.inputs(*pair) for pair in set(pairs)}
    u = np.stack([made[pair] for pair in pairs])
    model = system(theta, record.airspeed_m_s, record.law)
    predictor = Predictor.of(model, record.sample_time_s)
    columns = whitened(predictor, record.y, u, record.missing).reshape(len(theta), -1, 9)
    power = columns.swapaxes(1, 2) @ columns
    size = np.sqrt(np.diagonal(power, axis1=1, axis2=2)[:, 1:]) + np.finfo(float).tiny
    own = power[:, 1:, 1:] / (size[:, :, None] * size[:, None]) + _RIDGE * np.eye(8)
    part = np.linalg.solve(own, power[:, 1:, :1] / size[:, :, None])[:, :, 0] / size
    left = columns[:, :, 0] - (columns[:, :, 1:] @ part[:, :, None])[:, :, 0]
    if not np.isfinite(left).all():
        raise np.linalg.LinAlgError("the innovations are not finite")
    return left
