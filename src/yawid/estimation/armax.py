"""The recursive ARMAX estimator: extended least squares and recursive maximum likelihood."""

import json
import math
from dataclasses import asdict
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import EstimateBlock, Floats, Status, estimate_width
from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.errors import ConfigError
from yawid.estimation.checks import checked_samples, checked_u
from yawid.estimation.kernel import state as slots
from yawid.estimation.kernel.entry_points import restart
from yawid.estimation.kernel.forgetting import noise_variance
from yawid.estimation.kernel.linear_algebra import entry_of_p
from yawid.estimation.kernel.new_state import new_state
from yawid.estimation.machine.runner import RUNNER
from yawid.estimation.start_fit import factorise, fit_start
from yawid.estimation.whiteness import ljung_box

VERSION = "yawid-armax-3"
"""Of a saved estimator: changes whenever the meaning or place of anything in the state does."""
NO_SAMPLE, NO_ROWS = np.empty(0), np.empty((0, 0))


class Estimate:
    """A snapshot after one sample; its fields are computed when asked for."""

    __slots__ = ("_saved",)

    def __init__(self, saved: bytes) -> None:
        self._saved = saved

    def _block(self, *, covariance: bool = False) -> EstimateBlock:
        # Whoever takes samples writes to the state.
        return _reading(np.frombuffer(self._saved).copy(), covariance=covariance)

    @property
    def theta(self) -> Floats:
        """Parameters (n,) in the user's units."""
        return np.asarray(self._block().theta[0])

    @property
    def theta_std(self) -> Floats:
        """Standard deviation (n,) of theta; NaN before the first update."""
        return np.asarray(self._block().theta_std[0])

    @property
    def covariance(self) -> Floats:
        """Covariance (n, n) of theta; NaN before the first update."""
        return _covariance(self._block(covariance=True))

    @property
    def y_hat(self) -> float:
        """One-step prediction of y; NaN where there was none."""
        return float(self._block().y_hat[0])

    @property
    def innovation(self) -> float:
        """The error a priori, y - y_hat."""
        return float(self._block().innovation[0])

    @property
    def residual(self) -> float:
        """The error a posteriori, y - phi' theta(k)."""
        return float(self._block().residual[0])

    @property
    def noise_std(self) -> float:
        """Standard deviation of the innovation."""
        return float(self._block().noise_std[0])

    @property
    def status(self) -> Status:
        """What the estimator says of itself."""
        return Status(int(self._block().status[0]))

    def __repr__(self) -> str:
        return (
            f"Estimate(theta={self.theta}, theta_std={self.theta_std}, status={self.status.name})"
        )


def _reading(state: Floats, *, covariance: bool) -> EstimateBlock:
    """Return one row of what came of the last sample."""
    n = int(slots.named(state).n)
    row = np.empty(estimate_width(n, covariance))
    RUNNER.run(state, NO_SAMPLE, NO_SAMPLE, row[np.newaxis], 0)
    return EstimateBlock(row[np.newaxis], n)


def _covariance(block: EstimateBlock) -> Floats:
    assert block.covariance is not None  # it was asked for
    return np.asarray(block.covariance[0])


