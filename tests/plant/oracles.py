"""What the tests of the plants hold them to: axes, kinematics, eq. 22, and a response."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from yawid.blocks import Floats
from yawid.plant.lateral import LateralCoefficients, LinearPlant


def attitude_from(angles: Floats) -> Floats:
    """Return the quaternion (..., 4) of psi, theta, gamma (..., 3) in rad."""
    return np.asarray(Rotation.from_euler("YZX", angles).as_quat())


def angle_rates(angles: Floats, omega: Floats) -> Floats:
    """Return psi', theta', gamma' (3,) at the angles (3,) for the body rates omega (3,)."""
    _, theta, gamma = angles
    across = omega[1] * np.cos(gamma) - omega[2] * np.sin(gamma)
    pitching = omega[1] * np.sin(gamma) + omega[2] * np.cos(gamma)
    return np.array([across / np.cos(theta), pitching, omega[0] - np.tan(theta) * across])


def response(plant: LinearPlant, s: ArrayLike) -> NDArray[np.complex128]:
    """Return the transfer matrix (n, outputs, inputs) at the complex frequencies s (n,)."""
    points = np.atleast_1d(np.asarray(s, dtype=np.complex128))[:, None, None]
    inner = np.linalg.solve(points * np.eye(len(plant.A)) - plant.A, plant.B.astype(complex))
    return np.asarray(plant.C @ inner + plant.D, dtype=np.complex128)


def frd_from_paper(vector: Floats) -> Floats:
    """Return (..., 3) in forward-right-down axes (or north-east-down) from the paper's."""
    return np.stack([vector[..., 0], vector[..., 2], -vector[..., 1]], axis=-1)


def yaw_motion(c: LateralCoefficients) -> LinearPlant:
    """Return eq. 22, which is eq. 21 with gamma = 0 and no wind; states theta_G, psi, psi'."""
    beta = np.array([-1.0, 1.0, 0.0])
    A = np.stack([c.a_z_beta * beta, np.eye(3)[2], -c.a_my_beta * beta])
    A[2, 2] -= c.a_my_omega_y
    B = np.array([[0.0], [0.0], [c.a_my_delta_h]])
    C = np.stack([np.eye(3)[1], np.eye(3)[2], beta])
    return LinearPlant(A, B, C, np.zeros((3, 1)), ("-delta_h",), ("psi", "psi_rate", "beta"))
