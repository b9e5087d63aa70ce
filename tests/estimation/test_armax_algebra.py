"""The recursion against its batch twins: weighted least squares over the regressors it saw."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.armax_plants import S1, config, simulate
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.special import gammaincc

from yawid import ArmaxOrders, RecursiveArmax
from yawid.estimation.kernel.recursion import (
    FAST_FALL,
    MOST_RISE,
    PSI_FROM,
    SETTLING,
    SLACK,
    SLOW_RISE,
)

ORDERS = st.builds(
    lambda na, inputs, nc: ArmaxOrders(
        na, tuple(nb for nb, _ in inputs), nc, tuple(nk for _, nk in inputs)
    ),
    st.integers(0, 3),
    st.lists(st.tuples(st.integers(1, 3), st.integers(0, 3)), min_size=1, max_size=2),
    st.integers(0, 3),
)


def regressors(u, y, residual, orders, bias):
    """phi(k) (n, p) from what went in and the residuals that came out; u (n, inputs)."""

    def lagged(x, lag):
        return np.concatenate([np.zeros(lag), x[: len(x) - lag]])

    columns = [-lagged(y, i) for i in range(1, orders.na + 1)]
    for j, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
        columns += [lagged(u[:, j], i) for i in range(nk, nk + nb)]
    columns += [lagged(residual, i) for i in range(1, orders.nc + 1)]
    return np.column_stack([*columns, *([np.ones(len(y))] if bias else [])])


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


@given(
    orders=ORDERS,
    bias=st.booleans(),
    forgetting=st.sampled_from([1.0, 0.99, 0.95]),
    window=st.sampled_from([0, 50]),
    seed=st.integers(0, 10_000),
)
def test_theta_is_weighted_least_squares_over_the_regressors_seen(
    orders, bias, forgetting, window, seed
):
    rng = np.random.default_rng(seed)
    n, inputs = 250, orders.n_inputs
    u = rng.standard_normal((n, inputs)) * 0.3
    y = lfilter([0.0, 1.0], [1.0, -0.7], u.sum(axis=1)) + rng.standard_normal(n)
    made = config(orders, bias=bias, forgetting_factor=forgetting, scale_window=window)
    armax = RecursiveArmax(made)
    residual = np.array([armax.update(u[k], y[k]).residual for k in range(n)])
    if window:  # inside the window residuals stay unseen: take them from a second estimator
        factors = 2.0 ** -np.floor(np.log2(np.column_stack([y, u])[:window].std(axis=0)) + 0.5)
        plain = RecursiveArmax(
            config(orders, bias=bias, forgetting_factor=forgetting, scale_window=0)
        )
        scaled_y, scaled_u = y * factors[0], u * factors[1:]
    else:
        factors, plain = np.ones(1 + inputs), armax
        scaled_y, scaled_u = y, u
    if window:
        residual = np.array([plain.update(scaled_u[k], scaled_y[k]).residual for k in range(n)])
    depth = max([orders.na, *(nb + nk - 1 for nb, nk in zip(orders.nb, orders.nk, strict=True))])
    first = depth + orders.nc
    residual[:first] = 0.0
    phi = regressors(scaled_u, scaled_y, residual, orders, bias)
    R, f = np.eye(made.n_theta) / made.P0, np.zeros(made.n_theta)
    lam, floor = made.forgetting_start, Floor(made.n_theta, made.P0, 0.1, forgetting)
    for k in range(first, n):
        R, f = lam * (R + np.outer(phi[k], phi[k]) / lam), lam * (f + phi[k] * scaled_y[k] / lam)
        if forgetting < 1.0:
            floor.add(R, f, np.linalg.solve(R, f), k - first)
        lam = made.forgetting_rate * lam + (1.0 - made.forgetting_rate) * forgetting
    assume(np.linalg.cond(R) < 1e10)
    units = [np.ones(orders.na)]
    units += [np.full(nb, g / factors[0]) for nb, g in zip(orders.nb, factors[1:], strict=True)]
    units = np.concatenate([*units, np.ones(orders.nc), np.full(int(bias), 1.0 / factors[0])])
    miss = armax.theta / units - np.linalg.solve(R, f)
    assert np.sqrt(miss @ R @ miss) < 1e-7
    np.testing.assert_allclose(
        armax.P / np.outer(units, units) / factors[0] ** 2, np.linalg.inv(R), rtol=1e-6, atol=1e-12
    )


@given(na=st.integers(0, 3), nb=st.integers(1, 3), nk=st.integers(0, 3), seed=st.integers(0, 999))
def test_with_nothing_added_it_is_batch_arx(na, nb, nk, seed):
    orders = ArmaxOrders(na, nb, 0, nk)
    u, y = simulate(((-0.8, 0.15), (1.0, 0.5), ()), 300, seed)
    plain = {"forgetting_start": 1.0, "scale_window": 0, "P0": 1e8, "bias": False}
    armax = RecursiveArmax(config(orders, **plain))
    armax.run(u, y)
    phi = regressors(u.reshape(-1, 1), y, y, orders, bias=False)[max(na, nb + nk - 1) :]
    batch = np.linalg.lstsq(phi, y[len(y) - len(phi) :], rcond=None)[0]
    np.testing.assert_allclose(armax.theta, batch, atol=1e-6)
    residuals = y[len(y) - len(phi) :] - phi @ batch
    sigma = np.sqrt(residuals @ residuals / (len(phi) - orders.n_theta))
    expected = sigma * np.sqrt(np.diag(np.linalg.inv(phi.T @ phi)))
    lean = RecursiveArmax(config(orders, residual_lags=0, **plain))
    lean.run(u, y)
    np.testing.assert_allclose(lean.theta_std, expected, rtol=1e-4)


CORNERS = {
    "AR": (ArmaxOrders(2, (), 0, ()), (-0.8, 0.15), (), ()),
    "MA": (ArmaxOrders(0, (), 2, ()), (), (), (0.5, 0.1)),
    "ARMA": (ArmaxOrders(2, (), 1, ()), (-0.8, 0.15), (), (0.4,)),
    "ARX": (ArmaxOrders(2, 2, 0, 1), (-0.8, 0.15), (1.0, 0.5), ()),
    "FIR": (ArmaxOrders(0, 3, 0, 1), (), (1.0, 0.5, -0.3), ()),
}


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("name", CORNERS)
def test_the_corner_cases_of_the_model_are_identified(name, method):
    orders, *plant = CORNERS[name]
    u, y = simulate(tuple(plant), 20_000, 3)
    inputs = u if orders.n_inputs else None
    armax = RecursiveArmax(config(orders, method=method, bias=False))
    last = armax.run(inputs, y, keep="last")
    expected = np.concatenate([np.array(part) for part in plant])
    np.testing.assert_array_less(np.abs(last.theta[0] - expected), 4.0 * last.theta_std[0])


def test_dead_time_bias_and_a_second_input_are_identified():
    rng = np.random.default_rng(4)
    u = rng.standard_normal((20_000, 2))
    drive = 1.0 * np.roll(u[:, 0], 3) + 0.5 * np.roll(u[:, 1], 1) - 0.2 * np.roll(u[:, 1], 2)
    y = lfilter([1.0], [1.0, -0.6], drive + 0.7 + 0.1 * rng.standard_normal(20_000))
    armax = RecursiveArmax(config(ArmaxOrders(1, (1, 2), 0, (3, 1))))
    last = armax.run(u, y, keep="last")
    expected = np.array([-0.6, 1.0, 0.5, -0.2, 0.7])
    np.testing.assert_array_less(np.abs(last.theta[0] - expected), 4.0 * last.theta_std[0])


def test_with_nk_zero_the_prediction_uses_the_input_of_the_same_instant():
    rng = np.random.default_rng(5)
    u = rng.standard_normal(2000)
    y = 2.0 * u + 1e-3 * rng.standard_normal(2000)
    armax = RecursiveArmax(config(ArmaxOrders(0, 1, 0, 0), bias=False))
    armax.run(u, y)
    assert armax.predict(3.0) == pytest.approx(6.0, abs=1e-2)
    with pytest.raises(ValueError, match="infinite"):
        armax.predict(np.inf)


def filtered(phi_signals, theta, forgetting, orders, end):
    """psi(k) (n, p): the signals as they enter phi, each through 1/C of the theta before."""
    n, signals = phi_signals.shape
    out, first = np.zeros((n, signals)), orders.na + sum(orders.nb)
    counts = [(0, orders.na), *zip(orders.nk, orders.nb, strict=True), (0, orders.nc), (0, 1)]
    psi = np.zeros((n, sum(count for _, count in counts)))
    for k in range(n):
        drawn_in = 1.0 - (end - forgetting[k])
        out[k] = phi_signals[k]
        for i in range(1, min(orders.nc, k) + 1):
            out[k] -= drawn_in**i * theta[k, first + i - 1] * out[k - i]
        lags = [(j, nk + i) for j, (nk, count) in enumerate(counts) for i in range(count)]
        psi[k] = [out[k - lag, j] if k >= lag else 0.0 for j, lag in lags]
    return psi


@given(orders=ORDERS, forgetting=st.sampled_from([1.0, 0.99]), seed=st.integers(0, 10_000))
def test_theta_of_rml_is_weighted_least_squares_over_the_filtered_regressors(
    orders, forgetting, seed
):
    """The rows are psi(k), their targets e(k) + psi(k)' theta(k-1): Ljung and Soderstrom's step.

    Where a step was halved to keep C(q) stable, e(k) counts by the share of it that was taken.
    """
    rng = np.random.default_rng(seed)
    n = 400
    u, noise = rng.standard_normal((n, orders.n_inputs)), rng.standard_normal(n)
    y = lfilter([0.0, 1.0], [1.0, -0.7], u.sum(axis=1)) + lfilter([1.0, 0.4], [1.0], noise)
    made = config(orders, method="rml", forgetting_factor=forgetting, scale_window=0)
    armax = RecursiveArmax(made)
    theta, lam, innovation, residual, halved = [], [], [], [], [0]
    for k in range(n):
        theta.append(armax.theta.copy())
        lam.append(armax.forgetting_factor)
        came = armax.update(u[k], y[k])
        innovation.append(came.innovation)
        residual.append(came.residual)
        halved.append(armax.halved)
    theta.append(armax.theta.copy())
    depth = max([orders.na, *(nb + nk - 1 for nb, nk in zip(orders.nb, orders.nk, strict=True))])
    first = depth + orders.nc
    residual = np.nan_to_num(residual)
    entering = [-np.roll(y, 1), *u.T, np.roll(residual, 1), np.ones(n)]
    entering[0][0] = entering[-2][0] = 0.0
    phi = regressors(u, y, residual, orders, bias=True)
    psi = filtered(np.column_stack(entering), np.array(theta), lam, orders, forgetting)
    R, f = np.eye(made.n_theta) / made.P0, np.zeros(made.n_theta)
    floor = Floor(made.n_theta, made.P0, 0.1, forgetting)
    for k in range(first, n):
        row = phi[k] if k - first < PSI_FROM else psi[k]
        R, f = lam[k] * R + np.outer(row, row), lam[k] * f
        taken = 1.0
        if halved[k + 1] > halved[k]:
            whole = np.linalg.solve(R, row) * innovation[k]
            taken = (theta[k + 1] - theta[k]) @ whole / (whole @ whole)
            assert -1e-6 < taken < 0.5 + 1e-6
        f += row * (taken * innovation[k] + row @ theta[k])
        if forgetting < 1.0:
            floor.add(R, f, np.linalg.solve(R, f), k - first)
    assume(np.linalg.cond(R) < 1e10)
    miss = armax.theta - np.linalg.solve(R, f)
    assert np.sqrt(miss @ R @ miss) < 1e-7
    np.testing.assert_allclose(armax.P, np.linalg.inv(R), rtol=1e-6, atol=1e-12)


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
