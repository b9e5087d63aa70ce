"""The recursion against batch twins over the regressors that it saw, and against filterpy."""

from __future__ import annotations

import numpy as np
import pytest
from drawn import examples
from estimation.armax_plants import S1, S2, config, simulate
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.special import gammaincc

from yawid import ArmaxOrders, ConfigError, RecursiveArmax, Status, make_estimator
from yawid.estimation.kernel.recursion import (
    FAST_FALL,
    MOST_RISE,
    PSI_FROM,
    SETTLING,
    SLACK,
    SLOW_RISE,
)
from yawid.estimation.polynomials import known_regressors
from yawid.estimation.reference import ReferenceArmax

ORDERS = st.builds(
    lambda na, inputs, nc: ArmaxOrders(
        na, tuple(nb for nb, _ in inputs), nc, tuple(nk for _, nk in inputs)
    ),
    st.integers(0, 3),
    st.lists(st.tuples(st.integers(1, 3), st.integers(0, 3)), min_size=1, max_size=2),
    st.integers(0, 3),
)


class Floor:
    """The rows that keep information, found from R = P^-1 alone."""

    def __init__(self, n, P0, weight, forgetting):
        self.least, self.best = np.full(n, P0), np.full(n, P0)
        self.next, self.weight = 0, weight
        self.rise = 1.0 + SLOW_RISE * n * (1.0 - forgetting)

    def add(self, R, f, theta, updates):
        k = self.next
        self.next = (k + 1) % len(theta)
        p = np.linalg.inv(R)[k, k]
        if p >= self.least[k]:
            self.least[k] = min(self.least[k] * self.rise, MOST_RISE * self.best[k])
        else:
            self.least[k] = p if updates < SETTLING else max(p, FAST_FALL * self.least[k])
            self.best[k] = min(self.best[k], self.least[k])
        limit = self.least[k] * (1.0 + SLACK / self.weight)
        if p > limit:
            R[k, k] += 1.0 / limit - 1.0 / p
            f[k] += (1.0 / limit - 1.0 / p) * theta[k]


def regressors(signals, c, contraction, orders, bias):
    """psi(k) (n, p): the signals as they enter phi, each through 1/C of the theta before.

    ``c`` (n, nc) are its coefficients; where they are 0, psi is phi.
    """
    counts = [(0, orders.na), *zip(orders.nk, orders.nb, strict=True), (0, orders.nc)]
    counts.append((0, int(bias)))
    lags = [(j, nk + i) for j, (nk, count) in enumerate(counts) for i in range(count)]
    out, psi = signals.copy(), np.zeros((len(signals), len(lags)))
    for k in range(len(out)):
        for i in range(1, min(c.shape[1], k) + 1):
            out[k] -= contraction[k] ** i * c[k, i - 1] * out[k - i]
        psi[k] = [out[k - lag, j] if k >= lag else 0.0 for j, lag in lags]
    return psi


