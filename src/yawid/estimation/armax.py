"""The recursive ARMAX estimator: one page to understand it.

It has two methods: extended least squares (ELS) and recursive maximum likelihood (RML). This file
has the class that callers use, and ``kernel/recursion.py`` takes one sample in the order of the
steps below: no other file is needed to follow a sample. Equation numbers are the paper's; the
method is that of Ljung and Soderstrom (1983), ch. 3.

Model::

    A(q) y(k) = B(q) u(k) + C(q) e(k) + bias                                        (28)
    A(q) = 1 + a1 q^-1 + .. + a_na q^-na    C(q) = 1 + c1 q^-1 + .. + c_nc q^-nc    (29)
    B(q) = b1 q^-nk + .. + b_nb q^-(nk+nb-1), one for each input                    (29)
    theta  = [a1.., b1.. of each input, c1.., bias]                                 (31)
    phi(k) = [-y(k-1).., u(k-nk).. of each input, eps(k-1).., 1]                    (32)

=============  ========================================================  ======================
symbol         what it is                                                unit
=============  ========================================================  ======================
k, Ts          number of the sample on the grid; sample time             1; s
y              output: the yaw rate                                      rad/s
u              inputs, the rudder first                                  half travel (or rad)
theta          the n parameters: a and c; b; bias                        1; y per u; y
phi, psi       regressor; phi itself (ELS) or phi filtered (RML), (n,)   y; u; y; 1
e, eps         innovation (error a priori); residual (a posteriori)      y
P = U D U'     covariance of theta over the variance of e, (n, n)        theta^2 / y^2
lambda         forgetting factor, exp(-Ts / memory) in the end           1 (memory in s)
sigma^2, cov   variance of e; covariance of theta, (n, n)                y^2; theta^2
S1, S2         sum of the weights of all updates; sum of their squares   1
=============  ========================================================  ======================

A sample's way, with the function of each step in ``kernel/recursion.py``:

1. Scaling (in ``kernel/entry_points.py``). The first samples are kept in a window, of the length
   ``scale_window`` or ``start_buffer``, whichever is larger. It moves on until y and each input
   have a standard deviation of at least ``scale_minimum`` in it. Each signal is then multiplied by
   the power of two that brings its standard deviation to 0.71 to 1.41, and the samples in the
   window go through the steps below, all of which work on scaled signals; results get their units
   back when they are read. theta starts from 0 and P from P0 on its diagonal or, with
   ``start_buffer``, both from one prediction-error fit of the window (``start_fit.py``).
2. Held samples. A sample with a NaN changes neither theta nor P. After it the registers of past
   samples are emptied (``_open``), and there is no update until they hold all lags of y and u and
   nc residuals again.
3. Prediction (``expect``): y_hat(k) = phi' theta (30), and e = y - y_hat.
4. Regressor (``_filter``, ``_learn``). ELS: psi = phi. RML: psi = phi filtered by 1/C(q), after
   150 updates with psi = phi; while lambda is below its end, the zeros of that C are multiplied
   by 1 - (lambda_end - lambda).
5. Update (``_learn``)::

       gain  = P psi                            P = U D U' by Bierman (1977): ``bierman``
       alpha = lambda + psi' gain
       P     = (P - gain gain' / alpha) / lambda       no entry of D exceeds 1e6 (or P0)
       theta = theta + mu gain e / alpha               mu = 1; RML halves it until C(q) is stable
       eps   = y - phi' theta                          (33), with the new theta: it enters phi

   The test of stability is Jury's (``stable``); after 12 trials mu = 0. Where a result is not
   finite, theta and P start again (``state.restart``).
6. Covariance (``follow_covariance``). The correlation of e over about ``residual_lags`` samples is
   included, through what earlier e have left in theta (``echo``)::

       F    = I - K psi',  K = gain / alpha,  h = m echo
       cov  = F cov F' + K e e K' + F h e K' + K e h' F'
       echo = F h + K e                    m rises, at most to 1 - 1 / residual_lags

   With ``residual_lags`` = 0, cov = sigma^2 P S2 / S1 instead (``covariance_entry``).
7. Information floor (``_keep_information``), for one parameter at each update in turn: where
   forgetting has let P[i, i] grow beyond 1 + 0.03 / ``information_floor`` times its usual least, a
   pseudo-measurement of theta[i] equal to its estimate brings it back. theta does not change.
8. Forgetting (``_adapt``): lambda(k+1) = rate lambda(k) + (1 - rate) lambda_end, from
   ``forgetting_start``, or from lambda_end after a start fit.
9. Sums (``_account``, ``noise_variance``): S1 = lambda S1 + 1, S2 = lambda^2 S2 + 1,
   loss = lambda loss + lambda e^2 / alpha, sigma^2 = loss / (S1 - n S2 / S1), that divisor at
   least 1; and the products of residuals, for the test of whiteness. The status is WARMING_UP
   during the first 10 n updates. It becomes DIVERGED where the mean of e^2 over about 100 updates
   exceeds four times that of y^2, and recovers where it falls below twice.

Elsewhere: settings and defaults in ``config/estimator.py``, names of the packed state in
``kernel/state.py``, the fit that may start it in ``start_fit.py``. ``machine/`` compiles it;
``reference.py`` is the same recursion on filterpy, with which the tests compare this one.
"""

