"""Steady wings-level flight of the rigid body: forces and moments linearised at trim are eq. 21.

At trim W = (V, 0, 0), thrust equals drag and lift equals weight. Loads due to an angle grow with
the dynamic pressure, loads due to a rate with the airspeed; gravity acts along the true vertical.
"""

import math
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats
from yawid.errors import ConfigError
from yawid.plant.lateral import LateralCoefficients
from yawid.plant.rigid_body import Motion, RigidBody, weight
from yawid.quantities.airspeed import GRAVITY


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyFlight:
    """An aircraft at its trim speed in m/s, with its lateral and longitudinal coefficients at trim.

    ``a_x_speed`` (1/s) is the drag due to speed and ``a_y_alpha`` (1/s) the lift due to the angle
    of attack; ``a_mz_alpha`` (1/s^2) and ``a_mz_omega_z`` (1/s) are the restoring and the damping
    moment in pitch.

    Raises:
        ConfigError: the speed is not > 0, or a_z_gamma is not -g/V, which gravity demands.
    """

    body: RigidBody
    speed: float
    coefficients: LateralCoefficients
    a_x_speed: float = 0.05
    a_y_alpha: float = 2.0
    a_mz_alpha: float = 8.0
    a_mz_omega_z: float = 4.0

    def __post_init__(self) -> None:
        if not self.speed > 0.0:
            raise ConfigError(f"speed must be > 0 m/s, got {self.speed!r}")
        turn = -GRAVITY / self.speed
        if not math.isclose(self.coefficients.a_z_gamma, turn, rel_tol=1e-9):
            raise ConfigError(f"a_z_gamma must be -g/V = {turn:.9g} 1/s at {self.speed} m/s")

    def trim(self) -> Motion:
        """Return the steady motion at trim."""
        zero = np.zeros(3)
        attitude = np.array([0.0, 0.0, 0.0, 1.0])
        return Motion(np.array([self.speed, 0.0, 0.0]), zero, attitude, zero)

    def loads(self, motion: Motion, controls: Floats) -> tuple[Floats, Floats]:
        """Return forces (3,) in N and moments (3,) in N m for controls (3,) in rad.

        The controls are -delta_b, -delta_h and beta_b.

        Raises:
            ConfigError: the aircraft does not fly forward, where these loads are not valid.
        """
        if not motion.velocity[0] > 0.0:
            raise ConfigError("the aircraft no longer flies forward: take a smaller amplitude")
        c, body, (ox, oy, oz) = self.coefficients, self.body, motion.angular_rate
        aileron, rudder, wind = controls
        air_speed = float(np.linalg.norm(motion.velocity))
        alpha = math.atan2(-motion.velocity[1], motion.velocity[0])
        beta = math.asin(motion.velocity[2] / air_speed) + wind
        rate = air_speed / self.speed
        pressure = rate**2
        forces = body.mass * np.array(
            [
                -self.a_x_speed * (air_speed - self.speed),
                pressure * (GRAVITY + self.speed * self.a_y_alpha * alpha),
                pressure * self.speed * (c.a_z_beta_b * wind - c.a_z_beta * beta),
            ]
        ) + weight(body, motion.attitude)
        rolling = rate * (c.a_mx_omega_x * ox + c.a_mx_omega_y * oy)
        yawing = rate * (c.a_my_omega_x * ox + c.a_my_omega_y * oy)
        moments = np.array(
            [
                body.J_x * (pressure * (c.a_mx_delta_b * aileron - c.a_mx_beta * beta) - rolling),
                body.J_y * (pressure * (c.a_my_delta_h * rudder - c.a_my_beta * beta) - yawing),
                -body.J_z * (pressure * self.a_mz_alpha * alpha + rate * self.a_mz_omega_z * oz),
            ]
        )
        return forces, moments
