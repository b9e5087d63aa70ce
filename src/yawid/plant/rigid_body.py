"""Six degrees of freedom in the paper's axes (x forward, y up, z right): eq. 17 to 20.

Forces, gravity included, and moments are given. The attitude is a unit quaternion (x, y, z, w) from
body to ground axes: yaw psi about y, then pitch theta about z, then bank gamma about x.

Printed slips: eq. 19 permutes the indices (its first line is the x equation, its second the y
equation), and its moment line means J_z omega_z'; the code has the rows of eq. 17 and 18.
"""

from collections.abc import Callable
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from yawid.blocks import Floats
from yawid.errors import ConfigError
from yawid.quantities.airspeed import GRAVITY


@dataclass(frozen=True, slots=True)
class RigidBody:
    """Mass in kg and moments of inertia about the body axes in kg m^2.

    Raises:
        ConfigError: one of them is not > 0.
    """

    mass: float
    J_x: float
    J_y: float
    J_z: float

    def __post_init__(self) -> None:
        if not all(value > 0.0 for value in astuple(self)):
            raise ConfigError(f"mass and moments of inertia must be > 0, got {self}")


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


Loads = Callable[[float, Motion], tuple[Floats, Floats]]
"""A function of time in s and motion: forces (3,) in N and moments (3,) in N m in body axes."""


def translation(body: RigidBody, W: Floats, omega: Floats, forces: Floats) -> Floats:
    """Return W' (3,) in m/s^2 of eq. 17: m (W' + omega x W) = F, from W, omega and F (3,)."""
    wx, wy, wz = W
    ox, oy, oz = omega
    turning = np.array([oy * wz - oz * wy, oz * wx - ox * wz, ox * wy - oy * wx])
    return np.asarray(forces / body.mass - turning)


def rotation(body: RigidBody, omega: Floats, moments: Floats) -> Floats:
    """Return omega' (3,) in rad/s^2 of eq. 18: J omega' + omega x J omega = M, M (3,) in N m."""
    ox, oy, oz = omega
    J = np.array([body.J_x, body.J_y, body.J_z])
    gyroscopic = np.array(
        [
            (body.J_z - body.J_y) * oy * oz,
            (body.J_x - body.J_z) * ox * oz,
            (body.J_y - body.J_x) * ox * oy,
        ]
    )
    return np.asarray((moments - gyroscopic) / J)


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

    def rates(now: float, x: Floats) -> Floats:
        motion = _motion(x)
        forces, moments = loads(now, motion)
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