@pytest.mark.parametrize("method", ["els", "rml"])
@given(
    orders=ORDERS,
    bias=st.booleans(),
    forgetting=st.sampled_from([1.0, 0.99, 0.95]),
    seed=st.integers(0, 10_000),
)
def test_theta_is_weighted_least_squares_over_the_regressors_seen(
    method, orders, bias, forgetting, seed
):
    """The rows are phi(k), or psi(k) of RML, their targets e(k) + row' theta(k-1).

    For ELS a target is y(k). Where a step of RML was halved to keep C(q) stable, e(k) counts by the
    share of it that was taken (Ljung and Soderstrom).
    """
    rng = np.random.default_rng(seed)
    n = 400
    u, noise = rng.standard_normal((n, orders.n_inputs)), rng.standard_normal(n)
    y = lfilter([0.0, 1.0], [1.0, -0.7], u.sum(axis=1)) + lfilter([1.0, 0.4], [1.0], noise)
    made = config(orders, method=method, bias=bias, forgetting_factor=forgetting, scale_window=0)
    armax = RecursiveArmax(made)
    seen, came = [], []
    for k in range(n):
        seen.append((armax.theta, armax.forgetting_factor, armax.halved))
        came.append(armax.update(u[k], y[k]))
    theta, lam, halved = (np.array(each) for each in zip(*seen, strict=True))
    theta, halved = np.vstack([theta, armax.theta]), np.append(halved, armax.halved)
    residual = np.nan_to_num([each.residual for each in came])
    first = max([orders.na, *(nb + nk - 1 for nb, nk in zip(orders.nb, orders.nk, strict=True))])
    first += orders.nc
    entering = np.column_stack([-np.roll(y, 1), u, np.roll(residual, 1), np.ones(n)])
    entering[0, [0, -2]] = 0.0
    c = theta[:-1, orders.na + sum(orders.nb) :][:, : orders.nc]
    phi, psi = (
        regressors(entering, each, 1.0 - (forgetting - lam), orders, bias) for each in (0.0 * c, c)
    )
    R, f = np.eye(made.n_theta) / made.P0, np.zeros(made.n_theta)
    floor = Floor(made.n_theta, made.P0, 0.1, forgetting)
    for k in range(first, n):
        row = phi[k] if method == "els" or k - first < PSI_FROM else psi[k]
        R, f, taken = lam[k] * R + np.outer(row, row), lam[k] * f, 1.0
        if halved[k + 1] > halved[k]:
            whole = np.linalg.solve(R, row) * came[k].innovation
            taken = (theta[k + 1] - theta[k]) @ whole / (whole @ whole)
            assert -1e-6 < taken < 0.5 + 1e-6
        f += row * (taken * came[k].innovation + row @ theta[k])
        if forgetting < 1.0:
            floor.add(R, f, np.linalg.solve(R, f), k - first)
    assume(np.linalg.cond(R) < 1e10)
    miss = armax.theta - np.linalg.solve(R, f)
    assert np.sqrt(miss @ R @ miss) < 1e-7
    np.testing.assert_allclose(armax.P, np.linalg.inv(R), rtol=1e-6, atol=1e-12)


@given(na=st.integers(0, 3), nb=st.integers(1, 3), nk=st.integers(0, 3), seed=st.integers(0, 999))
def test_with_nothing_added_it_is_batch_arx(na, nb, nk, seed):
    orders = ArmaxOrders(na, nb, 0, nk)
    u, y = simulate(((-0.8, 0.15), (1.0, 0.5), ()), 300, seed)
    plain = {"forgetting_start": 1.0, "scale_window": 0, "P0": 1e8, "bias": False}
    armax = RecursiveArmax(config(orders, residual_lags=0, **plain))
    armax.run(u, y)
    phi = known_regressors(u[:, None], y, orders, bias=False)[max(na, nb + nk - 1) :]
    batch = np.linalg.lstsq(phi, y[len(y) - len(phi) :], rcond=None)[0]
    np.testing.assert_allclose(armax.theta, batch, atol=1e-6)
    residuals = y[len(y) - len(phi) :] - phi @ batch
    sigma = np.sqrt(residuals @ residuals / (len(phi) - orders.n_theta))
    expected = sigma * np.sqrt(np.diag(np.linalg.inv(phi.T @ phi)))
    np.testing.assert_allclose(armax.theta_std, expected, rtol=1e-4)


