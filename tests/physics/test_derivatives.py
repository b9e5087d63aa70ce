"""Eq. 22-23 there and back: from the four numbers to theta by scipy, and back by ours."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.signal import cont2discrete

from yawid.config.estimator import ArmaxOrders
from yawid.physics.derivatives import (
    SERVO,
    summary_of,
    with_sigma,
    yaw_channel,
)
from yawid.physics.modes import discrete_residues, poles_of, residues_of
from yawid.quantities.table import YAW_CHANNEL

TWO = ArmaxOrders(na=2, nb=2, nc=0, nk=1)
THREE = ArmaxOrders(na=3, nb=3, nc=0, nk=1)


def theta_of(numerator, denominator, ts: float) -> np.ndarray:
    b, a, _ = cont2discrete((numerator, denominator), ts, method="zoh")
    return np.concatenate([a[1:], np.ravel(b)[1:]])


def eq23(K: float, T: float, omega: float, xi: float) -> tuple[np.ndarray, np.ndarray]:
    return K * omega**2 * np.array([T, 1.0]), np.array([1.0, 2.0 * xi * omega, omega**2])


GAINS = st.floats(0.05, 5.0)
LEADS = st.floats(0.05, 5.0)


@given(
    K=GAINS, T=LEADS, omega=st.floats(0.5, 30.0), xi=st.floats(0.02, 1.5), ts=st.floats(0.01, 0.2)
)
def test_the_four_numbers_come_back_from_theta(K, T, omega, xi, ts):
    damped = omega * math.sqrt(abs(1.0 - xi**2))
    assume(omega * ts >= 0.01)
    assume(damped * ts <= 3.0)
    assume(abs(xi - 1.0) > 1e-6)  # two poles on one spot
    assume(xi < 1.0 or omega * (xi + math.sqrt(xi * xi - 1)) * ts < 3.0)

    values, error = yaw_channel(theta_of(*eq23(K, T, omega, xi), ts)[None], TWO, ts)

    np.testing.assert_allclose(values[0, :4], [K, T, omega, xi], rtol=1e-9)
    assert error[0] == 0.0


def test_the_derivatives_are_those_of_eq_22():
    a_z, a_omega, a_beta, a_delta = 0.6, 0.9, 5.5, 1.4
    # r' = -a_omega r - a_beta beta + a_delta u, beta' = r - a_z beta.
    full = np.zeros((3, 3))
    full[:2] = [[-a_omega, -a_beta, a_delta], [1.0, -a_z, 0.0]]
    ts = 0.1
    step = expm(full * ts)
    pole = np.poly(step[:2, :2])
    b = np.array([step[0, 2], step[0, :2] @ [step[0, 2], step[1, 2]] + pole[1] * step[0, 2]])

    values, _ = yaw_channel(np.concatenate([pole[1:], b])[None], TWO, ts)

    np.testing.assert_allclose(values[0, 4:8], [a_z, a_omega, a_beta, a_delta], rtol=1e-9)
    found = dict(zip(YAW_CHANNEL, values[0], strict=True))
    assert found["T_theta_s"] == pytest.approx(1.0 / a_z)
    assert found["K"] == pytest.approx(a_delta * a_z / (a_omega * a_z + a_beta))


@given(
    K=GAINS,
    T=LEADS,
    omega=st.floats(1.5, 12.0),
    xi=st.floats(0.05, 0.8),
    tau=st.floats(0.02, 0.5),
)
def test_a_servo_lag_is_told_apart_and_divided_out(K, T, omega, xi, tau):
    ts = 0.04
    numerator, denominator = eq23(K, T, omega, xi)
    assume(abs(complex(1 / tau - xi * omega, omega * math.sqrt(1 - xi * xi))) > 0.5)

    theta = theta_of(numerator, np.polymul(denominator, [tau, 1.0]), ts)
    values, error = yaw_channel(theta[None], THREE, ts)

    np.testing.assert_allclose(values[0, :4], [K, T, omega, xi], rtol=1e-5)
    assert values[0, SERVO] == pytest.approx(tau, rel=1e-5)
    assert error[0] < 1e-5


def test_a_real_unstable_pair_has_no_natural_frequency():
    theta = theta_of([1.0, 2.0], np.polymul([1.0, 3.0], [1.0, -0.5]), 0.1)

    assert np.isnan(yaw_channel(theta[None], TWO, 0.1)[0]).any()
    assert summary_of(theta, 1e-10 * np.eye(4), TWO, 0.1) == {}


def orders_of(na: int, nb: int = 0, nk: int = 1) -> ArmaxOrders:
    return ArmaxOrders(na=na, nb=nb or na, nc=0, nk=nk)


def with_factor(theta: np.ndarray, zero: float, pole: float, gain: float = 1.0) -> np.ndarray:
    """A model of third order: the two polynomials times (z - zero) and (z - pole)."""
    a, b = np.polymul([1.0, *theta[:2]], [1.0, -pole]), gain * np.polymul(theta[2:], [1.0, -zero])
    return np.concatenate([a[1:], np.append(b, np.zeros(3 - len(b)))])


def of_yaw_angle(ts: float) -> np.ndarray:
    """psi = r / s sampled; its difference quotient has A of the rate and one more b."""
    numerator, denominator = eq23(*USUAL)
    b, a, _ = cont2discrete((numerator, np.append(denominator, 0.0)), ts, method="zoh")
    return np.concatenate([np.polydiv(a, [1.0, -1.0])[0][1:], np.ravel(b)[1:] / ts])


USUAL = (0.8, 0.9, 2.4, 0.25)
REAL = (0.8, 0.5, math.sqrt(24.0), 11.0 / (2.0 * math.sqrt(24.0)))
"""Two real yaw poles at 3 and 8 rad/s."""
THETA = theta_of(*eq23(*USUAL), 0.1)
NAN, SMALL = math.nan, {"rtol": 1e-7, "error": 1e-7}
SERVOS = np.polymul(np.polymul(eq23(*USUAL)[1], [0.1, 1.0]), [0.02, 1.0])
CHANNELS: dict[str, tuple[np.ndarray, ArmaxOrders, float, tuple[float, ...], dict[str, Any]]] = {
    **{
        f"unstable or with a zero outside: T {T}, xi {xi}": (
            theta_of(*eq23(0.8, T, 2.4, xi), 0.1), TWO, 0.1, (0.8, T, 2.4, xi, NAN), SMALL,
        )
        for T in (-0.7, 0.9) for xi in (-0.3, 0.25)
    },
    "a servo of 2 rad/s, slower than both real poles: 8 rad/s is removed, which costs least": (
        theta_of(eq23(*REAL)[0], np.polymul(eq23(*REAL)[1], [0.5, 1.0]), 0.04), THREE, 0.04,
        (NAN, NAN, math.sqrt(2.0 * 3.0), NAN, 1.0 / 8.0), {"rtol": 1e-7, "error": 1.0},
    ),
    "two real poles next to an alternating one": (
        with_factor(theta_of(*eq23(*REAL), 0.1), 0.0, -0.3, 1.3), THREE, 0.1,
        (NAN, NAN, *REAL[2:], NAN), {"rtol": 1e-9, "error": 1.0},
    ),
    "a servo among four poles": (
        theta_of(eq23(*USUAL)[0], SERVOS, 0.05), orders_of(4), 0.05, (*USUAL, 0.02),
        {"rtol": 1e-5, "error": 1e-5},
    ),
    "the yaw angle as output": (
        of_yaw_angle(0.1), orders_of(2, 3), 0.1, (*USUAL, NAN),
        {"rtol": 1e-7, "error": 1e-7, "mean_output": True},
    ),
    # The rudder comes later by whole samples: gain, lead and mode are those of the aircraft.
    **{
        f"a dead time of {nk}": (THETA, orders_of(2, 2, nk), 0.1, (*USUAL, NAN), SMALL)
        for nk in (1, 2, 4)
    },
    # As of orders too high by one without noise: A and B have a common factor.
    **{
        f"a pole with a zero on it at {pole}": (
            with_factor(THETA, pole, pole), THREE, 0.1, (*USUAL, NAN), SMALL,
        )
        for pole in (-0.05, -0.59, -1.2, 0.0)
    },
    # (z + 0.2) / (z + 0.3) is 1 at DC.
    "a pole that alternates takes nothing from the gain": (
        with_factor(theta_of(*eq23(0.31, 0.85, 5.0, 0.3), 0.05), -0.2, -0.3, 1.3 / 1.2), THREE,
        0.05, (0.31, 0.85, 5.0, 0.3, NAN), {"rtol": 0.05, "error": 0.05, "least": 1e-4},
    ),
}  # fmt: skip
"""theta, orders, Ts, K, T, omega, xi and the servo's lag; NaN is unknown, or not compared."""


