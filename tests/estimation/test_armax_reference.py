"""The kernel against filterpy's KalmanFilter."""

from __future__ import annotations

import numpy as np
import pytest
from drawn import examples
from estimation.armax_plants import S1, config, simulate
from estimation.test_armax_algebra import ORDERS
from hypothesis import given
from hypothesis import strategies as st

from yawid import ConfigError, RecursiveArmax, make_estimator
from yawid.estimation.reference import ReferenceArmax

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