import json
import math
from dataclasses import asdict
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import EstimateBlock, Floats, Status, estimate_width
from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.errors import ConfigError
from yawid.estimation.checks import checked_samples
from yawid.estimation.kernel import state as slots
from yawid.estimation.kernel.recursion import entry_of_p
from yawid.estimation.kernel.state import new_state, restart
from yawid.estimation.machine.runner import RUNNER
from yawid.estimation.start_fit import factorise, fit_start
from yawid.estimation.whiteness import ljung_box

VERSION = "yawid-armax-4"
"""Version of a saved estimator: it changes with the meaning or place of anything in the state."""
NO_SAMPLE, NO_ROWS = np.empty(0), np.empty((0, 0))


class Estimate:
    """The estimate after one sample: a copy, whose fields are computed when they are read."""

    __slots__ = ("_saved",)

    def __init__(self, saved: bytes) -> None:
        self._saved = saved

    def _block(self, *, covariance: bool = False) -> EstimateBlock:
        # Reading writes to the state.
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
        found = self._block(covariance=True).covariance
        assert found is not None  # it was asked for
        return np.asarray(found[0])

    @property
    def y_hat(self) -> float:
        """One-step prediction of y, in y's unit (eq. 30); NaN where there was none."""
        return float(self._block().y_hat[0])

    @property
    def innovation(self) -> float:
        """Innovation, the error a priori: y - y_hat, in y's unit."""
        return float(self._block().innovation[0])

    @property
    def residual(self) -> float:
        """Residual, the error a posteriori: y - phi' theta(k), in y's unit (eq. 33)."""
        return float(self._block().residual[0])

    @property
    def noise_std(self) -> float:
        """Standard deviation of the noise e, in y's unit; NaN before the first update."""
        return float(self._block().noise_std[0])

    @property
    def status(self) -> Status:
        """State of the estimator: warming up, tracking, held or diverged."""
        return Status(int(self._block().status[0]))

    def __repr__(self) -> str:
        name, status = type(self).__name__, self.status.name
        return f"{name}(theta={self.theta}, theta_std={self.theta_std}, status={status})"


def _reading(state: Floats, *, covariance: bool) -> EstimateBlock:
    """Return the results of the last sample, a block of one row."""
    n = int(slots.named(state).n)
    row = np.empty(estimate_width(n, covariance))
    RUNNER.run(state, NO_SAMPLE, NO_SAMPLE, row[np.newaxis], 0)
    return EstimateBlock(row[np.newaxis], n)