CORNERS = {
    "AR": (ArmaxOrders(2, (), 0, ()), (-0.8, 0.15), (), (), 0.0),
    "MA": (ArmaxOrders(0, (), 2, ()), (), (), (0.5, 0.1), 0.0),
    "ARMA": (ArmaxOrders(2, (), 1, ()), (-0.8, 0.15), (), (0.4,), 0.0),
    "ARX": (ArmaxOrders(2, 2, 0, 1), (-0.8, 0.15), ((1.0, 0.5),), (), 0.0),
    "FIR": (ArmaxOrders(0, 3, 0, 0), (), ((1.0, 0.5, -0.3),), (), 0.0),
    "dead time, two inputs, bias": (
        ArmaxOrders(1, (1, 2), 0, (3, 1)), (-0.6,), ((1.0,), (0.5, -0.2)), (), 0.7,
    ),
}  # fmt: skip


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("name", CORNERS)
def test_the_corner_cases_of_the_model_are_identified(name, method):
    orders, a, b, c, bias = CORNERS[name]
    rng = np.random.default_rng(3)
    u, e = rng.standard_normal((20_000, orders.n_inputs)), rng.standard_normal(20_000)
    y = lfilter((1.0, *c), (1.0, *a), e) + bias / (1.0 + sum(a))
    for each, nk, driven in zip(b, orders.nk, u.T, strict=True):
        y += lfilter((*[0.0] * nk, *each), (1.0, *a), driven)
    armax = RecursiveArmax(config(orders, method=method, bias=bias != 0.0))
    last = armax.run(u if b else None, y, keep="last")
    expected = np.array([*a, *sum(b, ()), *c, *[bias] * (bias != 0.0)])
    np.testing.assert_array_less(np.abs(last.theta[0] - expected), 4.0 * last.theta_std[0])


def test_the_statistics_are_sums_over_the_updates_weighted_by_the_forgetting():
    lags, first = 5, 4  # two lags of y and u, and two residuals, come before the first update
    made = config(forgetting_factor=0.97, scale_window=0, residual_lags=lags)
    armax = RecursiveArmax(made)
    block = armax.run(*simulate(S1, 400, 3))
    e, eps = block.innovation[first:], block.residual[first:]
    assert armax.updates == len(e)
    lam = 0.97 - (0.97 - made.forgetting_start) * made.forgetting_rate ** np.arange(len(e))
    weights = np.append(np.cumprod(lam[:0:-1])[::-1], 1.0)
    s1, s2 = weights.sum(), weights @ weights
    assert armax.innovation_std == pytest.approx(np.sqrt(weights @ e**2 / s1), rel=1e-9)
    assert armax.residual_std == pytest.approx(np.sqrt(weights @ eps**2 / s1), rel=1e-9)
    noise = weights @ (e * eps) / (s1 - made.n_theta * s2 / s1)
    assert armax.noise_std == pytest.approx(np.sqrt(noise), rel=1e-9)
    lagged = [np.append(np.zeros(lag), eps[: len(eps) - lag]) for lag in range(lags + 1)]
    products = np.array([weights @ (eps * each) for each in lagged])
    n, r = s1**2 / s2, products[1:] / products[0]
    q = n * (n + 2.0) * np.sum(r**2 / (n - np.arange(1, lags + 1)))
    assert armax.whiteness_p == pytest.approx(gammaincc(0.5 * lags, 0.5 * q), rel=1e-6)


def test_the_start_fit_is_the_prediction_error_estimate_of_its_window():
    """V and psi by SciPy's filter and differences; P and the covariance are those of its page."""
    u, y = simulate(S2, 321, 7)
    y[150] = np.nan
    made = config(
        ArmaxOrders(2, 1, 2, 1), method="rml", start_buffer=320, scale_window=0,
        forgetting_factor=0.99,
    )  # fmt: skip
    armax = RecursiveArmax(made)
    assert not armax.run(u[:-1], y[:-1]).theta.any()
    assert armax.status == Status.WARMING_UP
    armax.update(u[-1], y[-1])

    def errors(theta):
        a, b, c = theta[:2], theta[2], theta[3:5]
        eps = []
        for rows in (slice(150), slice(151, None)):
            rest = lfilter([1.0, *a], [1.0], y[rows]) - lfilter([0.0, b], [1.0], u[rows])
            eps.append(lfilter([1.0], [1.0, *c], (rest - theta[5])[2:]))
        eps = np.concatenate(eps)
        return 0.99 ** (0.5 * np.arange(len(eps))[::-1]) * eps

    steps = 1e-6 * np.eye(6)
    e = errors(armax.theta)
    J = np.array([(errors(armax.theta + h) - errors(armax.theta - h)) / 2e-6 for h in steps]).T
    P = np.linalg.inv(J.T @ J + 1e-8 * np.eye(6))
    np.testing.assert_array_less(np.abs(P @ J.T @ e), 1e-4 * np.sqrt(np.diag(P)))
    np.testing.assert_allclose(armax.P, P, rtol=1e-4, atol=1e-9)
    scores = J * e[:, None]
    np.testing.assert_allclose(armax.covariance, P @ scores.T @ scores @ P, rtol=1e-3, atol=1e-9)
    miss = np.abs(armax.theta - [*S2[0], *S2[1], *S2[2], 0.0])
    np.testing.assert_array_less(miss, 4.0 * armax.theta_std)
    assert armax.status == Status.TRACKING


