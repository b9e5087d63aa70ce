"""The rigid body and eq. 17-23: axes and laws of a textbook, and each from the one before."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plant.oracles import angle_rates, attitude_from, frd_from_paper, response, yaw_motion
from scipy.signal import cont2discrete, lfilter
from scipy.spatial.transform import Rotation

from yawid.blocks import Floats
from yawid.errors import ConfigError
from yawid.plant.lateral import (
    INPUTS,
    OUTPUTS,
    LateralCoefficients,
    LinearPlant,
    lateral_motion,
    sampled_theta,
)
from yawid.plant.rigid_body import (
    Motion,
    RigidBody,
    SteadyFlight,
    fly,
    rotation,
    translation,
    weight,
)
from yawid.plant.simulate import REFERENCE, REFERENCE_FLIGHT
from yawid.plant.yaw import YawPlant
from yawid.quantities.airspeed import GRAVITY

RNG = np.random.default_rng(3)


def test_eq_17_and_18_are_newton_and_euler_in_forward_right_down_axes():
    """The textbook's vector form, written in the other axes, gives the same accelerations."""
    body = RigidBody(12.0, 2.0, 5.0, 3.5)
    W, omega, forces, moments = RNG.standard_normal((4, 3))
    V, rates, F, M = (frd_from_paper(v) for v in (W, omega, forces, moments))
    inertia = np.diag([body.J_x, body.J_z, body.J_y])
    np.testing.assert_allclose(
        frd_from_paper(translation(body, W, omega, forces)),
        F / body.mass - np.cross(rates, V),
        atol=1e-14,
    )
    np.testing.assert_allclose(
        frd_from_paper(rotation(body, omega, moments)),
        np.linalg.solve(inertia, M - np.cross(rates, inertia @ rates)),
        atol=1e-14,
    )


def test_a_right_bank_pulls_to_the_right_and_a_raised_nose_backwards():
    body = RigidBody(2.0, 1.0, 1.0, 1.0)
    banked = frd_from_paper(weight(body, attitude_from(np.array([0.7, 0.0, 0.3]))))
    raised = frd_from_paper(weight(body, attitude_from(np.array([-0.7, 0.2, 0.0]))))
    g = 2.0 * 9.80665
    np.testing.assert_allclose(banked, [0.0, g * np.sin(0.3), g * np.cos(0.3)], atol=1e-12)
    np.testing.assert_allclose(raised, [-g * np.sin(0.2), 0.0, g * np.cos(0.2)], atol=1e-12)


BODY = RigidBody(10.0, 1.0, 3.0, 2.2)
ZERO = np.zeros(3)
TUMBLING = Motion(
    np.array([20.0, -1.0, 2.0]),
    np.array([0.8, 1.5, -0.6]),
    attitude_from(np.array([0.4, -0.3, 0.9])),
    np.array([1.0, 2.0, 3.0]),
)


def free(motion):
    return ZERO, ZERO


def test_a_free_body_keeps_its_energy_momentum_and_straight_path():
    t = np.linspace(0.0, 20.0, 50)
    flown = fly(BODY, TUMBLING, free, t)
    J = np.array([BODY.J_x, BODY.J_y, BODY.J_z])
    to_ground = Rotation.from_quat(flown.attitude)
    momentum = to_ground.apply(J * flown.angular_rate)
    velocity = to_ground.apply(flown.velocity)
    energy = (J * flown.angular_rate**2).sum(axis=1)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(50, axis=0), atol=1e-7)
    np.testing.assert_allclose(velocity, velocity[:1].repeat(50, axis=0), atol=1e-6)
    np.testing.assert_allclose(
        flown.position, TUMBLING.position + np.outer(t, velocity[0]), atol=1e-5
    )
    np.testing.assert_allclose(np.linalg.norm(flown.attitude, axis=1), 1.0, atol=1e-15)


def test_a_tumbling_body_falls_straight_down():
    t = np.linspace(0.0, 5.0, 11)
    flown = fly(BODY, TUMBLING, lambda motion: (weight(BODY, motion.attitude), ZERO), t)
    start = Rotation.from_quat(TUMBLING.attitude).apply(TUMBLING.velocity)
    path = TUMBLING.position + np.outer(t, start)
    path[:, 1] -= 0.5 * GRAVITY * t**2
    np.testing.assert_allclose(flown.position, path, atol=1e-6)


