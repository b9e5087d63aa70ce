"""What every estimator promises, whatever it computes with: one list of checks over all of them."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from estimation.armax_plants import config, joined
from scipy.signal import lfilter

from yawid import ArmaxOrders, ConfigError, Status, make_estimator

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


def made(engine: str, options: dict[str, Any]) -> Any:
    return make_estimator(config(**options), engine)


def samples(estimator: Any, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """u (300, inputs) and y (300,) of a plant, with a hole in each once the window is full."""
    orders = estimator.config.orders
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((SAMPLES, orders.n_inputs)), rng.standard_normal(SAMPLES)
    y = lfilter([0.0, 1.0], [1.0, -0.7], u.sum(axis=1)) + lfilter([1.0, 0.4], [1.0], e)
    y[170] = math.nan
    u[200:201] = math.nan
    return u, y


def state(estimator: Any) -> list[Any]:
    """What can be seen of it from outside."""
    seen = [estimator.theta, estimator.P, estimator.covariance, estimator.updates, estimator.held]
    return [*seen, estimator.status, estimator.noise_std, estimator.whiteness_p]


def assert_same(one: Any, other: Any) -> None:
    for left, right in zip(state(one), state(other), strict=True):
        np.testing.assert_array_equal(left, right)


def modifies_no_input(estimator: Any) -> None:
    u, y = samples(estimator)
    u.setflags(write=False)
    y.setflags(write=False)
    estimator.run(u, y, covariance=True)
    estimator.update(u[0], y[0])
    estimator.predict(u[0])
    fresh = samples(estimator)
    np.testing.assert_array_equal(u, fresh[0])
    np.testing.assert_array_equal(y, fresh[1])


def does_not_depend_on_the_cuts(estimator: Any) -> None:
    u, y = samples(estimator)
    pieces = make_like(estimator)
    whole = estimator.run(u, y, covariance=True)
    edges = [0, 1, 90, 91, 160, 171, 250, SAMPLES]
    parts = [pieces.run(u[a:b], y[a:b], covariance=True) for a, b in pairwise(edges)]
    np.testing.assert_array_equal(joined(parts).rows, whole.rows)
    assert_same(pieces, estimator)


def many_updates_are_one_run(estimator: Any) -> None:
    u, y = samples(estimator)
    one = make_like(estimator)
    block = estimator.run(u, y, covariance=True)
    for k in range(SAMPLES):
        predicted = one.predict(u[k])
        came = one.update(u[k], y[k])
        for name in (*SNAPSHOT, "status"):
            row = getattr(block, name)[k]
            np.testing.assert_array_equal(getattr(came, name), row, err_msg=f"{name} at {k}")
        if np.isfinite(came.y_hat):
            assert predicted == came.y_hat
            assert came.y_hat + came.innovation == pytest.approx(y[k], rel=1e-12, abs=1e-12)


def keeps_the_last_row(estimator: Any) -> None:
    u, y = samples(estimator)
    every = make_like(estimator).run(u, y)
    last = estimator.run(u, y, keep="last")
    np.testing.assert_array_equal(last.rows, every.rows[-1:])


def a_nan_holds(estimator: Any) -> None:
    u, y = samples(estimator)
    estimator.run(u, y)
    theta, P, updates, held = estimator.theta, estimator.P, estimator.updates, estimator.held
    assert updates > 0
    came = estimator.update(u[0], math.nan)
    assert came.status == Status.HELD
    assert math.isnan(came.y_hat)
    np.testing.assert_array_equal(estimator.theta, theta)
    np.testing.assert_array_equal(estimator.P, P)
    assert (estimator.updates, estimator.held) == (updates, held + 1)
    estimator.update(u[0], y[0])  # the lags refill
    np.testing.assert_array_equal(estimator.theta, theta)


def resumes_from_a_copy(estimator: Any) -> None:
    u, y = samples(estimator)
    for cut in (0, 50, 110, 180):
        first = make_like(estimator)
        first.run(u[:cut], y[:cut])
        other = type(estimator).from_bytes(first.to_bytes())
        assert other.config == first.config
        rows = [armax.run(u[cut:], y[cut:], covariance=True).rows for armax in (first, other)]
        np.testing.assert_array_equal(*rows)
        assert other.to_bytes() == first.to_bytes()


def a_prediction_changes_nothing(estimator: Any) -> None:
    u, y = samples(estimator)
    asked = make_like(estimator)
    for a, b in pairwise([0, 40, 150, 171, 202, SAMPLES]):
        asked.predict(u[0])
        rows = [one.run(u[a:b], y[a:b], covariance=True).rows for one in (asked, estimator)]
        np.testing.assert_array_equal(*rows)
    assert_same(asked, estimator)


def an_empty_block_changes_nothing(estimator: Any) -> None:
    u, y = samples(estimator)
    estimator.run(u[:250], y[:250])
    before = state(estimator)
    block = estimator.run(u[:0], y[:0], covariance=True)
    assert len(block) == 0
    assert block.theta.shape == (0, estimator.config.n_theta)
    for left, right in zip(before, state(estimator), strict=True):
        np.testing.assert_array_equal(left, right)


def refuses_what_does_not_fit(estimator: Any) -> None:
    u, y = samples(estimator)
    estimator.run(u, y)
    before = state(estimator)
    n = estimator.config.orders.n_inputs
    infinite = np.where(np.arange(4) == 2, math.inf, 0.0)
    for wrong in (
        lambda: estimator.run(np.zeros((3, n + 1)), np.zeros(3)),
        lambda: estimator.run(np.zeros((4, n)), np.zeros(3)),
        lambda: estimator.run(np.zeros((3, n)), np.zeros((3, 1))),
        lambda: estimator.run(np.zeros((3, n)), np.zeros(3), keep="some"),
        lambda: estimator.run(np.zeros((4, n)), infinite),
        lambda: estimator.update(np.zeros(n + 1), 0.0),
        lambda: estimator.update(np.zeros(n), math.inf),
    ):
        with pytest.raises(ConfigError):
            wrong()
    for left, right in zip(before, state(estimator), strict=True):
        np.testing.assert_array_equal(left, right)


def make_like(estimator: Any) -> Any:
    """A new one of the same kind and configuration."""
    return type(estimator)(estimator.config)


CHECKS = (
    modifies_no_input,
    does_not_depend_on_the_cuts,
    many_updates_are_one_run,
    keeps_the_last_row,
    a_nan_holds,
    resumes_from_a_copy,
    a_prediction_changes_nothing,
    an_empty_block_changes_nothing,
    refuses_what_does_not_fit,
)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize(("engine", "options"), KINDS)
def test_every_estimator(engine: str, options: dict[str, Any], check: Any) -> None:
    check(made(engine, options))
