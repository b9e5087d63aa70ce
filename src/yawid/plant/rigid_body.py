"""Six degrees of freedom in the paper's axes (x forward, y up, z right): eq. 17 to 20.

Forces, gravity included, and moments are given. The attitude is a unit quaternion (x, y, z, w) from
body to ground axes: yaw psi about y, then pitch theta about z, then bank gamma about x.

Printed slips: eq. 19 permutes the indices (its first line is the x equation, its second the y
equation), and its moment line means J_z omega_z'; the code has the rows of eq. 17 and 18.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from yawid.blocks import Floats
from yawid.errors import ConfigError
from yawid.plant.lateral import LateralCoefficients
from yawid.quantities.airspeed import GRAVITY


@dataclass(frozen=True, slots=True)
class RigidBody:
    """Mass in kg and moments of inertia about the body axes in kg m^2."""

    mass: float
    J_x: float
    J_y: float
    J_z: float

    @property
    def J(self) -> Floats:
        """The moments of inertia (3,)."""
        return np.array([self.J_x, self.J_y, self.J_z])


@dataclass(frozen=True, slots=True)
class Motion:
    """The motion at one instant, or at n instants with a row each.

    ``velocity`` W (..., 3) in m/s and ``angular_rate`` omega (..., 3) in rad/s are in body axes,
    ``position`` (..., 3) in m is in ground axes; ``attitude`` (..., 4) is a quaternion.
    """

    velocity: Floats
    angular_rate: Floats
    attitude: Floats
    position: Floats

    @property
    def angles(self) -> Floats:
        """Return psi, theta, gamma (..., 3) in rad."""
        return np.asarray(Rotation.from_quat(self.attitude).as_euler("YZX"))


Loads = Callable[[Motion], tuple[Floats, Floats]]
"""A function of the motion: forces (3,) in N and moments (3,) in N m in body axes."""


def translation(body: RigidBody, W: Floats, omega: Floats, forces: Floats) -> Floats:
    """Return W' (3,) in m/s^2 of eq. 17: m (W' + omega x W) = F, from W, omega and F (3,)."""
    return np.asarray(forces / body.mass - np.cross(omega, W))


def rotation(body: RigidBody, omega: Floats, moments: Floats) -> Floats:
    """Return omega' (3,) in rad/s^2 of eq. 18: J omega' + omega x J omega = M, M (3,) in N m."""
    return np.asarray((moments - np.cross(omega, body.J * omega)) / body.J)


def weight(body: RigidBody, attitude: Floats) -> Floats:
    """Return the force of gravity (3,) in N in body axes, at an attitude (4,)."""
    down = np.array([0.0, -body.mass * GRAVITY, 0.0])
    return np.asarray(Rotation.from_quat(attitude).apply(down, inverse=True))


def fly(body: RigidBody, start: Motion, loads: Loads, t: Floats) -> Motion:
    """Return the motion (n rows) at the times t (n,) in s; the first is the time of ``start``.

    Integrated by an eighth-order Runge-Kutta method (DOP853) to a relative tolerance of 1e-10.

    Raises:
        ConfigError: the integration fails.
    """

    def rates(_: float, x: Floats) -> Floats:
        motion = _motion(x)
        forces, moments = loads(motion)
        W, omega = motion.velocity, motion.angular_rate
        return np.concatenate(
            [
                translation(body, W, omega, forces),
                rotation(body, omega, moments),
                _quaternion_rate(motion.attitude, omega),
                Rotation.from_quat(motion.attitude).apply(W),
            ]
        )

    x0 = np.concatenate([start.velocity, start.angular_rate, start.attitude, start.position])
    options: dict[str, Any] = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
    solution = solve_ivp(rates, (t[0], t[-1]), x0, t_eval=t, **options)
    if solution.status != 0 or not np.isfinite(solution.y).all():
        raise ConfigError(f"the motion cannot be integrated: {solution.message}")
    return _motion(solution.y.T)


def _motion(x: Floats) -> Motion:
    attitude = x[..., 6:10] / np.linalg.norm(x[..., 6:10], axis=-1, keepdims=True)
    return Motion(x[..., :3], x[..., 3:6], attitude, x[..., 10:])


def _quaternion_rate(q: Floats, omega: Floats) -> Floats:
    """Return q' = q (omega, 0) / 2 (4,)."""
    vector, scalar = q[:3], q[3]
    rate = scalar * omega + np.cross(vector, omega)
    return 0.5 * np.append(rate, -vector @ omega)


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyFlight:
    """Steady wings-level flight at a trim speed in m/s: loads linearised at trim are eq. 21.

    At trim W = (V, 0, 0), thrust equals drag and lift equals weight. Loads due to an angle grow
    with the dynamic pressure, loads due to a rate with the airspeed; gravity acts along the true
    vertical, which demands a_z_gamma = -g/V of the coefficients.

    ``a_x_speed`` (1/s) is the drag due to speed and ``a_y_alpha`` (1/s) the lift due to the angle
    of attack; ``a_mz_alpha`` (1/s^2) and ``a_mz_omega_z`` (1/s) are the restoring and the damping
    moment in pitch.
    """

    body: RigidBody
    speed: float
    coefficients: LateralCoefficients
    a_x_speed: float = 0.05
    a_y_alpha: float = 2.0
    a_mz_alpha: float = 8.0
    a_mz_omega_z: float = 4.0

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
        moments = body.J * np.array(
            [
                pressure * (c.a_mx_delta_b * aileron - c.a_mx_beta * beta) - rolling,
                pressure * (c.a_my_delta_h * rudder - c.a_my_beta * beta) - yawing,
                -pressure * self.a_mz_alpha * alpha - rate * self.a_mz_omega_z * oz,
            ]
        )
        return forces, moments
