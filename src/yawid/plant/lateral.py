"""Linear lateral motion in the paper's axes: eq. 21 as a state space, eq. 22 as its gamma = 0 part.

Eq. 21, with every rate on the left::

    theta_G' = a_z_gamma gamma + a_z_beta beta - a_z_beta_b beta_b
    gamma''  = -a_mx_omega_x gamma' - a_mx_omega_y psi' - a_mx_beta beta + a_mx_delta_b (-delta_b)
    psi''    = -a_my_omega_x gamma' - a_my_omega_y psi' - a_my_beta beta + a_my_delta_h (-delta_h)
    beta     = psi - theta_G + beta_b

theta_G is the direction of flight, beta the sideslip in the air and beta_b the part of it due to
wind, all in rad. a_z_gamma is negative: psi and theta_G are positive to the left, gamma to the
right.
"""

import math
from dataclasses import astuple, dataclass

import numpy as np

from yawid.errors import ConfigError
from yawid.plant.linear import LinearPlant

INPUTS = ("-delta_b", "-delta_h", "beta_b")
OUTPUTS = ("psi", "psi_rate", "gamma", "beta", "gamma_rate")
"""The outputs of eq. 21 in rad, rates in rad/s; the inputs are in rad too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LateralCoefficients:
    """Coefficients of eq. 21: forces in 1/s, moments in 1/s (of a rate) or 1/s^2 (of an angle).

    Raises:
        ConfigError: a coefficient is not finite.
    """

    a_z_gamma: float
    a_z_beta: float
    a_z_beta_b: float = 0.0
    a_mx_omega_x: float
    a_mx_omega_y: float
    a_mx_beta: float
    a_mx_delta_b: float
    a_my_omega_x: float
    a_my_omega_y: float
    a_my_beta: float
    a_my_delta_h: float

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in astuple(self)):
            raise ConfigError(f"the coefficients of eq. 21 must be finite, got {self}")


def lateral_motion(c: LateralCoefficients) -> LinearPlant:
    """Return eq. 21 with states theta_G, gamma, gamma', psi, psi'; see INPUTS and OUTPUTS."""
    beta = np.array([-1.0, 0.0, 0.0, 1.0, 0.0])
    A = np.zeros((5, 5))
    A[0] = c.a_z_beta * beta
    A[0, 1] += c.a_z_gamma
    A[1, 2] = A[3, 4] = 1.0
    A[2] = -c.a_mx_beta * beta
    A[2, [2, 4]] -= c.a_mx_omega_x, c.a_mx_omega_y
    A[4] = -c.a_my_beta * beta
    A[4, [2, 4]] -= c.a_my_omega_x, c.a_my_omega_y
    B = np.zeros((5, 3))
    B[0, 2] = c.a_z_beta - c.a_z_beta_b
    B[2] = c.a_mx_delta_b, 0.0, -c.a_mx_beta
    B[4] = 0.0, c.a_my_delta_h, -c.a_my_beta
    C = np.stack([np.eye(5)[3], np.eye(5)[4], np.eye(5)[1], beta, np.eye(5)[2]])
    D = np.zeros((5, 3))
    D[3, 2] = 1.0
    return LinearPlant(A, B, C, D, INPUTS, OUTPUTS)
