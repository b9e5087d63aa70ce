"""What every estimator promises, whatever it computes with, and what a bank of them remembers."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from estimation.armax_plants import S1, config, simulate
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter
from sinks.sink_blocks import SAMPLE_TIME_S, make_samples

from yawid import ArmaxOrders, ConfigError, Status, make_estimator
from yawid.blocks import EstimateBlock, SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.bank import HISTORY, MEMORIES, Bank
from yawid.estimation.polynomials import lag_depth

TWO, NONE = ArmaxOrders(2, (2, 1), 1, (1, 0)), ArmaxOrders(2, (), 1, ())
VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "forgetting with a floor": {"forgetting_factor": 0.98},
    "forgetting without a floor": {"forgetting_factor": 0.99, "information_floor": 0.0},
    "start fit": {"start_buffer": 120},
    "no bias": {"bias": False, "scale_window": 0},
    "no lags": {"residual_lags": 0},
    "two inputs": {"orders": TWO},
    "no input": {"orders": NONE},
}
IN_THE_GATE = "two inputs"
"""The variant of the reference estimator, which is slow, that is not in the long list alone."""
KINDS = [
    pytest.param(
        engine,
        {"method": method, **options},
        id=f"{engine} {method}, {name}",
        marks=() if engine == "numba" or name == IN_THE_GATE else pytest.mark.long,
    )
    for engine in ("numba", "filterpy")
    for method in ("els", "rml")
    for name, options in VARIANTS.items()
    if engine == "numba" or "start_buffer" not in options
]
SNAPSHOT = ("theta", "theta_std", "covariance", "y_hat", "innovation", "residual", "noise_std")
SAMPLES = 300


def samples(estimator: Any, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """u (300, inputs) and y (300,) of a plant, with a hole in each once the window is full."""
    orders = estimator.config.orders
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((SAMPLES, orders.n_inputs)), rng.standard_normal(SAMPLES)
    y = lfilter([0.0, 1.0], [1.0, -0.7], u.sum(axis=1)) + lfilter([1.0, 0.4], [1.0], e)
    y[170] = math.nan
    u[200:201] = math.nan
    return u, y


def many_updates_are_one_run(estimator: Any) -> None:
    """Each of their results is a copy; neither they nor the run modify the samples."""
    (u, y), one = samples(estimator), make_like(estimator)
    block = estimator.run(u, y, covariance=True)
    predicted, came = [], []
    for k in range(SAMPLES):
        predicted.append(one.predict(u[k]))
        came.append(one.update(u[k], y[k]))
    for name in (*SNAPSHOT, "status"):
        rows = [getattr(each, name) for each in came]
        np.testing.assert_array_equal(rows, getattr(block, name), err_msg=name)
    known = np.isfinite(block.y_hat)
    np.testing.assert_array_equal(np.array(predicted)[known], block.y_hat[known])
    np.testing.assert_allclose((block.y_hat + block.innovation)[known], y[known], rtol=1e-12)
    last = make_like(estimator).run(u, y, keep="last")
    np.testing.assert_array_equal(last.theta, block.theta[-1:])
    for left, right in zip((u, y), samples(estimator), strict=True):
        np.testing.assert_array_equal(left, right)


def a_held_sample_changes_nothing_and_the_lags_fill_again(estimator: Any) -> None:
    u, y = samples(estimator)
    estimator.run(u, y)
    theta, P, updates, held = estimator.theta, estimator.P, estimator.updates, estimator.held
    assert updates > 0
    assert math.isnan(estimator.update(u[0], math.nan).y_hat)
    estimator.update(np.full(u.shape[1], math.nan), y[0] if u.shape[1] else math.nan)
    lags = lag_depth(estimator.config.orders) + estimator.config.orders.nc
    for k in range(lags):
        assert estimator.update(u[k], y[k]).status == Status.HELD
    np.testing.assert_array_equal(estimator.theta, theta)
    np.testing.assert_array_equal(estimator.P, P)
    assert estimator.update(u[lags], y[lags]).status == Status.TRACKING
    assert (estimator.updates, estimator.held) == (updates + 1, held + 2 + lags)


def what_takes_no_sample_changes_nothing(estimator: Any) -> None:
    """A prediction, a block without rows, samples that do not fit, which are refused in words."""
    (u, y), asked = samples(estimator), make_like(estimator)
    n = estimator.config.orders.n_inputs
    infinite = np.where(np.arange(4) == 2, math.inf, 0.0)
    wrong = (
        (rf"u must have shape \(3, {n}\)", lambda: asked.run(np.zeros((3, n + 1)), np.zeros(3))),
        (rf"u must have shape \(3, {n}\)", lambda: asked.run(np.zeros((4, n)), np.zeros(3))),
        ("y must have shape", lambda: asked.run(np.zeros((3, n)), np.zeros((3, 1)))),
        ("keep", lambda: asked.run(np.zeros((3, n)), np.zeros(3), keep="some")),
        ("infinite", lambda: asked.run(np.zeros((4, n)), infinite)),
        (rf"u must have shape \(1, {n}\)", lambda: asked.update(np.zeros(n + 1), 0.0)),
        ("infinite", lambda: asked.update(np.zeros(n), math.inf)),
        *[("infinite", lambda: asked.predict(np.full(n, math.inf)))] * (n == 2),
    )
    for a, b in pairwise([0, 40, 150, 171, 202, SAMPLES]):
        asked.predict(np.zeros(n))
        assert asked.run(u[:0], y[:0]).theta.shape == (0, estimator.config.n_theta)
        for words, refused in wrong:
            with pytest.raises(ConfigError, match=words):
                refused()
        rows = [one.run(u[a:b], y[a:b], covariance=True).rows for one in (asked, estimator)]
        np.testing.assert_array_equal(*rows)
    assert asked.to_bytes() == estimator.to_bytes()


def make_like(estimator: Any) -> Any:
    """A new one of the same kind and configuration."""
    return type(estimator)(estimator.config)


CHECKS = (
    many_updates_are_one_run,
    a_held_sample_changes_nothing_and_the_lags_fill_again,
    what_takes_no_sample_changes_nothing,
)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize(("engine", "options"), KINDS)
def test_every_estimator(engine: str, options: dict[str, Any], check: Any) -> None:
    check(make_estimator(config(**options), engine))


@given(
    kind=st.sampled_from([each.values for each in KINDS if not each.marks]),
    seed=st.integers(0, 1000),
    cuts=st.lists(st.integers(0, SAMPLES), max_size=8),
)
def test_neither_cuts_nor_copies_in_between_change_a_bit(kind, seed, cuts):
    engine, options = kind
    whole, pieces = (make_estimator(config(**options), engine) for _ in range(2))
    u, y = samples(whole, seed)
    rows = []
    for a, b in pairwise([0, *sorted(cuts), SAMPLES]):
        rows.append(pieces.run(u[a:b], y[a:b], covariance=True).rows)
        pieces = type(pieces).from_bytes(pieces.to_bytes())
    np.testing.assert_array_equal(np.concatenate(rows), whole.run(u, y, covariance=True).rows)
    assert pieces.config == whole.config
    assert pieces.to_bytes() == whole.to_bytes()


N = 1000
CONFIG = RunConfig(orders=(2, 2, 2, 1), forgetting=0.98)
KEPT = math.ceil(MEMORIES / (1.0 - 0.98))


@cache
def flown() -> tuple[SampleBlock, dict[str, EstimateBlock]]:
    """Samples, and what the methods make of all of them at once."""
    u, y = simulate(S1, N, 0)
    none = np.zeros(N, np.int64)
    samples = make_samples(N, 1, np.random.default_rng(0))
    samples = replace(samples, u=u.reshape(-1, 1), y=y, held=none, epoch=none)
    return samples, Bank(CONFIG, SAMPLE_TIME_S).run(samples)


@given(cuts=st.lists(st.integers(1, N - 1), max_size=30), newest=st.sampled_from([3, 40, HISTORY]))
def test_a_bank_that_forgets_keeps_three_memories_however_the_samples_came(cuts, newest) -> None:
    (samples, whole), bank = flown(), Bank(CONFIG, SAMPLE_TIME_S)
    for first, stop in pairwise(sorted({0, *cuts, N})):
        bank.run(samples.select(np.arange(first, stop)))
    history, rows = bank.history(newest), slice(N - min(newest, KEPT), None)
    for name in ("u", "y", "roll", "turn_rate", "airspeed", "aileron", "mode"):
        np.testing.assert_array_equal(getattr(history, name), getattr(samples, name)[rows])
    for method, y_hat in history.y_hat.items():
        np.testing.assert_array_equal(y_hat, whole[method].y_hat[rows])
