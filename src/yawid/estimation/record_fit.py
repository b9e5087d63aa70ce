"""One fit over a whole record, with equal weights: how a manoeuvre is estimated.

One pass of a recursion over a short record has not converged at its end. The row of each method in
``methods.py`` names its fit and the scores from which the covariance of theta is computed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from yawid.blocks import Bools, EstimateBlock, Floats, Status
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.fit import fit_percent, simulate
from yawid.estimation.free_run import RudderEffect, best_shift, rudder_fits
from yawid.estimation.machine.products import cross
from yawid.estimation.methods import METHODS, Method
from yawid.estimation.polynomials import lag_depth
from yawid.estimation.prediction_error import SETTLED, RecordFit, stretches_of
from yawid.estimation.whiteness import chi_square_tail, ljung_box

BLOCKS = 8
"""A record is cut into this many parts, to estimate how much their answers scatter."""
HELD_BACK_SHARE = 1.0 / 3.0
"""Share of the rudder's energy in the samples that are held back, at the end of the record."""
LEAST_PER_PARAMETER = 10
"""Where samples are held back, at least this many for each parameter are needed before them."""


@dataclass(frozen=True, slots=True)
class FittedModel:
    """Result of a fit in the user's units, with the fields of an estimator after its last sample.

    ``theta`` (n,) and its ``covariance`` (n, n) are 0 and NaN where nothing was found. ``scatter``
    (n, n) is the covariance estimated from the differences between parts of the record, whatever
    their cause. ``y_hat`` (samples,) is the one-step prediction in y's unit, NaN where there was
    none. ``updates`` is the number of samples fitted, ``held`` that of all others,
    ``innovation_std`` the root mean square of the residuals in y's unit, ``whiteness_p`` the
    p-value of the Ljung-Box test.
    """

    config: EstimatorConfig
    theta: Floats
    covariance: Floats
    scatter: Floats
    y_hat: Floats
    updates: int
    held: int
    innovation_std: float
    whiteness_p: float
    status: Status

    @property
    def residual_std(self) -> float:
        """Equal to ``innovation_std``: with a constant theta innovation and residual are equal."""
        return self.innovation_std

    @property
    def last(self) -> EstimateBlock:
        """The estimate as a block of one row."""
        return self.row(self.covariance)

    def row(self, covariance: Floats) -> EstimateBlock:
        """Return the estimate as a block of one row, with the given covariance (n, n)."""
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        one = np.full(1, np.nan)
        noise, status = np.full(1, self.innovation_std), np.full(1, int(self.status))
        return EstimateBlock.of(
            self.theta[None], std[None], covariance[None], one, one, one, noise, status
        )


@dataclass(frozen=True, slots=True)
class Record:
    """A record prepared for fits of ``config``: ``good`` (samples,) are its rows without a NaN.

    ``breaks`` (n,) marks the good rows that follow a held one; ``factors`` (1 + n_inputs,) scale y
    and the inputs; ``fit`` has the scaled stretches. ``is_enough`` says that it has more than two
    samples for each parameter, and that y and every input move.
    """

    config: EstimatorConfig
    good: Bools
    breaks: Bools
    factors: Floats
    fit: RecordFit
    is_enough: bool

    @classmethod
    @np.errstate(all="ignore")
    def of(cls, config: EstimatorConfig, u: Floats, y: Floats) -> "Record":
        """Return the record ``u`` (samples, n_inputs), ``y`` (samples,), scaled and cut."""
        good = np.isfinite(y) & np.isfinite(u).all(axis=1)
        signals = np.column_stack([y, u])[good]
        factors = _factors(signals)
        breaks = np.diff(good.astype(int), prepend=0)[good] > 0
        rows = np.column_stack([breaks, signals * factors])
        fit = RecordFit(config, list(stretches_of(config, rows)))
        # The standard deviation of a constant is rounding error, and not always 0.
        is_enough = len(fit.y) > 2 * config.n_theta and bool(np.ptp(signals, axis=0).all())
        return cls(config, good, breaks, factors, fit, is_enough)


def fit_record(
    config: EstimatorConfig, u: Floats, y: Floats, settled: float = SETTLED, method: str = ""
) -> FittedModel:
    """Fit a record ``u`` (samples, n_inputs), ``y`` (samples,); rows with NaN are held and cut it.

    The configuration gives orders, bias and residual lags, and the method where ``method`` is
    empty; its forgetting factor must be 1, which the covariance assumes. ``updates`` is 0 where
    there are at most two samples for each parameter, or y or an input does not move. Where the fit
    finds no theta the status is DIVERGED. A fit of least loss stops where a step reduces the loss
    by a smaller share than ``settled``.
    """
    return fit_methods(Record.of(config, u, y), [method or config.method], settled)[0]