class RecursiveArmax:
    """Recursive estimation of A(q) y = B(q) u + C(q) e + bias, paper eq. 28-33.

    theta = [a1.., b1.. of each input, c1.., bias]; phi(k) = [-y(k-1).., u(k-nk).., eps(k-1).., 1];
    psi = phi for ``els`` and phi filtered by 1/C(q) for ``rml``; then, a sample at a time::

        e     = y - phi' theta                     innovation (a priori)
        alpha = lambda + psi' P psi
        theta = theta + P psi e / alpha            halved until C(q) is stable (rml)
        eps   = y - phi' theta                     residual (a posteriori), the one in phi
        P     = (P - P psi psi' P / alpha) / lambda

    with P = U D U' (Bierman 1977). Ljung and Soderstrom (1983), chapter 3.
    """

    def __init__(self, config: EstimatorConfig) -> None:
        self._adopt(config, new_state(config))

    def _adopt(self, config: EstimatorConfig, state: Floats) -> None:
        self.config = config
        self._state = state
        self._header, self._parts = slots.named(state), slots.cut(state)
        self._moving = state[: len(state) - len(self._parts.samples)]
        self._inputs = config.orders.n_inputs
        self._u, self._y = np.empty(self._inputs), np.empty(1)  # of one sample
        self._n = config.n_theta

    def update(self, u: ArrayLike | float, y: float) -> Estimate:
        """Take one sample; ``u`` is a float, or (n_inputs,). A NaN makes it a held record.

        Raises:
            ConfigError: u or y is infinite, or u has another number of inputs.
        """
        if self._inputs == 1 and isinstance(u, float):
            self._u[0], self._y[0] = u, y
            if (done := RUNNER.run(self._state, self._u, self._y, NO_ROWS, 0)) < 1:
                if done < 0:
                    raise ConfigError(f"u and y must not be infinite, got u = {u!r}, y = {y!r}")
                self._after_stop()
        else:
            row = checked_u(u, y, self._inputs)
            self.run(row.reshape(1, -1), [y], keep="last")
        return Estimate(self._moving.tobytes())

    def run(
        self,
        u: ArrayLike,
        y: ArrayLike,
        keep: Literal["all", "last"] = "all",
        covariance: bool = False,
    ) -> EstimateBlock:
        """Take a block of samples: the same numbers as so many updates.

        ``u`` (samples,) or (samples, n_inputs), ``y`` (samples,). ``keep="last"`` returns the last
        row only; ``covariance`` adds theta's, (samples, n, n).

        Raises:
            ConfigError: wrong shapes or an infinite value; nothing has been taken then.
        """
        if keep not in ("all", "last"):
            raise ConfigError(f'keep must be "all" or "last", got {keep!r}')
        u, y = checked_samples(u, y, self._inputs)
        n = self._n
        rows = np.empty((len(y) if keep == "all" else 1, estimate_width(n, covariance)))
        self._take(u, y, rows)
        return EstimateBlock(rows, n)

    def _take(self, u: Floats, y: Floats, rows: Floats) -> None:
        flat = u.reshape(-1)
        done = RUNNER.run(self._state, flat, y, rows, 0)
        if done < 0:
            raise ConfigError("u and y must not be infinite; a NaN marks a sample to be held")
        while done < len(y):
            self._after_stop()
            if len(rows) == len(y):
                RUNNER.run(self._state, NO_SAMPLE, NO_SAMPLE, rows[done : done + 1], 0)
            done = RUNNER.run(self._state, flat, y, rows, done + 1)

    def _after_stop(self) -> None:
        if self._header.phase == slots.RESTARTING:
            restart(self._state)
        else:
            self._release()

    def _release(self) -> None:
        """Run through the window's samples, oldest first, and recurse from now on."""
        s, parts, start = self._header, self._parts, None
        rows = np.roll(parts.samples.reshape(int(s.window), -1), -int(s.head), 0)
        if self.config.start_buffer:
            scaled = rows.copy()
            scaled[:, 1:] *= parts.factors
            start = fit_start(self.config, scaled)
        s.phase = slots.RUNNING
        if start is not None:
            parts.theta[:] = start.theta
            factorise(start.P, parts.d, parts.upper)
            if self.config.residual_lags:
                parts.covariance[:] = start.covariance.ravel()
            s.phase = slots.FROZEN
        gaps = np.flatnonzero(rows[:, 0])
        rows = np.insert(rows, gaps, np.nan, axis=0)
        self._take(rows[:, 2:].copy(), rows[:, 1].copy(), NO_ROWS)
        s.held -= len(gaps)
        if start is not None:
            s.phase, s.lam = slots.RUNNING, s.lam_end
        s.count = 0.0
        parts.samples[:] = 0.0
        s.y_hat = s.innovation = math.nan  # nothing could be predicted before this sample

    def predict(self, u: ArrayLike = math.nan) -> float:
        """Return y_hat(k) = phi' theta, in y's unit (eq. 30); NaN while it is not known.

        ``u``, a float or (n_inputs,), is u(k), which matters only where nk = 0. Not known is
        y_hat while the window or the lags are not full. Changes nothing.

        Raises:
            ConfigError: nk = 0 and u has another number of inputs or is infinite.
        """
        row, nk = np.zeros((1, self._inputs)), np.array(self.config.orders.nk)
        if not nk.all():
            row[:] = np.where(nk > 0, 0.0, checked_u(u, 0.0, self._inputs))
        if self._header.phase != slots.RUNNING:
            return math.nan
        scratch = self._moving.copy()
        RUNNER.run(scratch, row[0], np.zeros(1), NO_ROWS, 0)  # whatever y is, it comes after y_hat
        return float(slots.named(scratch).y_hat) / self._scale

    def to_bytes(self) -> bytes:
        """Save everything; the estimator that comes back resumes bit for bit.

        A line of JSON with version and configuration, then the packed state.
        """
        head = json.dumps({"version": VERSION, "config": asdict(self.config)})
        return head.encode() + b"\n" + self._state.astype("<f8").tobytes()

    @classmethod
    def from_bytes(cls, saved: bytes) -> "RecursiveArmax":
        """Return the estimator that ``to_bytes`` saved.

        Raises:
            ConfigError: the bytes are not a whole save, or one of another version.
        """
        head, _, body = bytes(saved).partition(b"\n")
        try:
            record: dict[str, Any] = json.loads(head)
            version, values = record["version"], record["config"]
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError("these bytes are no saved estimator") from error
        if version != VERSION:
            raise ConfigError(f"saved as {version!r}, this is {VERSION!r}: it cannot be resumed")
        values["orders"] = ArmaxOrders(**values["orders"])
        config = EstimatorConfig(**values)
        length = 8 * len(new_state(config))
        if len(body) != length:
            raise ConfigError(f"the saved state has {len(body)} bytes, {length} are expected")
        estimator = cls.__new__(cls)
        estimator._adopt(config, np.frombuffer(body, "<f8").astype(np.float64))
        return estimator

    @property
    def theta(self) -> Floats:
        """Parameters (n,) in the user's units."""
        return self._parts.theta * self._parts.units

    @property
    def theta_std(self) -> Floats:
        """Standard deviation (n,) of theta, see :attr:`covariance`."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def covariance(self) -> Floats:
        """Covariance (n, n) of theta in the user's units; NaN before the first update."""
        return _covariance(_reading(self._state, covariance=True))

    @property
    def P(self) -> Floats:
        """P (n, n) in the user's units, not multiplied by the noise variance."""
        n, d, upper = self.config.n_theta, self._parts.d, self._parts.upper
        P = np.empty((n, n))
        for j in range(n):
            for i in range(j + 1):
                P[i, j] = P[j, i] = entry_of_p(d, upper, i, j)
        units = self._parts.units * self._parts.factors[0]
        return P * np.outer(units, units)

    @property
    def status(self) -> Status:
        """The status after the last sample."""
        return Status(int(self._header.status))

    @property
    def updates(self) -> int:
        """Samples that moved theta (or took part in the start fit)."""
        return int(self._header.updates)

    @property
    def held(self) -> int:
        """Samples that did not: NaN, lags refilling, or dropped from a window that did not move."""
        return int(self._header.held)

    @property
    def halved(self) -> int:
        """Updates whose step was halved to keep C(q) stable."""
        return int(self._header.halved)

    @property
    def restarts(self) -> int:
        """How often a non-finite result made theta and P start anew."""
        return int(self._header.restarts)

    @property
    def forgetting_factor(self) -> float:
        """Lambda of the next update, on its way to the one configured."""
        return float(self._header.lam)

    @property
    def noise_std(self) -> float:
        """Standard deviation of the noise e, in y's unit."""
        return math.sqrt(noise_variance(self._header)) / self._scale

    @property
    def innovation_std(self) -> float:
        """Root mean square of the innovation, with the same forgetting."""
        return self._mean_root(self._header.e2)

    @property
    def residual_std(self) -> float:
        """Root mean square of the residual, with the same forgetting."""
        return self._mean_root(self._header.eps2)

    @property
    def whiteness_p(self) -> float:
        """Ljung-Box p-value that the residuals are white; NaN while unknown."""
        s1, s2 = float(self._header.s1), float(self._header.s2)
        return ljung_box(self._parts.products, s1, s2)

    @property
    def _scale(self) -> float:
        return float(self._parts.factors[0])

    def _mean_root(self, total: float) -> float:
        s1 = self._header.s1
        return math.sqrt(total / s1) / self._scale if s1 else math.nan
