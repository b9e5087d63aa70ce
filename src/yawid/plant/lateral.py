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

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from yawid.blocks import Floats
from yawid.errors import ConfigError

INPUTS = ("-delta_b", "-delta_h", "beta_b")
OUTPUTS = ("psi", "psi_rate", "gamma", "beta", "gamma_rate")
"""The outputs of eq. 21 in rad, rates in rad/s; the inputs are in rad too."""


@dataclass(frozen=True, slots=True)
class LinearPlant:
    """The plant x' = A x + B u, y = C x + D u, with the names of its inputs and outputs."""

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @classmethod
    def from_transfer(cls, numerator: ArrayLike, denominator: ArrayLike) -> "LinearPlant":
        """Return the plant with input u and output y that has this transfer function.

        ``numerator`` (m,) and ``denominator`` (n + 1,), for n states, begin with the highest power
        of s. The numerator has a lower degree than the denominator, whose first coefficient is 1.
        """
        A, B, C, D = signal.tf2ss(numerator, denominator)
        return cls(A, B, C, D, ("u",), ("y",))

    def simulate(self, u: ArrayLike, sample_time_s: float) -> Floats:
        """Return the outputs (n, outputs) at k Ts, from rest.

        ``u`` (n, inputs), or (n,) for one input, is held over [k Ts, (k+1) Ts). The result is
        exact, by the matrix exponential.

        Raises:
            ConfigError: u has the wrong number of inputs.
        """
        u = np.asarray(u, dtype=np.float64)
        u = u.reshape(-1, 1) if u.ndim == 1 else u
        if u.shape[1] != len(self.inputs):
            raise ConfigError(f"u has {u.shape[1]} columns for the inputs {self.inputs}")
        A, B = _discrete(self, sample_time_s)
        x, states = np.zeros(len(A)), np.empty((len(u), len(A)))
        driven = u @ B.T
        for k in range(len(u)):
            states[k] = x
            x = A @ x + driven[k]
        outputs: Floats = states @ self.C.T + u @ self.D.T
        return outputs


def _discrete(plant: LinearPlant, sample_time_s: float) -> tuple[Floats, Floats]:
    system: Any = (plant.A, plant.B, plant.C, plant.D)
    A, B, *_ = signal.cont2discrete(system, sample_time_s, method="zoh")
    return A, B


def sampled_theta(plant: LinearPlant, sample_time_s: float) -> Floats:
    """Return theta (2 na,) = [a1.., b1..], nk = 1, of a plant with one held input and one output.

    Raises:
        ConfigError: the input acts on the output without delay (nk would be 0).
    """
    if np.any(plant.D):
        raise ConfigError("theta with nk = 1 needs a plant that does not pass its input through")
    A, B = _discrete(plant, sample_time_s)
    numerator, denominator = signal.ss2tf(A, B, plant.C, plant.D)
    return np.concatenate([denominator[1:], numerator[0, 1:]])


@dataclass(frozen=True, slots=True, kw_only=True)
class LateralCoefficients:
    """Coefficients of eq. 21: forces in 1/s, moments in 1/s (of a rate) or 1/s^2 (of an angle)."""

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