@np.errstate(all="ignore")
def fit_methods(
    record: Record, methods: Sequence[str], settled: float = SETTLED
) -> list[FittedModel]:
    """Fit a record by several methods from the same first guess; as :func:`fit_record` for each."""
    if not record.is_enough:
        nothing = _nothing(record.config, len(record.good), Status.WARMING_UP)
        return [nothing] * len(methods)
    return [_fitted_model(METHODS[method], record, settled) for method in methods]


def _fitted_model(method: Method, record: Record, settled: float) -> FittedModel:
    config, fit, good, factors = record.config, record.fit, record.good, record.factors
    n = len(fit.y)
    least = _least(method, fit, settled)
    found = None if least is None else _covariances(method, record, *least)
    if least is None or found is None:
        return _nothing(config, len(good), Status.DIVERGED)
    theta, residuals = least
    units = _units(config, factors)
    covariance, scatter = (each * np.outer(units, units) for each in found)
    eps, y_hat = np.concatenate(residuals), np.full(len(good), np.nan)
    y_hat[np.flatnonzero(good)[_fitted(config, record.breaks)]] = (fit.y - eps) / factors[0]
    return FittedModel(
        config, theta * units, covariance, scatter, y_hat, n, len(good) - n,
        float(np.sqrt(np.mean(eps**2))) / factors[0], _whiteness(residuals, config.residual_lags),
        Status.TRACKING,
    )  # fmt: skip


@np.errstate(all="ignore")
def rudder_effect(
    model: FittedModel, record: Record, shifts: tuple[int, int] | None = None
) -> RudderEffect:
    """Return what the rudder adds to a ``model`` of a record.

    ``shifts`` are the least and the most samples by which the rudder is shifted for comparison;
    without them it is not. B = 0 is tested by Wald's chi-square, with the covariance of the fit.
    """
    config, orders = model.config, model.config.orders
    b = slice(orders.na, orders.na + orders.nb[0])
    if not (record.is_enough and np.isfinite(model.covariance).all() and model.theta.any()):
        return RudderEffect(math.nan, math.nan, math.nan)
    theta = model.theta / _units(config, record.factors)
    try:
        effect = float(model.theta[b] @ np.linalg.solve(model.covariance[b, b], model.theta[b]))
        with_it, alone, unshifted = rudder_fits(record.fit, theta)
        chance = chi_square_tail(effect, orders.nb[0])
        if shifts is None:
            return RudderEffect(chance, with_it, alone)
        shift, shifted = best_shift(record.fit, theta, *shifts)
    except np.linalg.LinAlgError:  # an unstable A, or signals that are linearly dependent
        return RudderEffect(math.nan, math.nan, math.nan)
    innovations = len(record.fit.y) * (model.innovation_std * record.factors[0]) ** 2
    return RudderEffect(
        chance,
        with_it,
        alone,
        shifted_s=shift * config.sample_time_s,
        ratio=shifted / unshifted,
        excess=unshifted / innovations,
    )


@np.errstate(all="ignore")
def held_back_pct(
    config: EstimatorConfig, u: Floats, y: Floats, settled: float = SETTLED, method: str = ""
) -> float:
    """Return how well a model fitted to the first part of a record explains the rest, in percent.

    The rest has the last third of the rudder's energy, and the model is simulated over it. ``u``
    (samples, n_inputs), ``y`` (samples,), ``settled`` and ``method`` as in :func:`fit_record`. NaN
    where the first part has fewer than ten samples for each parameter, or no model was found.
    """
    used = np.flatnonzero(np.isfinite(y) & np.isfinite(u).all(axis=1))
    if len(used) == 0:
        return float("nan")
    rudder = u[used, 0]
    energy = np.cumsum((rudder - rudder.mean()) ** 2)
    first = int(np.searchsorted(energy, (1.0 - HELD_BACK_SHARE) * energy[-1]))
    if first < LEAST_PER_PARAMETER * config.n_theta:
        return float("nan")
    row = int(used[first])
    record = Record.of(config, u[:row], y[:row])
    row_of = METHODS[method or config.method]
    least = _least(row_of, record.fit, settled) if record.is_enough else None
    if least is None:
        return float("nan")
    theta, u, y = least[0] * _units(config, record.factors), u[row:], y[row:]
    if row_of.runs_free and (rest := Record.of(config, u, y)).is_enough:
        residuals = row_of.residuals(rest.fit, theta / _units(config, rest.factors))
        return fit_percent(rest.fit.y, rest.fit.y - np.concatenate(residuals))
    return fit_percent(y, simulate(theta, config.orders, config.bias, u, y))