def test_the_angle_rates_are_those_of_the_quaternion():
    h = 1e-4
    flown = fly(BODY, TUMBLING, free, np.array([0.0, h, 2.0 * h]))
    expected = angle_rates(flown.angles[1], flown.angular_rate[1])
    np.testing.assert_allclose((flown.angles[2] - flown.angles[0]) / (2.0 * h), expected, rtol=1e-6)


@given(st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)))
def test_angles_come_back_from_their_quaternion(angles):
    motion = Motion(ZERO, ZERO, attitude_from(np.array(angles)), ZERO)
    np.testing.assert_allclose(motion.angles, angles, atol=1e-9)


S = 1j * np.logspace(-2, 2, 50)

signed = st.floats(-3.0, 3.0)
positive = st.floats(0.1, 20.0)


STEP = 1e-5
"""Central-difference step of :func:`linearised`: truncation and rounding are both near 1e-10."""


def linearised(flight: SteadyFlight) -> LinearPlant:
    """Return the nonlinear motion's numerical linearisation at trim, all nine states of it.

    States W, omega, (psi, theta, gamma); inputs and outputs as eq. 21 in ``lateral.py``.
    """
    trim = flight.trim()
    x0 = np.concatenate([trim.velocity, trim.angular_rate, np.zeros(3)])
    u0 = np.zeros(len(INPUTS))

    def rates(x: Floats, u: Floats) -> Floats:
        W, omega, angles = x[:3], x[3:6], x[6:]
        motion = Motion(W, omega, attitude_from(angles), np.zeros(3))
        forces, moments = flight.loads(motion, u)
        linear = translation(flight.body, W, omega, forces)
        angular = rotation(flight.body, omega, moments)
        return np.concatenate([linear, angular, angle_rates(angles, omega)])

    def outputs(x: Floats, u: Floats) -> Floats:
        beta = math.asin(x[2] / float(np.linalg.norm(x[:3]))) + u[2]
        turn = angle_rates(x[6:], x[3:6])
        return np.array([x[6], turn[0], x[8], beta, turn[2]])

    A, C = _slopes(lambda x: rates(x, u0), x0), _slopes(lambda x: outputs(x, u0), x0)
    B, D = _slopes(lambda u: rates(x0, u), u0), _slopes(lambda u: outputs(x0, u), u0)
    return LinearPlant(A, B, C, D, INPUTS, OUTPUTS)


def _slopes(function: Callable[[Floats], Floats], at: Floats) -> Floats:
    """Return the Jacobian (outputs, inputs) by central differences."""
    ends = [(function(at + step), function(at - step)) for step in np.eye(len(at)) * STEP]
    return np.stack([(above - below) / (2.0 * STEP) for above, below in ends], axis=1)


@st.composite
def flights(draw):
    speed = draw(st.floats(10.0, 200.0))
    names = [name for name in LateralCoefficients.__dataclass_fields__ if name != "a_z_gamma"]
    values = {name: draw(signed) for name in names}
    values |= {name: draw(positive) for name in ("a_z_beta", "a_mx_omega_x", "a_my_beta")}
    body = RigidBody(*(draw(st.floats(0.5, 5e3)) for _ in range(4)))
    coefficients = LateralCoefficients(a_z_gamma=-GRAVITY / speed, **values)
    return SteadyFlight(body=body, speed=speed, coefficients=coefficients)