@pytest.mark.parametrize(("window", "is_fitted"), [(14, False), (15, True)])
def test_a_start_fit_needs_more_than_twice_as_many_samples_as_parameters(window, is_fitted):
    """Of six parameters, after two lags; without it the recursion begins as if there were none."""
    u, y = simulate(S2, window, 7)
    made = config(ArmaxOrders(2, 1, 2, 1), method="rml", start_buffer=window, scale_window=0)
    fitted, plain = (
        RecursiveArmax(made),
        RecursiveArmax(config(made.orders, method="rml", scale_window=0)),
    )
    for each in (fitted, plain):
        each.run(u, y)
    assert (fitted.theta != plain.theta).any() == is_fitted


OPTIONS = st.fixed_dictionaries(
    {
        "method": st.sampled_from(["els", "rml"]),
        "bias": st.booleans(),
        "residual_lags": st.sampled_from([0, 4]),
        "scale_window": st.sampled_from([0, 60]),
    }
)
ADAPTATIONS = st.sampled_from(
    [{}, {"forgetting_factor": 0.97}, {"forgetting_factor": 0.97,
     "information_floor": 0.0, "forgetting_start": 0.99}]
)  # fmt: skip


def assert_agree(kernel, reference, u, y):
    ours = kernel.run(u, y, covariance=True)
    theirs = reference.run(u, y, covariance=True)
    for name in ours.__slots__:
        left, right = getattr(ours, name), getattr(theirs, name)
        np.testing.assert_allclose(left, right, rtol=1e-9, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(kernel.P, reference.P, rtol=1e-9, atol=1e-9)
    for name in ("updates", "held", "halved", "restarts", "status", "forgetting_factor"):
        assert getattr(kernel, name) == getattr(reference, name), name
    for name in ("whiteness_p", "innovation_std", "residual_std", "noise_std"):
        np.testing.assert_allclose(
            getattr(kernel, name), getattr(reference, name), rtol=1e-7, atol=1e-9, err_msg=name
        )


@examples(12)
@given(
    options=OPTIONS,
    adaptation=ADAPTATIONS,
    orders=ORDERS,
    still=st.sampled_from([0, 0, 120]),
    seed=st.integers(0, 999),
)
def test_filterpy_agrees_to_1e_9(options, adaptation, orders, still, seed):
    """Also where an input never moves at first, so that both wait."""
    rng = np.random.default_rng(seed)
    u, y = rng.standard_normal((350, orders.n_inputs)), simulate(S1, 350, seed)[1]
    y[2:] += u[:-2].sum(axis=1)
    u[:still], y[[200, 290]] = 0.0, np.nan
    made = config(orders, **options, **adaptation)
    assert_agree(RecursiveArmax(made), ReferenceArmax(made), u, y)


def test_the_engine_is_chosen_by_name():
    assert isinstance(make_estimator(config(), "numba"), RecursiveArmax)
    assert isinstance(make_estimator(config(), "filterpy"), ReferenceArmax)
    with pytest.raises(ConfigError, match="start_buffer must be 0"):
        make_estimator(config(start_buffer=100), "filterpy")
