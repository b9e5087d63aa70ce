"""The same recursion on filterpy's KalmanFilter: an independent reference, and an engine to choose.

The state of the filter is theta, with F = I, H = psi', R = 1, alpha = lambda^-1/2 (filterpy's
fading memory). Scaling, window, held samples, schedule, floor and sums are written a second time
here, in plain NumPy. Only the limit of D is left out: a Kalman filter has no D.
"""

import copy
import math
from dataclasses import dataclass, fields
from typing import Literal

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
from yawid.estimation.polynomials import c_of, is_stable, lag_depth
from yawid.estimation.start_fit import fit_start
from yawid.estimation.whiteness import ljung_box


def make_estimator(
    config: EstimatorConfig, engine: Engine = "numba"
) -> "RecursiveArmax | ReferenceArmax":
    """Return the estimator of a configuration, on the given engine."""
    return RecursiveArmax(config) if engine == "numba" else ReferenceArmax(config)


class Sums:
    """Sums of squares and of products of residuals, with the forgetting of the recursion."""

    def __init__(self, lags: int) -> None:
        self.s1 = self.s2 = self.loss = self.e2 = self.eps2 = self.y2 = 0.0
        self.fast_e2 = self.fast_y2 = 0.0
        self.residuals = np.zeros(lags)
        self.products = np.zeros(lags + 1)

    def add(self, y: float, e: float, eps: float, lam: float, share: float) -> None:
        """Add one update; the loss counts e^2 times ``share``, which is lambda / alpha."""
        self.s1, self.s2 = lam * self.s1 + 1.0, lam * lam * self.s2 + 1.0
        self.loss = lam * self.loss + e * e * share
        self.e2, self.eps2 = lam * self.e2 + e * e, lam * self.eps2 + eps * eps
        self.y2 = lam * self.y2 + y * y
        self.fast_e2 = steps.FAST * self.fast_e2 + (1.0 - steps.FAST) * e * e
        self.fast_y2 = steps.FAST * self.fast_y2 + (1.0 - steps.FAST) * y * y
        lagged = np.array([eps, *self.residuals])
        self.products = lam * self.products + eps * lagged
        self.residuals = lagged[:-1]

    def noise_variance(self, n_theta: int) -> float:
        """Return the variance of the noise e; NaN before the first update."""
        if not self.s1:
            return math.nan
        return self.loss / max(self.s1 - n_theta * self.s2 / self.s1, 1.0)

    def root_mean(self, total: float) -> float:
        """Return the root mean square of a sum of squares; NaN before the first update."""
        return math.sqrt(total / self.s1) if self.s1 else math.nan


class FollowedCovariance:
    """The covariance of theta, which includes the autocorrelation of the innovations."""

    def __init__(self, covariance: Floats, lags: int) -> None:
        self.covariance = covariance
        self.echo = np.zeros(len(covariance))
        self.lags = lags

    def follow(self, psi: Floats, gain: Floats, e: float, s1: float) -> None:
        """Take one update: the equations of ``kernel.follow_covariance``, written as matrices."""
        memory = 1.0 - min(1.0, max(1.0 / max(self.lags, 1), steps.FEW / (s1 + 1.0)))
        F, drive = np.eye(len(psi)) - np.outer(gain, psi), gain * e
        cross = F @ np.outer(memory * self.echo, drive)
        self.covariance = F @ self.covariance @ F.T + np.outer(drive, drive) + cross + cross.T
        self.echo = memory * (F @ self.echo) + drive