class RecursiveArmax(Estimate):
    """Recursive estimator of A(q) y = B(q) u + C(q) e + bias, paper eq. 28-33.

    theta = [a1.., b1.. of each input, c1.., bias]. The method of the configuration is ``els`` or
    ``rml``; the page at the top of ``estimation/armax.py`` has all equations, symbols and units.
    It is read as its newest :class:`Estimate` is.
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
        """Take one sample and return the estimate after it; a sample with a NaN is held.

        ``u`` is a float, or has the shape (n_inputs,).

        Raises:
            ConfigError: u or y is infinite, or u has the wrong number of inputs.
        """
        if self._inputs == 1 and isinstance(u, float):
            self._u[0], self._y[0] = u, y
            if (done := RUNNER.run(self._state, self._u, self._y, NO_ROWS, 0)) < 1:
                if done < 0:
                    raise ConfigError(f"u and y must not be infinite, got u = {u!r}, y = {y!r}")
                self._after_stop()
        else:
            self.run(u, [y], keep="last")
        return Estimate(self._moving.tobytes())

    def run(
        self,
        u: ArrayLike,
        y: ArrayLike,
        keep: Literal["all", "last"] = "all",
        covariance: bool = False,
    ) -> EstimateBlock:
        """Take a block of samples; the results equal those of as many calls of :meth:`update`.

        ``u`` has the shape (samples,) or (samples, n_inputs), ``y`` (samples,). ``keep="last"``
        returns the last row only; ``covariance`` adds the covariance of theta, (samples, n, n).

        Raises:
            ConfigError: ``keep`` or a shape is wrong, or a value is infinite; nothing has been
            taken then.
        """
        if keep not in ("all", "last"):
            raise ConfigError(f'keep must be "all" or "last", got {keep!r}')
        u, y = checked_samples(u, y, self._inputs)
        n = self._n
        rows = np.empty((len(y) if keep == "all" else 1, estimate_width(n, covariance)))
        self._take(u, y, rows)
        return EstimateBlock(rows, n)

    def _run(self, u: Floats, y: Floats, rows: Floats, first: int) -> int:
        return RUNNER.run(self._state, u, y, rows, first)

    def _take(self, u: Floats, y: Floats, rows: Floats) -> None:
        """Take a block of samples, with the work between two of them that only Python can do."""
        flat = u.reshape(-1)
        done = self._run(flat, y, rows, 0)
        if done < 0:
            raise ConfigError("u and y must not be infinite; a NaN marks a sample to be held")
        while done < len(y):
            self._after_stop()
            if len(rows) == len(y):
                self._run(NO_SAMPLE, NO_SAMPLE, rows[done : done + 1], 0)
            done = self._run(flat, y, rows, done + 1)

    def _after_stop(self) -> None:
        """Do that work: restart, or release the window."""
        if self._header.phase == slots.RESTARTING:
            restart(self._state)
        else:
            self._release()

    def _release(self) -> None:
        """Take the samples of the window, the oldest first, and recurse from now on."""
        s, parts, start = self._header, self._parts, None
        rows = np.roll(parts.samples.reshape(int(s.window), -1), -int(s.head), 0)
        gaps = np.flatnonzero(rows[:, 0])
        taken = np.insert(rows, gaps, np.nan, axis=0)
        u, y = taken[:, 2:].copy(), taken[:, 1].copy()
        s.phase = slots.RUNNING
        if self.config.start_buffer:
            first = self._state.copy()
            RUNNER.run(first, u.reshape(-1), y, NO_ROWS, 0)
            scaled = rows * [1.0, *parts.factors]
            start = fit_start(self.config, scaled, slots.cut(first).theta)
        if start is not None:
            parts.theta[:], parts.d[:] = start.theta, 0.0  # without variance theta stays
            s.lam, s.since = s.lam_end, 1.0  # the first residuals count, as in the fit
            if self.config.residual_lags:
                parts.covariance[:] = start.covariance.ravel()
        self._take(u, y, NO_ROWS)
        s.held -= len(gaps)
        if start is not None:
            factorise(start.P, parts.d, parts.upper)
            parts.least[:] = parts.best[:] = s.P0
            s.lam, s.since = s.lam_end, s.since - 1.0
        s.count = 0.0
        parts.samples[:] = 0.0
        s.y_hat = s.innovation = math.nan  # nothing could be predicted before this sample

    def predict(self, u: ArrayLike = math.nan) -> float:
        """Return the prediction y_hat(k) = phi' theta in y's unit (eq. 30); change nothing.

        ``u``, a float or (n_inputs,), is u(k); it is used only where nk = 0. The result is NaN
        while the window or the lags are not full.

        Raises:
            ConfigError: nk = 0 and u has the wrong number of inputs or is infinite.
        """
        row, nk = np.zeros((1, self._inputs)), np.array(self.config.orders.nk)
        if not nk.all():
            row[:] = np.where(
                nk > 0, 0.0, checked_samples(u, [0.0], self._inputs, finite_or_nan=True)[0]
            )
        if self._header.phase != slots.RUNNING:
            return math.nan
        scratch = self._moving.copy()
        RUNNER.run(scratch, row[0], np.zeros(1), NO_ROWS, 0)  # y has no effect on y_hat
        return float(slots.named(scratch).y_hat) / self._scale

    def to_bytes(self) -> bytes:
        """Return the whole estimator as bytes, from which :meth:`from_bytes` resumes bit for bit.

        They are a line of JSON with version and configuration, then the packed state.
        """
        head = json.dumps({"version": VERSION, "config": asdict(self.config)})
        return head.encode() + b"\n" + self._state.astype("<f8").tobytes()

    @classmethod
    def from_bytes(cls, saved: bytes) -> "RecursiveArmax":
        """Return the estimator that :meth:`to_bytes` saved.

        Raises:
            ConfigError: the bytes are not a complete saved estimator, or of another version.
        """
        head, _, body = bytes(saved).partition(b"\n")
        try:
            record: dict[str, Any] = json.loads(head)
            version, values = record["version"], record["config"]
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError("these bytes are not a saved estimator") from error
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

    def _block(self, *, covariance: bool = False) -> EstimateBlock:
        return _reading(self._state, covariance=covariance)

    @property
    def P(self) -> Floats:
        """P (n, n): the covariance of theta over the noise variance, in the user's units."""
        n, d, upper = self.config.n_theta, self._parts.d, self._parts.upper
        P = np.empty((n, n))
        for j in range(n):
            for i in range(j + 1):
                P[i, j] = P[j, i] = entry_of_p(d, upper, i, j)
        units = self._parts.units * self._parts.factors[0]
        return P * np.outer(units, units)

    @property
    def updates(self) -> int:
        """Number of samples that updated theta or took part in the start fit."""
        return int(self._header.updates)

    @property
    def held(self) -> int:
        """Number of other samples: with a NaN, while lags fill, or dropped from a still window."""
        return int(self._header.held)

    @property
    def halved(self) -> int:
        """Number of updates whose step was halved to keep C(q) stable (RML)."""
        return int(self._header.halved)

    @property
    def restarts(self) -> int:
        """Number of times that theta and P started again after a result that was not finite."""
        return int(self._header.restarts)

    @property
    def forgetting_factor(self) -> float:
        """lambda of the next update, which approaches that of the configuration."""
        return float(self._header.lam)

    @property
    def innovation_std(self) -> float:
        """Root mean square of the innovation in y's unit, weighted by the same forgetting."""
        return self._mean_root(self._header.e2)

    @property
    def residual_std(self) -> float:
        """Root mean square of the residual in y's unit, weighted by the same forgetting."""
        return self._mean_root(self._header.eps2)

    @property
    def whiteness_p(self) -> float:
        """p-value of the Ljung-Box test that the residuals are white; NaN while unknown."""
        s1, s2 = float(self._header.s1), float(self._header.s2)
        return ljung_box(self._parts.products, s1, s2)

    @property
    def _scale(self) -> float:
        return float(self._parts.factors[0])

    def _mean_root(self, total: float) -> float:
        s1 = self._header.s1
        return math.sqrt(total / s1) / self._scale if s1 else math.nan
