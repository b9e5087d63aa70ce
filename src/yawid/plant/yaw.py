"""The yaw channel of eq. 22 as the transfer function of eq. 23.

From eq. 22 with u = -delta_h: r' = -a_my_omega_y r - a_my_beta beta + a_my_delta_h u and
beta' = r - a_z_beta beta, hence::

    W_r(s)   = K (T s + 1) w^2 / (s^2 + 2 xi w s + w^2)      rudder to yaw rate
    W_psi(s) = W_r(s) / s                                    rudder to yaw angle

Printed slip: eq. 23 has the name W_psi for both.
"""

import math
from dataclasses import astuple, dataclass
from typing import Literal

from yawid.blocks import Floats
from yawid.errors import ConfigError
from yawid.plant.lateral import LateralCoefficients, LinearPlant, sampled_theta

Output = Literal["yaw-rate", "yaw"]


@dataclass(frozen=True, slots=True)
class YawPlant:
    """Eq. 23: K in rad/s per rad of rudder, T_theta_s in s, omega_beta in rad/s, xi_beta (no unit).

    Raises:
        ConfigError: a value is not finite, or omega_beta is not > 0.
    """

    K: float
    T_theta_s: float
    omega_beta: float
    xi_beta: float

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in astuple(self)) or not self.omega_beta > 0.0:
            raise ConfigError(f"eq. 23 needs finite values and omega_beta > 0, got {self}")

    @classmethod
    def from_coefficients(cls, c: LateralCoefficients) -> "YawPlant":
        """Return the plant with the four coefficients of eq. 22.

        Raises:
            ConfigError: w^2 of these coefficients is not > 0, or a_z_beta is 0.
        """
        square = c.a_my_omega_y * c.a_z_beta + c.a_my_beta
        if not square > 0.0 or c.a_z_beta == 0.0:
            raise ConfigError(f"eq. 23 needs w^2 > 0 and a_z_beta != 0, got {square} from {c}")
        omega = math.sqrt(square)
        xi = (c.a_my_omega_y + c.a_z_beta) / (2.0 * omega)
        return cls(c.a_my_delta_h * c.a_z_beta / square, 1.0 / c.a_z_beta, omega, xi)

    def linear(self, output: Output = "yaw-rate") -> LinearPlant:
        """Return eq. 23 for the yaw rate, or with an integrator for the yaw angle."""
        square = self.omega_beta**2
        numerator = [self.K * square * self.T_theta_s, self.K * square]
        denominator = [1.0, 2.0 * self.xi_beta * self.omega_beta, square]
        if output == "yaw":
            denominator.append(0.0)
        return LinearPlant.from_transfer(numerator, denominator)

    def theta(self, sample_time_s: float, output: Output = "yaw-rate") -> Floats:
        """Return the true theta (2 na,) = [a1.., b1..], nk = 1, for a held input."""
        return sampled_theta(self.linear(output), sample_time_s)