@pytest.mark.parametrize("name", CHANNELS)
def test_the_yaw_channel_is_found_next_to_servos_dead_times_and_alternating_poles(name: str):
    theta, orders, ts, expected, within = CHANNELS[name]
    mean_output = within.get("mean_output", False)
    values, error = yaw_channel(theta[None], orders, ts, mean_output=mean_output)

    known = np.isfinite(expected)
    found = values[0, [0, 1, 2, 3, SERVO]]
    np.testing.assert_allclose(found[known], np.array(expected)[known], rtol=within["rtol"])
    assert np.isfinite(found[-1]) == known[-1]
    assert within.get("least", 0.0) <= error[0] <= within["error"]


def test_sigma_is_the_scatter():
    ts, rng = 0.1, np.random.default_rng(8)
    theta = theta_of(*eq23(0.8, 0.9, 2.4, 0.25), ts)
    root = 2e-4 * rng.standard_normal((4, 4))
    covariance = root @ root.T
    scattered = rng.multivariate_normal(theta, covariance, size=3000)

    [(values, std)], _ = with_sigma(theta[None], covariance[None], TWO, ts)
    spread, _ = yaw_channel(scattered, TWO, ts)

    np.testing.assert_allclose(std[:8], spread[:, :8].std(axis=0), rtol=0.06)
    np.testing.assert_allclose(values[:8], spread[:, :8].mean(axis=0), rtol=0.02)