@dataclass(frozen=True, slots=True)
class ReferenceEstimate:
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
    """:class:`RecursiveArmax` on filterpy: hundreds of times slower, and without saving."""

    def __init__(self, config: EstimatorConfig) -> None:
        self.config = config
        self.updates = self.held = self.halved = self.restarts = 0
        self.status = Status.WARMING_UP
        self._size = max(config.scale_window, config.start_buffer)
        self._window: list[Floats] | None = [] if self._size else None
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
        self._sums = Sums(config.residual_lags)
        self._spread = FollowedCovariance(np.eye(n) * config.P0, config.residual_lags)
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
        self._sums.residuals[:] = 0.0
        self._spread.echo[:] = 0.0
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
        u, y = checked_samples(u, y, self.config.orders.n_inputs)
        if np.isinf(u).any() or np.isinf(y).any():
            raise ConfigError("u and y must not be infinite; a NaN marks a sample to be held")
        made = []
        for row, value in zip(u, y, strict=True):
            self._sample(row, float(value))
            if keep == "all":
                made.append(self.estimate())
        made = made if keep == "all" else [self.estimate()]
        n = self.config.n_theta
        names = [field.name for field in fields(ReferenceEstimate)]
        theta, std, P, *rest = (np.array([getattr(e, name) for e in made]) for name in names)
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
        """Put the sample into the window; once it is full and its signals move, release it."""
        window.append(row)
        if len(window) > self._size:
            del window[0]
            self.held += 1
        self._broken = False
        self._last, self.status = (math.nan, math.nan, math.nan), Status.WARMING_UP
        rows = np.array(window)
        used = np.array([True, *(nb > 0 for nb in self.config.orders.nb)])
        spread = rows[:, 1:].std(axis=0)
        if len(window) < self._size or not np.all(spread[used] >= self.config.scale_minimum):
            return
        if self.config.scale_window:
            moving = spread > 0.0
            self._factors[moving] = 2.0 ** -np.floor(np.log2(spread[moving]) + 0.5)
            self._units = self._units_of(self._factors)
        self._release(rows)
        self._last = (math.nan, math.nan, self._last[2])

    def _units_of(self, factors: Floats) -> Floats:
        """Return the factors (n,) that convert theta to the user's units."""
        orders, scale = self.config.orders, 1.0 / factors[0]
        units = [np.ones(orders.na)]
        units += [np.full(nb, f * scale) for nb, f in zip(orders.nb, factors[1:], strict=True)]
        return np.concatenate([*units, np.ones(orders.nc), np.full(int(self.config.bias), scale)])

    def _release(self, rows: Floats) -> None:
        """Take the samples of the window, after a start fit if there is one."""
        self._window, start = None, None
        if self.config.start_buffer:
            start = fit_start(self.config, rows * [1.0, *self._factors])
        if start is not None:
            self._filter.x = start.theta.reshape(-1, 1)
            self._filter.P, self._spread.covariance = start.P.copy(), start.covariance.copy()
        for broken, y, *u in rows:
            self._broken = self._broken or broken > 0.0
            self._take(np.array(u), float(y), frozen=start is not None)
        if start is not None:
            self.forgetting_factor = self.config.forgetting_factor

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

    def _take(self, u: Floats, y: float, frozen: bool = False) -> None:
        """Take one sample through the recursion; ``frozen`` leaves theta and P as they are."""
        self._shift(u)
        y, y_hat, depth = y * self._factors[0], math.nan, lag_depth(self.config.orders)
        if self._fill > depth:
            y_hat = float(self._regressor(self._raw) @ self._filter.x[:, 0])
        e = y - y_hat
        eps = e if frozen or self._since else 0.0
        learning = self._fill > depth + self.config.orders.nc
        if learning and frozen:
            self._account(y, e, e, self.config.forgetting_factor, 1.0)
        elif learning:
            with np.errstate(all="ignore"):
                eps, learning = self._learn(y, e)
        self.held += not learning
        self._fresh[0], self._fresh[-2] = -y, eps if self._fill > depth else 0.0
        scale = 1.0 / self._factors[0]
        self._last = (y_hat * scale, e * scale, eps * scale)
        warm = WARM_UPDATES_PER_PARAMETER * self.config.n_theta
        if self._diverged:
            self.status = Status.DIVERGED
        elif self._since < warm:
            self.status = Status.WARMING_UP
        else:
            self.status = Status.TRACKING if learning else Status.HELD

    def _learn(self, y: float, e: float) -> tuple[float, bool]:
        """Update theta and P; return the residual, and False after a restart."""
        kalman, lam, phi = self._filter, self.forgetting_factor, self._regressor(self._raw)
        filters = METHODS[self.config.method].filters
        psi = self._regressor(self._filtered) if filters and self._since >= steps.PSI_FROM else phi
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
            self._diverged = True
            self._broken = True
            return math.nan, False
        self._spread.follow(psi, kalman.K[:, 0], e, self._sums.s1)
        self._keep_information()
        rate = self.config.forgetting_rate
        self.forgetting_factor = rate * lam + (1.0 - rate) * self.config.forgetting_factor
        self._account(y, e, eps, lam, lam / alpha)
        return eps, True

    def _stable_step(self, theta: Floats, step: Floats) -> Floats:
        """Return the step, halved until C(q) is stable after it (RML)."""
        if not (METHODS[self.config.method].filters and self.config.orders.nc):
            return step
        whole = step
        for _ in range(steps.HALVINGS):
            if is_stable(c_of(theta + step, self.config.orders)):
                break
            step = 0.5 * step
        else:
            step = 0.0 * step
        self.halved += step is not whole
        return step

    def _keep_information(self) -> None:
        """Apply the information floor to one parameter, as ``recursion._keep_information``."""
        config, kalman, k = self.config, self._filter, self._next
        if not config.information_floor:
            return
        n, p = config.n_theta, float(kalman.P[k, k])
        self._next = (k + 1) % n
        if p >= self._least[k]:
            rise = 1.0 + steps.SLOW_RISE * n * (1.0 - config.forgetting_factor)
            self._least[k] = min(self._least[k] * rise, steps.MOST_RISE * self._best[k])
        elif self._since < steps.SETTLING:
            self._least[k] = p
        else:
            self._least[k] = max(p, steps.FAST_FALL * self._least[k])
        self._best[k] = min(self._best[k], self._least[k])
        limit = self._least[k] * (1.0 + steps.SLACK / config.information_floor)
        if p > limit:
            here = np.eye(n)[[k]]
            kalman.update(here @ kalman.x[:, 0], R=1.0 / (1.0 / limit - 1.0 / p), H=here)

    def _account(self, y: float, e: float, eps: float, lam: float, share: float) -> None:
        """Update the sums, and test for divergence."""
        sums = self._sums
        sums.add(y, e, eps, lam, share)
        self.updates += 1
        self._since += 1
        warm = WARM_UPDATES_PER_PARAMETER * self.config.n_theta
        usual = max(sums.fast_y2, sums.y2 / sums.s1) + 1e-4
        if not self._diverged:
            self._diverged = self._since > warm and sums.fast_e2 > 4.0 * usual
        elif self._since > 2 * warm and sums.fast_e2 < 2.0 * usual:
            self._diverged = False

    def predict(self, u: ArrayLike = math.nan) -> float:
        """Return y_hat(k), as :meth:`RecursiveArmax.predict`."""
        if self._window is not None:
            return math.nan
        scratch = copy.deepcopy(self)
        row = np.zeros(self.config.orders.n_inputs)
        if not all(self.config.orders.nk):
            row = checked_u(u, 0.0, self.config.orders.n_inputs)
        scratch._shift(row)
        if scratch._fill <= lag_depth(self.config.orders):
            return math.nan
        y_hat = scratch._regressor(scratch._raw) @ self._filter.x[:, 0]
        return float(y_hat / self._factors[0])

    def estimate(self) -> ReferenceEstimate:
        """Return the estimate after the last sample."""
        status, covariance = self.status, self.covariance
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        std[np.isnan(np.diag(covariance))] = math.nan
        return ReferenceEstimate(self.theta, std, covariance, *self._last, self.noise_std, status)

    @property
    def theta(self) -> Floats:
        """Parameters (n,) in the user's units."""
        return np.asarray(self._filter.x[:, 0] * self._units, dtype=np.float64)

    @property
    def theta_std(self) -> Floats:
        """Standard deviation (n,) of theta."""
        return self.estimate().theta_std

    @property
    def P(self) -> Floats:
        """P (n, n): the covariance of theta over the noise variance, in the user's units."""
        units = self._units * self._factors[0]
        return np.asarray(self._filter.P * np.outer(units, units), dtype=np.float64)

    @property
    def covariance(self) -> Floats:
        """Covariance (n, n) of theta in the user's units; NaN before the first update."""
        sums = self._sums
        if not sums.s1:
            return np.full((self.config.n_theta,) * 2, math.nan)
        covariance = self._spread.covariance
        if not self.config.residual_lags:
            noise = sums.noise_variance(self.config.n_theta)
            covariance = noise * self._filter.P * sums.s2 / sums.s1
        return np.asarray(covariance * np.outer(self._units, self._units), np.float64)

    @property
    def noise_std(self) -> float:
        """Standard deviation of the noise e, in y's unit; NaN where its variance is below 0."""
        variance = self._sums.noise_variance(self.config.n_theta)
        return math.sqrt(variance) / float(self._factors[0]) if variance >= 0.0 else math.nan

    @property
    def innovation_std(self) -> float:
        """Root mean square of the innovation, in y's unit."""
        return self._sums.root_mean(self._sums.e2) / float(self._factors[0])

    @property
    def residual_std(self) -> float:
        """Root mean square of the residual, in y's unit."""
        return self._sums.root_mean(self._sums.eps2) / float(self._factors[0])

    @property
    def whiteness_p(self) -> float:
        """p-value of the Ljung-Box test that the residuals are white; NaN while unknown."""
        return ljung_box(self._sums.products, self._sums.s1, self._sums.s2)
