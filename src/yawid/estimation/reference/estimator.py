"""The same recursion on filterpy's KalmanFilter: an independent reference, and an engine to choose.

The state of the filter is theta, with F = I, H = psi', R = 1, alpha = lambda^-1/2 (filterpy's
fading memory). Scaling, window, held samples, schedule, floor and sums are written a second time
here, in plain NumPy. Left out are the limit of D (a Kalman filter has no D), the start fit, saving
and :meth:`RecursiveArmax.predict`.
"""

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import EstimateBlock, Floats, Status
from yawid.config.estimator import Engine, EstimatorConfig
from yawid.errors import ConfigError
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.checks import checked_samples, checked_u
from yawid.estimation.kernel import recursion as steps
from yawid.estimation.kernel.new_state import WARM_UPDATES_PER_PARAMETER
from yawid.estimation.methods import METHODS
from yawid.estimation.polynomials import c_of, lag_depth
from yawid.estimation.whiteness import ljung_box


def make_estimator(
    config: EstimatorConfig, engine: Engine = "numba"
) -> "RecursiveArmax | ReferenceArmax":
    """Return the estimator of a configuration, on the given engine."""
    return RecursiveArmax(config) if engine == "numba" else ReferenceArmax(config)


class ReferenceEstimate(NamedTuple):
    """The estimate after one sample, with the fields of :class:`yawid.Estimate`."""

    theta: Floats
    theta_std: Floats
    covariance: Floats
    y_hat: float
    innovation: float
    residual: float
    noise_std: float
    status: Status


