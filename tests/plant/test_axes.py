from __future__ import annotations

import numpy as np
from plant.oracles import attitude_from, frd_from_paper

from yawid.plant.rigid_body import RigidBody, rotation, translation, weight

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
