from __future__ import annotations

import numpy as np
from plant.oracles import attitude_from, frd_from_paper

from yawid.plant.rigid_body import RigidBody, rotation, translation, weight

RNG = np.random.default_rng(3)


def test_the_axes_keep_the_right_hand():
    a, b = RNG.standard_normal((2, 20, 3))
    np.testing.assert_allclose(
        frd_from_paper(np.cross(a, b)), np.cross(frd_from_paper(a), frd_from_paper(b)), atol=1e-15
    )


def test_up_and_right_and_a_nose_to_the_left_mean_the_same_in_both_axes():
    np.testing.assert_array_equal(frd_from_paper(np.array([0.0, 1.0, 0.0])), [0, 0, -1])
    np.testing.assert_array_equal(frd_from_paper(np.array([0.0, 0.0, 1.0])), [0, 1, 0])
    assert frd_from_paper(np.array([0.0, 0.4, 0.0]))[2] == -0.4  # a yaw rate


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
