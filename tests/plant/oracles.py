"""What the tests of the plants hold them to: kinematics, and the response at a frequency."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from yawid.blocks import Floats
from yawid.plant.linear import LinearPlant


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
