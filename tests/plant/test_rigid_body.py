from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from plant.oracles import angle_rates, attitude_from
from scipy.spatial.transform import Rotation

from yawid.plant.rigid_body import (
    Motion,
    RigidBody,
    fly,
    weight,
)
from yawid.quantities.airspeed import GRAVITY

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


def test_a_moment_about_one_axis_spins_the_body_up_evenly():
    at_rest = Motion(ZERO, ZERO, attitude_from(ZERO), ZERO)
    t = np.linspace(0.0, 2.0, 9)
    flown = fly(BODY, at_rest, lambda _: (ZERO, np.array([0.0, 0.6, 0.0])), t)
    np.testing.assert_allclose(flown.angles[:, 0], 0.1 * t**2, atol=1e-9)
    np.testing.assert_allclose(flown.angular_rate[:, 1], 0.2 * t, atol=1e-9)


def test_the_angle_rates_are_those_of_the_quaternion():
    h = 1e-4
    flown = fly(BODY, TUMBLING, free, np.array([0.0, h, 2.0 * h]))
    expected = angle_rates(flown.angles[1], flown.angular_rate[1])
    np.testing.assert_allclose((flown.angles[2] - flown.angles[0]) / (2.0 * h), expected, rtol=1e-6)


@given(st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)))
def test_angles_come_back_from_their_quaternion(angles):
    motion = Motion(ZERO, ZERO, attitude_from(np.array(angles)), ZERO)
    np.testing.assert_allclose(motion.angles, angles, atol=1e-9)
