"""Eq. 22-23 there and back: from the four numbers to theta by scipy, and back by ours."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from physics.test_modes import sampled
from scipy.linalg import expm
from scipy.signal import cont2discrete

from yawid import EstimatorConfig, RecursiveArmax
from yawid.config.estimator import ArmaxOrders
from yawid.physics.derivatives import SERVO, summary_of, with_sigma, yaw_channel
from yawid.plant.yaw import YawPlant
from yawid.quantities.table import YAW_CHANNEL

TWO = ArmaxOrders(na=2, nb=2, nc=0, nk=1)
THREE = ArmaxOrders(na=3, nb=3, nc=0, nk=1)


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

    values, error = yaw_channel(sampled(*eq23(K, T, omega, xi), ts)[None], TWO, ts)

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

    theta = sampled(numerator, np.polymul(denominator, [tau, 1.0]), ts)
    values, error = yaw_channel(theta[None], THREE, ts)

    np.testing.assert_allclose(values[0, :4], [K, T, omega, xi], rtol=1e-5)
    assert values[0, SERVO] == pytest.approx(tau, rel=1e-5)
    assert error[0] < 1e-5


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
THETA = sampled(*eq23(*USUAL), 0.1)
NAN, SMALL = math.nan, {"rtol": 1e-7, "error": 1e-7}
SERVOS = np.polymul(np.polymul(eq23(*USUAL)[1], [0.1, 1.0]), [0.02, 1.0])
CHANNELS: dict[str, tuple[np.ndarray, ArmaxOrders, float, tuple[float, ...], dict[str, Any]]] = {
    **{
        f"unstable or with a zero outside: T {T}, xi {xi}": (
            sampled(*eq23(0.8, T, 2.4, xi), 0.1), TWO, 0.1, (0.8, T, 2.4, xi, NAN), SMALL,
        )
        for T in (-0.7, 0.9) for xi in (-0.3, 0.25)
    },
    "a servo of 2 rad/s, slower than both real poles: 8 rad/s is removed, which costs least": (
        sampled(eq23(*REAL)[0], np.polymul(eq23(*REAL)[1], [0.5, 1.0]), 0.04), THREE, 0.04,
        (NAN, NAN, math.sqrt(2.0 * 3.0), NAN, 1.0 / 8.0), {"rtol": 1e-7, "error": 1.0},
    ),
    "two real poles next to an alternating one": (
        with_factor(sampled(*eq23(*REAL), 0.1), 0.0, -0.3, 1.3), THREE, 0.1,
        (NAN, NAN, *REAL[2:], NAN), {"rtol": 1e-9, "error": 1.0},
    ),
    "a servo among four poles": (
        sampled(eq23(*USUAL)[0], SERVOS, 0.05), orders_of(4), 0.05, (*USUAL, 0.02),
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
        with_factor(sampled(*eq23(0.31, 0.85, 5.0, 0.3), 0.05), -0.2, -0.3, 1.3 / 1.2), THREE,
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
    theta = sampled(*eq23(0.8, 0.9, 2.4, 0.25), ts)
    root = 2e-4 * rng.standard_normal((4, 4))
    covariance = root @ root.T
    scattered = rng.multivariate_normal(theta, covariance, size=3000)

    [(values, std)], _ = with_sigma(theta[None], covariance[None], TWO, ts)
    spread, _ = yaw_channel(scattered, TWO, ts)

    np.testing.assert_allclose(std[:8], spread[:, :8].std(axis=0), rtol=0.06)
    np.testing.assert_allclose(values[:8], spread[:, :8].mean(axis=0), rtol=0.02)


@pytest.mark.parametrize(
    ("theta", "is_left_out"),
    [
        pytest.param(np.zeros(6), True, id="nothing"),
        pytest.param(np.array([-1.2, 0.7, -0.1, 0.1, 0.0, -0.09]), False, id="a zero in b"),
        pytest.param(
            sampled([1.0, 2.0], np.polymul([1.0, 3.0], [1.0, -0.5]), 0.1), True,
            id="a real unstable pair",
        ),
    ],
)  # fmt: skip
def test_what_is_no_yaw_channel_is_left_out_and_all_else_is_finite(theta, is_left_out):
    """A real pair of which one pole is unstable has no natural frequency."""
    found = summary_of(theta, 1e-10 * np.eye(len(theta)), THREE if len(theta) == 6 else TWO, 0.1)

    assert (found == {}) == is_left_out
    assert all(math.isfinite(each["value"]) for each in found.values())


PLANT = YawPlant(K=1.0, T_theta_s=0.8, omega_beta=2.5, xi_beta=0.2)
TRUTH = np.array([PLANT.K, PLANT.T_theta_s, PLANT.omega_beta, PLANT.xi_beta])


def off(u: np.ndarray, y: np.ndarray, ts: float, nb: int, method: str) -> np.ndarray:
    """Relative errors (4,) of K, T, wn and zeta as the estimator finds them."""
    orders = ArmaxOrders(2, nb, 2, 1)
    armax = RecursiveArmax(EstimatorConfig(orders=orders, sample_time_s=ts, method=method))
    armax.run(u, y, keep="last")
    values, _ = yaw_channel(armax.theta[None], orders, ts)
    return np.abs(values[0, :4] / TRUTH - 1.0)


def flown(seed: int, ts: float, count: int = 600) -> tuple[np.ndarray, np.ndarray]:
    """The rudder's mean over each [t_k, t_k+1) and the rate at t_k; it switches in between."""
    rng, fine = np.random.default_rng(seed), 50
    switches = np.sort(rng.integers(5 * fine, (count - 10) * fine, count // 10))
    levels = np.append(0.0, rng.uniform(-0.5, 0.5, len(switches)))
    u = levels[np.searchsorted(switches, np.arange(count * fine), side="right")]
    y = PLANT.linear().simulate(u, ts / fine)[::fine, 0]
    return u.reshape(-1, fine).mean(axis=1), y


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("seed", range(3))
def test_an_input_that_switches_on_the_grid_gives_all_four_numbers_to_1e_6(method, seed):
    """Without noise; what is left, 6e-7 of T, is the prior P0 = 100."""
    u = np.repeat(np.random.default_rng(seed).choice([-0.2, 0.2], 300), 4)
    y = PLANT.linear().simulate(u, 0.1)[:, 0]
    assert off(u, y, 0.1, 2, method).max() < 1e-6


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("wn_ts", [0.05, 0.125, 0.25])
def test_an_input_that_switches_anywhere_is_well_within_1_percent_of_wn_and_5_of_k(method, wn_ts):
    """Without noise, nb = 3; measured over 12 seeds: 0.03 % of wn, 0.2 of zeta, 0.7 of K and T."""
    errors = [off(*flown(seed, wn_ts / 2.5), wn_ts / 2.5, 3, method) for seed in range(3)]
    K, T, wn, zeta = np.max(errors, axis=0)
    assert max(wn, zeta) < 0.003
    assert max(K, T) < 0.01