@pytest.mark.parametrize("theta", [np.zeros(6), np.array([-1.2, 0.7, -0.1, 0.1, 0.0, -0.09])])
def test_what_is_no_yaw_channel_is_left_out(theta):
    found = summary_of(theta, 1e-8 * np.eye(6), THREE, 0.1)

    assert found == {} or all(math.isfinite(v["value"]) for v in found.values())
    assert summary_of(np.zeros(6), np.eye(6), THREE, 0.1) == {}


@pytest.mark.parametrize("na", [3, 6])
def test_rows_of_a_block_are_those_of_single_calls_to_the_bit(na):
    """Of a block so long that NumPy works in place on its temporaries."""
    rng, orders = np.random.default_rng(9), ArmaxOrders(na=na, nb=na, nc=0, nk=1)
    thetas = 0.4 * rng.standard_normal((3000, 2 * na))
    covariance = np.broadcast_to(1e-6 * np.eye(2 * na), (3000, 2 * na, 2 * na))
    whole, plain = with_sigma(thetas, covariance, orders, 0.1), yaw_channel(thetas, orders, 0.1)
    poles = _poles_and_residues(thetas, orders)

    for row in range(0, 3000, 30):
        one = slice(row, row + 1)
        for found, joined in (
            (_poles_and_residues(thetas[one], orders), poles),
            (with_sigma(thetas[one], covariance[one], orders, 0.1), whole),
            (yaw_channel(thetas[one], orders, 0.1), plain),
        ):
            for column, columns in zip(found, joined, strict=True):
                np.testing.assert_array_equal(column[0], columns[row])


def _poles_and_residues(thetas, orders):
    poles = poles_of(thetas[:, : orders.na], 0.1)
    discrete = discrete_residues(thetas, poles, orders)
    return poles.z, poles.s, discrete, residues_of(discrete, poles, 0.1)