def off(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest deviation at a frequency, relative to each channel's own size there."""
    return float(np.max(np.abs(found - expected) / (np.abs(expected) + 1e-3)))


@given(flights())
def test_eq_21_is_the_rigid_body_linearised_at_trim(flight):
    """Every input to every output, over four decades, to 1e-6."""
    found = response(linearised(flight), S)
    expected = response(lateral_motion(flight.coefficients), S)
    assert off(found, expected) < 1e-6


def test_loads_by_an_angle_grow_with_dynamic_pressure_and_by_a_rate_with_speed():
    trim = REFERENCE_FLIGHT.trim()
    for controls, rates, growth in (
        (np.array([0.1, 0.2, 0.0]), np.zeros(3), 4.0),
        (np.zeros(3), np.array([0.1, 0.2, 0.3]), 2.0),
    ):
        slow = replace(trim, angular_rate=rates)
        fast = replace(slow, velocity=2.0 * slow.velocity)
        one, two = (REFERENCE_FLIGHT.loads(motion, controls)[1] for motion in (slow, fast))
        assert one.any()
        np.testing.assert_allclose(two, growth * one, rtol=1e-12)


def test_eq_22_is_eq_21_where_nothing_makes_the_aircraft_bank():
    c = replace(REFERENCE, a_mx_beta=0.0, a_mx_omega_y=0.0)
    rudder, yaw = INPUTS.index("-delta_h"), [OUTPUTS.index(o) for o in ("psi", "psi_rate", "beta")]
    whole = response(lateral_motion(c), S)[:, yaw, rudder]
    np.testing.assert_allclose(response(yaw_motion(c), S)[:, :, 0], whole, rtol=1e-9)


@given(st.floats(0.05, 5.0), st.floats(-1.0, 3.0), st.floats(0.2, 50.0), st.floats(0.1, 10.0))
def test_eq_23_is_the_transfer_function_of_eq_22(a_z_beta, damping, stiffness, rudder):
    c = replace(
        REFERENCE, a_z_beta=a_z_beta, a_my_omega_y=damping,
        a_my_beta=stiffness + 5.0, a_my_delta_h=rudder,
    )  # fmt: skip
    plant, motion = YawPlant.from_coefficients(c), response(yaw_motion(c), S)
    np.testing.assert_allclose(
        response(plant.linear("yaw"), S)[:, 0, 0], motion[:, 0, 0], rtol=1e-9
    )
    np.testing.assert_allclose(response(plant.linear(), S)[:, 0, 0], motion[:, 1, 0], rtol=1e-9)
    K, T, w, xi = plant.K, plant.T_theta_s, plant.omega_beta, plant.xi_beta
    formula = K * (T * S + 1.0) * w**2 / (S**2 + 2.0 * xi * w * S + w**2)
    np.testing.assert_allclose(motion[:, 1, 0], formula, rtol=1e-9)


@pytest.mark.parametrize("output", ["yaw-rate", "yaw"])
def test_theta_is_the_difference_equation_of_the_simulated_plant(output):
    plant = YawPlant.from_coefficients(REFERENCE)
    u = np.random.default_rng(5).standard_normal(300)
    y = plant.linear(output).simulate(u, 0.05)[:, 0]
    theta = plant.theta(0.05, output)
    na = len(theta) // 2
    recursion = lfilter(np.concatenate([[0.0], theta[na:]]), np.concatenate([[1.0], theta[:na]]), u)
    np.testing.assert_allclose(y, recursion, atol=1e-11)
    w, xi = plant.omega_beta, plant.xi_beta
    of_eq_23 = plant.K * w**2 * np.array([plant.T_theta_s, 1.0]), [1.0, 2.0 * xi * w, w**2]
    behind = [1.0, 0.0] if output == "yaw" else [1.0]
    b, a, _ = cont2discrete((of_eq_23[0], np.polymul(of_eq_23[1], behind)), 0.05)
    np.testing.assert_allclose(theta, [*a[1:], *b.ravel()[1:]], atol=1e-12)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: YawPlant.from_coefficients(replace(REFERENCE, a_my_beta=-5.0)), r"w\^2 > 0"),
        (lambda: YawPlant(1.0, 1.0, 0.0, 0.2), "omega_beta > 0"),
        (lambda: lateral_motion(REFERENCE).simulate(np.zeros((5, 2)), 0.1), "2 columns"),
        (lambda: sampled_theta(lateral_motion(REFERENCE), 0.1), "nk = 1"),
    ],
)
def test_what_makes_no_sense_is_refused(made, words):
    with pytest.raises(ConfigError, match=words):
        made()
