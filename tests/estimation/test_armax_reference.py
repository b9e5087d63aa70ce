"""The kernel against filterpy's KalmanFilter."""

from __future__ import annotations

import numpy as np
import pytest
from drawn import examples
from estimation.armax_plants import S1, config, simulate
from hypothesis import given
from hypothesis import strategies as st

from yawid import ArmaxOrders, ConfigError, RecursiveArmax, make_estimator
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
ORDERS = st.builds(
    ArmaxOrders, st.integers(0, 3), st.integers(1, 3), st.integers(0, 3), st.integers(0, 2)
)


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
@given(options=OPTIONS, adaptation=ADAPTATIONS, orders=ORDERS, seed=st.integers(0, 999))
def test_filterpy_agrees_to_1e_9(options, adaptation, orders, seed):
    u, y = simulate(S1, 350, seed)
    y[[200, 290]] = np.nan
    made = config(orders, **options, **adaptation)
    assert_agree(RecursiveArmax(made), ReferenceArmax(made), u, y)


def test_two_inputs_agree():
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((400, 2)), rng.standard_normal(400)
    made = config(ArmaxOrders(1, (2, 1), 1, (0, 2)), method="rml", forgetting_factor=0.98)
    kernel, reference = RecursiveArmax(made), ReferenceArmax(made)
    assert_agree(kernel, reference, u, y)
    row = np.array([0.3, -0.2])
    predicted = kernel.predict(row)
    assert reference.update(row, 0.1).y_hat == pytest.approx(predicted, abs=1e-9)
    assert kernel.update(row, 0.1).y_hat == predicted


def test_a_channel_that_never_moves_keeps_both_waiting():
    u, y = simulate(S1, 300, 1)
    kernel, reference = RecursiveArmax(config()), ReferenceArmax(config())
    assert_agree(kernel, reference, np.zeros(300), y)
    assert_agree(kernel, reference, u, y)


def test_the_engine_is_chosen_by_name():
    assert isinstance(make_estimator(config(), "numba"), RecursiveArmax)
    assert isinstance(make_estimator(config(), "filterpy"), ReferenceArmax)
    with pytest.raises(ConfigError, match="start_buffer must be 0"):
        make_estimator(config(start_buffer=100), "filterpy")
