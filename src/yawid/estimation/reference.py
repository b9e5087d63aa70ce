"""The same recursion on filterpy's KalmanFilter: an independent reference, and an engine to choose.

Scaling, registers, floor and sums are the kernel's own, in plain Python; what theta, P and the
covariance become is filterpy's and NumPy's. The state of the filter is theta, with F = I, H = psi',
R = 1 and alpha = lambda^-1/2 (filterpy's fading memory)::

    theta, P  by ``predict`` and ``update`` with z = e + psi' theta; then P = U D U' by Cholesky
    cov       = F cov F' + K e e K' + F h e K' + K e h' F',   F = I - K psi',  h = m echo
    echo      = F h + K e
"""

import math
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats
from yawid.config.estimator import Engine, EstimatorConfig
from yawid.errors import ConfigError
from yawid.estimation.armax import Estimate, RecursiveArmax
from yawid.estimation.kernel import entry_points
from yawid.estimation.kernel import recursion as steps
from yawid.estimation.kernel.state import Unpacked
from yawid.estimation.start_fit import factorise

_NOTHING = math.nan, 1.0
"""Residual and share of the loss where a result is not finite: theta and P start again."""


class ReferenceArmax(RecursiveArmax):
    """:class:`RecursiveArmax` on filterpy: hundreds of times slower.

    Raises:
        ConfigError: the configuration has a ``start_buffer``, which this engine does not have.
    """

    def __init__(self, config: EstimatorConfig) -> None:
        if config.start_buffer:
            raise ConfigError("filterpy has no start fit: start_buffer must be 0 with this engine")
        super().__init__(config)

    def update(self, u: ArrayLike, y: float) -> Estimate:
        """Take one sample and return the estimate, as :meth:`RecursiveArmax.update`."""
        self.run(u, [y], keep="last")
        return Estimate(self._moving.tobytes())

    def _run(self, u: Floats, y: Floats, rows: Floats, first: int) -> int:
        state = _State(self._state)
        with np.errstate(all="ignore"):
            done = int(_RUN(state, u, y, rows, first))
        state.pack()
        return done


class _State(Unpacked):
    """The numbers of a state as Python floats, its parts as arrays in their place."""

    def __init__(self, packed: Floats) -> None:
        super().__init__(packed)
        self.parts = self._at._replace(packed=self)  # type: ignore[arg-type] # it stands for it


def make_estimator(config: EstimatorConfig, engine: Engine = "numba") -> RecursiveArmax:
    """Return the estimator of a configuration, on the given engine."""
    return RecursiveArmax(config) if engine == "numba" else ReferenceArmax(config)


def _learn(s: Any, at: Any, e: float) -> tuple[float, float]:
    """Take the place of ``recursion._learn``: return the residual and the loss's share of e^2."""
    from filterpy.kalman import KalmanFilter  # takes most of a second, for this engine only

    n, lam, theta = len(at.theta), float(s.lam), at.theta.copy()
    late = s.filters > 0.0 and s.since >= steps.PSI_FROM
    psi = at.filtered[at.taps] if late else at.phi
    U = np.eye(n)
    U.T[np.tril_indices(n, -1)] = at.upper
    kalman = KalmanFilter(dim_x=n, dim_z=1)
    kalman.x, kalman.P, kalman.Q = theta[:, None], U * at.d @ U.T, np.zeros((n, n))
    kalman.alpha = lam**-0.5
    share = lam / float(lam + psi @ kalman.P @ psi)
    kalman.predict()
    kalman.update(e + psi @ theta, R=1.0, H=psi[None])
    step, gain = _stable_step(s, theta, kalman.x[:, 0] - theta), kalman.K[:, 0]
    at.theta[:] += step
    eps = e - float(at.phi @ step)
    if not (share > 0.0 and e * e + eps * eps < math.inf):
        return _NOTHING
    if s.lags > 0.0:
        _follow_covariance(s, at, psi, gain, gain * e)
    try:
        factorise(kalman.P, at.d, at.upper)
    except np.linalg.LinAlgError:  # rounding has left P with a variance below 0
        return _NOTHING
    at.d[:] = np.minimum(at.d, s.d_max)
    steps._adapt(s, at, lam)
    return eps, share


def _stable_step(s: Any, theta: Floats, step: Floats) -> Floats:
    """Return the step, halved until C(q) is stable after it (RML)."""
    whole, nc, bias = step, int(s.nc), int(s.bias)
    if not (s.filters and nc):
        return step
    for _ in range(steps.HALVINGS):
        c = (theta + step)[len(theta) - nc - bias : len(theta) - bias]
        if np.isfinite(c).all() and np.all(np.abs(np.roots([1.0, *c])) < 1.0):
            break
        step = 0.5 * step
    else:
        step = 0.0 * step
    s.halved += float(step is not whole)
    return step


def _follow_covariance(s: Any, at: Any, psi: Floats, gain: Floats, drive: Floats) -> None:
    memory = 1.0 - min(1.0, max(1.0 / s.lags, steps.FEW / (s.s1 + 1.0)))
    F, covariance = np.eye(len(psi)) - np.outer(gain, psi), at.covariance.reshape(len(psi), -1)
    cross = F @ np.outer(memory * at.echo, drive)
    covariance[:] = F @ covariance @ F.T + np.outer(drive, drive) + cross + cross.T
    at.echo[:] = memory * (F @ at.echo) + drive


def _with(function: Any, **replaced: Any) -> Any:
    """Return a copy of a kernel's function that calls others instead of those it names."""
    scope = function.__globals__ | replaced
    return FunctionType(function.__code__, scope, function.__name__)


_RUN = _with(
    entry_points.run,
    _sample=_with(entry_points._sample, take=_with(steps.take, _learn=_learn)),
)
"""The kernel's ``run`` with this ``_learn``."""