def _least(method: Method, fit: RecordFit, settled: float) -> tuple[Floats, list[Floats]] | None:
    """Return theta (n,) of the scaled signals and the residuals of each stretch there.

    None where theta = 0 has no larger loss.
    """
    try:
        theta = method.fit(fit, settled)
    except np.linalg.LinAlgError:  # signals that are linearly dependent
        return None
    if theta is None:
        return None
    residuals = method.residuals(fit, theta)
    nothing = fit.loss(np.zeros_like(theta), [y for y, _ in fit.stretches])
    return (theta, residuals) if fit.loss(theta, residuals) < nothing else None


def _factors(signals: Floats) -> Floats:
    """Return powers of two (m,) that scale signals (n, m) to a standard deviation of about 1."""
    spread = signals.std(axis=0) if len(signals) else np.ones(signals.shape[1])
    spread = np.where(spread > 0.0, spread, 1.0)
    factors: Floats = 2.0 ** -np.floor(np.log2(spread) + 0.5)
    return factors


def _units(config: EstimatorConfig, factors: Floats) -> Floats:
    """Return the factors (n,) that convert theta of the scaled signals to the user's units."""
    orders = config.orders
    b = np.repeat(factors[1:] / factors[0], orders.nb)
    bias = np.full(int(config.bias), 1.0 / factors[0])
    return np.concatenate([np.ones(orders.na), b, np.ones(orders.nc), bias])


def _fitted(config: EstimatorConfig, breaks: Bools) -> Bools:
    """Return which of the good samples (n,) were fitted: those that have all their lags."""
    depth, nc = lag_depth(config.orders), config.orders.nc
    starts = np.append(np.flatnonzero(breaks), len(breaks))
    since = np.arange(len(breaks)) - np.repeat(starts[:-1], np.diff(starts))
    lengths = np.repeat(np.diff(starts), np.diff(starts))
    fitted: Bools = (since >= depth) & (lengths - depth > nc)
    return fitted


def _covariances(
    method: Method, record: Record, theta: Floats, residuals: list[Floats]
) -> tuple[Floats, Floats] | None:
    """Return theta's covariance and its scatter (n, n): (Z' psi)^-1 S (psi' Z)^-1 with two S.

    Z are the instruments, psi for RML and phi for ELS; ``residuals`` are those at theta. None where
    the covariance is not finite.

    For the covariance S sums the products of the scores Z eps over all lags up to
    ``residual_lags``, with Bartlett's weights (Newey and West 1987), so that it holds for residuals
    that are not white too. For the scatter S is made of the sums of the scores over BLOCKS parts,
    one step of the jackknife that leaves out a part each time (Shao and Tu 1995, 3.2): it includes
    what lasts longer than the lags, such as a gust or a change in the way of flying.
    """
    z, psi, eps = method.scores(record.fit, theta, residuals)
    scores, lags = z * eps[:, None], record.config.residual_lags
    earlier = np.zeros_like(scores)
    for lag in range(1, min(lags, len(scores) - 1) + 1):
        earlier[lag:] += (1.0 - lag / (lags + 1.0)) * scores[:-lag]
    product = cross(scores, earlier)
    meat = cross(scores, scores) + product + product.T
    try:
        bread = np.linalg.inv(cross(z, psi) + record.fit.prior)
    except np.linalg.LinAlgError:
        return None
    covariance: Floats = bread @ meat @ bread.T * (len(eps) / max(len(eps) - len(theta), 1))
    ends = np.arange(BLOCKS + 1) * len(scores) // BLOCKS
    sums = np.array([scores[a:b].sum(axis=0) for a, b in pairwise(ends)])
    sums -= sums.mean(axis=0)
    scatter: Floats = bread @ cross(sums, sums) @ bread.T * (BLOCKS / (BLOCKS - 1.0))
    return (covariance, scatter) if np.isfinite(covariance).all() else None


def _whiteness(residuals: list[Floats], lags: int) -> float:
    """Return the p-value of the Ljung-Box test over all stretches."""
    products = np.zeros(lags + 1)
    for eps in residuals:
        for lag in range(min(lags, len(eps) - 1) + 1):
            products[lag] += np.sum(eps[lag:] * eps[: len(eps) - lag])
    count = float(sum(len(eps) for eps in residuals))
    return ljung_box(products, count, count)


def _nothing(config: EstimatorConfig, samples: int, status: Status) -> FittedModel:
    """Return a model without an estimate; ``updates`` is 0 only where nothing could be fitted."""
    n, updates = config.n_theta, 0 if status == Status.WARMING_UP else 1
    theta, covariance = np.zeros(n), np.full((n, n), np.nan)
    y_hat = np.full(samples, np.nan)
    return FittedModel(
        config, theta, covariance, covariance, y_hat, updates, samples - updates, np.nan, np.nan,
        status,
    )  # fmt: skip