class ReferenceArmax:
    """:class:`RecursiveArmax` on filterpy: hundreds of times slower, and without saving.

    Raises:
        ConfigError: the configuration has a ``start_buffer``, which this engine does not have.
    """

    def __init__(self, config: EstimatorConfig) -> None:
        if config.start_buffer:
            raise ConfigError("filterpy has no start fit: start_buffer must be 0 with this engine")
        self.config, self._depth = config, lag_depth(config.orders)
        self._filters = METHODS[config.method].filters
        self.updates = self.held = self.halved = self.restarts = 0
        self.status = Status.WARMING_UP
        self._window: list[Floats] | None = [] if config.scale_window else None
        self._factors = np.ones(1 + config.orders.n_inputs)
        self._units = np.ones(config.n_theta)
        self._diverged, self._last = False, (math.nan, math.nan, math.nan)
        self._begin()

    def _begin(self) -> None:
        """Set theta, P and the statistics to their start values."""
        from filterpy.kalman import KalmanFilter  # takes most of a second, for this engine only

        config, n = self.config, self.config.n_theta
        self._filter = KalmanFilter(dim_x=n, dim_z=1)
        self._filter.P *= config.P0
        self._filter.Q = np.zeros((n, n))
        self._least, self._best = np.full(n, config.P0), np.full(n, config.P0)
        # Sums of the weights, of e^2 lambda / alpha, of e^2, eps^2 and y^2; of the weights squared.
        self._sums, self._s2, self._fast = np.zeros(5), 0.0, np.zeros(2)
        self._products = np.zeros(config.residual_lags + 1)
        self._covariance = np.eye(n) * config.P0
        self.forgetting_factor = config.forgetting_start
        self._since, self._next = 0, 0
        self._open()

    def _open(self) -> None:
        """Empty the registers, as the first sample after a break does."""
        orders = self.config.orders
        reach = [nb + nk for nb, nk in zip(orders.nb, orders.nk, strict=True)]
        self._raw = np.zeros((orders.n_inputs + 3, max([1, orders.na, orders.nc, *reach])))
        self._filtered = np.zeros_like(self._raw)  # rows -y, u.., residual, 1; the newest first
        self._fresh = np.zeros(len(self._raw))
        self._residuals = np.zeros(self.config.residual_lags)
        self._echo = np.zeros(self.config.n_theta)
        self._fill, self._broken = 0, False

    def update(self, u: ArrayLike, y: float) -> ReferenceEstimate:
        """Take one sample and return the estimate, as :meth:`RecursiveArmax.update`."""
        self._sample(checked_u(u, y, self.config.orders.n_inputs), float(y))
        return self.estimate()

    def run(
        self,
        u: ArrayLike,
        y: ArrayLike,
        keep: Literal["all", "last"] = "all",
        covariance: bool = False,
    ) -> EstimateBlock:
        """Take a block of samples, as :meth:`RecursiveArmax.run`."""
        if keep not in ("all", "last"):
            raise ConfigError(f'keep must be "all" or "last", got {keep!r}')
        u, y = checked_samples(u, y, self.config.orders.n_inputs, finite_or_nan=True)
        made = []
        for row, value in zip(u, y, strict=True):
            self._sample(row, float(value))
            if keep == "all":
                made.append(self.estimate())
        made = made if keep == "all" else [self.estimate()]
        n, places = self.config.n_theta, range(len(ReferenceEstimate._fields))
        theta, std, P, *rest = (np.array([each[place] for each in made]) for place in places)
        spread = P.reshape(-1, n, n) if covariance else None
        return EstimateBlock.of(theta.reshape(-1, n), std.reshape(-1, n), spread, *rest)

    def _sample(self, u: Floats, y: float) -> None:
        if not (np.isfinite(y) and np.isfinite(u).all()):
            self.held += 1
            self._broken = True
            self._last, self.status = (math.nan, math.nan, math.nan), Status.HELD
        elif self._window is None:
            self._take(u, y)
        else:
            self._collect(self._window, np.array([float(self._broken or not self._window), y, *u]))

    def _collect(self, window: list[Floats], row: Floats) -> None:
        """Put the sample into the window; once it is full and its signals move, scale and take."""
        window.append(row)
        if len(window) > self.config.scale_window:
            del window[0]
            self.held += 1
        self._broken = False
        self._last, self.status = (math.nan, math.nan, math.nan), Status.WARMING_UP
        orders, bias, spread = self.config.orders, int(self.config.bias), np.std(window, axis=0)[1:]
        used = np.array([True, *(nb > 0 for nb in orders.nb)])
        is_full = len(window) == self.config.scale_window
        if not is_full or not np.all(spread[used] >= self.config.scale_minimum):
            return
        moving = spread > 0.0
        self._factors[moving] = 2.0 ** -np.floor(np.log2(spread[moving]) + 0.5)
        each = np.array([1.0, *self._factors[1:], 1.0, 1.0]) / self._factors[0]
        each[[0, -2]] = 1.0
        self._units = np.repeat(each, [orders.na, *orders.nb, orders.nc, bias])
        self._window = None
        for broken, value, *inputs in window:
            self._broken = self._broken or broken > 0.0
            self._take(np.array(inputs), float(value))
        self._last = (math.nan, math.nan, self._last[2])

    def _shift(self, u: Floats) -> None:
        """Enter the fresh values into the registers, and filtered by 1/C(q) into the others."""
        if self._broken:
            self._open()
        self._fresh[1:-2], self._fresh[-1] = u * self._factors[1:], 1.0
        contraction = 1.0 - (self.config.forgetting_factor - self.forgetting_factor)
        c = c_of(self._filter.x[:, 0], self.config.orders)
        c = c * contraction ** np.arange(1, len(c) + 1)
        filtered = self._fresh - self._filtered[:, : len(c)] @ c
        self._raw = np.column_stack([self._fresh, self._raw[:, :-1]])
        self._filtered = np.column_stack([filtered, self._filtered[:, :-1]])
        self._fill += 1

    def _regressor(self, registers: Floats) -> Floats:
        """Return phi, or psi from the filtered registers, (n,) (eq. 32)."""
        orders = self.config.orders
        parts = [registers[0, : orders.na]]
        for row, nb, nk in zip(registers[1:], orders.nb, orders.nk, strict=False):
            parts.append(row[nk : nk + nb])
        return np.concatenate(
            [*parts, registers[-2, : orders.nc], registers[-1, : int(self.config.bias)]]
        )

    def _take(self, u: Floats, y: float) -> None:
        """Take one sample through the recursion."""
        self._shift(u)
        y, y_hat = y * self._factors[0], math.nan
        if self._fill > self._depth:
            y_hat = float(self._regressor(self._raw) @ self._filter.x[:, 0])
        e = y - y_hat
        eps = e if self._since else 0.0
        learning = self._fill > self._depth + self.config.orders.nc
        if learning:
            with np.errstate(all="ignore"):
                eps, learning = self._learn(y, e)
        self.held += not learning
        self._fresh[0], self._fresh[-2] = -y, eps if self._fill > self._depth else 0.0
        scale = 1.0 / self._factors[0]
        self._last = (y_hat * scale, e * scale, eps * scale)
        if self._diverged:
            self.status = Status.DIVERGED
        elif self._since < WARM_UPDATES_PER_PARAMETER * self.config.n_theta:
            self.status = Status.WARMING_UP
        else:
            self.status = Status.TRACKING if learning else Status.HELD

    def _learn(self, y: float, e: float) -> tuple[float, bool]:
        """Update theta and P; return the residual, and False after a restart."""
        kalman, lam, phi = self._filter, self.forgetting_factor, self._regressor(self._raw)
        late = self._filters and self._since >= steps.PSI_FROM
        psi = self._regressor(self._filtered) if late else phi
        before = kalman.x[:, 0].copy()
        alpha = float(lam + psi @ kalman.P @ psi)
        kalman.alpha = lam**-0.5
        kalman.predict()
        kalman.update(e + psi @ before, R=1.0, H=psi.reshape(1, -1))
        kalman.x = (before + self._stable_step(before, kalman.x[:, 0] - before)).reshape(-1, 1)
        eps = e - float(phi @ (kalman.x[:, 0] - before))
        if not (alpha < math.inf and e * e + eps * eps < math.inf):
            self.restarts += 1
            self._begin()
            self._diverged, self._broken = True, True
            return math.nan, False
        self._follow(psi, kalman.K[:, 0], e)
        if self.config.information_floor:
            self._keep_information(self.config.information_floor)
        rate = self.config.forgetting_rate
        self.forgetting_factor = rate * lam + (1.0 - rate) * self.config.forgetting_factor
        self._account(y, e, eps, lam, lam / alpha)
        return eps, True

    def _stable_step(self, theta: Floats, step: Floats) -> Floats:
        """Return the step, halved until C(q) is stable after it (RML)."""
        if not self._filters:
            return step
        for halvings in range(steps.HALVINGS):
            c = c_of(theta + step, self.config.orders)
            if np.isfinite(c).all() and np.all(np.abs(np.roots([1.0, *c])) < 1.0):
                self.halved += halvings > 0
                return step
            step = 0.5 * step
        self.halved += 1
        return 0.0 * step

    def _follow(self, psi: Floats, gain: Floats, e: float) -> None:
        """Update the covariance: the equations of ``kernel.follow_covariance``, as matrices."""
        few = steps.FEW / (self._sums[0] + 1.0)
        memory = 1.0 - min(1.0, max(1.0 / max(self.config.residual_lags, 1), few))
        F, drive = np.eye(len(psi)) - np.outer(gain, psi), gain * e
        cross = F @ np.outer(memory * self._echo, drive)
        self._covariance = F @ self._covariance @ F.T + np.outer(drive, drive) + cross + cross.T
        self._echo = memory * (F @ self._echo) + drive

    def _keep_information(self, floor: float) -> None:
        """Apply the information floor to one parameter, as ``recursion._keep_information``."""
        kalman, k, n = self._filter, self._next, self.config.n_theta
        p = float(kalman.P[k, k])
        self._next = (k + 1) % n
        if p >= self._least[k]:
            rise = 1.0 + steps.SLOW_RISE * n * (1.0 - self.config.forgetting_factor)
            self._least[k] = min(self._least[k] * rise, steps.MOST_RISE * self._best[k])
        else:
            fall = 0.0 if self._since < steps.SETTLING else steps.FAST_FALL
            self._least[k] = max(p, fall * self._least[k])
        self._best[k] = min(self._best[k], self._least[k])
        limit = self._least[k] * (1.0 + steps.SLACK / floor)
        if p > limit:
            here = np.eye(n)[[k]]
            kalman.update(here @ kalman.x[:, 0], R=1.0 / (1.0 / limit - 1.0 / p), H=here)

    def _account(self, y: float, e: float, eps: float, lam: float, share: float) -> None:
        """Update the sums, and test for divergence."""
        self._sums = lam * self._sums + [1.0, e * e * share, e * e, eps * eps, y * y]
        self._s2 = lam * lam * self._s2 + 1.0
        self._fast = steps.FAST * self._fast + (1.0 - steps.FAST) * np.array([e * e, y * y])
        lagged = np.array([eps, *self._residuals])
        self._products, self._residuals = lam * self._products + eps * lagged, lagged[:-1]
        self.updates += 1
        self._since += 1
        warm = WARM_UPDATES_PER_PARAMETER * self.config.n_theta
        usual = max(self._fast[1], self._sums[4] / self._sums[0]) + 1e-4
        if not self._diverged:
            self._diverged = self._since > warm and self._fast[0] > 4.0 * usual
        elif self._since > 2 * warm and self._fast[0] < 2.0 * usual:
            self._diverged = False

    def estimate(self) -> ReferenceEstimate:
        """Return the estimate after the last sample."""
        covariance, variance = self.covariance, np.diag(self.covariance)
        std = np.sqrt(np.where(variance < 0.0, 0.0, variance))
        return ReferenceEstimate(
            self.theta, std, covariance, *self._last, self.noise_std, self.status
        )

    @property
    def theta(self) -> Floats:
        """Parameters (n,) in the user's units."""
        return np.asarray(self._filter.x[:, 0] * self._units, dtype=np.float64)

    @property
    def P(self) -> Floats:
        """P (n, n): the covariance of theta over the noise variance, in the user's units."""
        units = self._units * self._factors[0]
        return np.asarray(self._filter.P * np.outer(units, units), dtype=np.float64)

    @property
    def covariance(self) -> Floats:
        """Covariance (n, n) of theta in the user's units; NaN before the first update."""
        covariance = self._covariance if self._sums[0] else math.nan * self._covariance
        if self._sums[0] and not self.config.residual_lags:
            covariance = self._noise_variance() * self._filter.P * self._s2 / self._sums[0]
        return np.asarray(covariance * np.outer(self._units, self._units), np.float64)

    def _noise_variance(self) -> float:
        s1, loss, *_ = self._sums
        return float(loss / max(s1 - self.config.n_theta * self._s2 / s1, 1.0)) if s1 else math.nan

    @property
    def noise_std(self) -> float:
        """Standard deviation of the noise e, in y's unit; NaN where its variance is below 0."""
        variance = self._noise_variance()
        return math.sqrt(variance) / float(self._factors[0]) if variance >= 0.0 else math.nan

    @property
    def innovation_std(self) -> float:
        """Root mean square of the innovation, in y's unit."""
        return self._root_mean(self._sums[2])

    @property
    def residual_std(self) -> float:
        """Root mean square of the residual, in y's unit."""
        return self._root_mean(self._sums[3])

    def _root_mean(self, total: float) -> float:
        s1 = self._sums[0]
        return math.sqrt(total / s1) / float(self._factors[0]) if s1 else math.nan

    @property
    def whiteness_p(self) -> float:
        """p-value of the Ljung-Box test that the residuals are white; NaN while unknown."""
        return ljung_box(self._products, self._sums[0], self._s2)
