"""The response of the reference plants to a chosen input, in the project's signs.

This is the only place where the paper's axes and signs are converted to the project's.
``plant/`` uses the paper's axes: x forward, y up, z to the right, and on the ground north, up,
east. The rest of the project uses MAVLink's: forward, right, down (north, east, down). Both are
right-handed; a rotation of 90 deg about x converts one to the other.

======================  ======================  =============================
quantity                paper                   project
======================  ======================  =============================
bank, roll rate         gamma, omega_x          roll, p (same sign)
pitch, pitch rate       theta, omega_z          pitch, q (same sign)
yaw, yaw rate           psi, omega_y            -yaw, -r (the paper's nose goes left)
sideslip                beta                    beta (same: air from the right)
rudder                  -delta_H turns left     rudder > 0 turns the nose right: delta_H
aileron                 -delta_b rolls right    aileron > 0 rolls right: -delta_b
======================  ======================  =============================

So yaw rate over rudder is psi'/(-delta_H) of the paper's eq. 23, with its sign.
"""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import partial
from itertools import pairwise
from typing import Literal, get_args

import numpy as np

from yawid.blocks import Floats
from yawid.errors import ConfigError
from yawid.plant.excitation import Excitation
from yawid.plant.lateral import INPUTS, LateralCoefficients, lateral_motion
from yawid.plant.rigid_body import Motion, RigidBody, SteadyFlight, fly
from yawid.plant.yaw import YawPlant
from yawid.quantities.airspeed import GRAVITY

PlantName = Literal["yaw", "lateral", "rigid-body"]
PLANTS: tuple[PlantName, ...] = get_args(PlantName)

SPEED_M_S = 50.0
REFERENCE = LateralCoefficients(
    a_z_gamma=-GRAVITY / SPEED_M_S, a_z_beta=0.3,
    a_mx_omega_x=8.0, a_mx_omega_y=1.5, a_mx_beta=15.0, a_mx_delta_b=40.0,
    a_my_omega_x=-0.2, a_my_omega_y=0.7, a_my_beta=5.5, a_my_delta_h=4.0,
)  # fmt: skip
"""Coefficients of a light aircraft at 50 m/s."""
REFERENCE_FLIGHT = SteadyFlight(
    body=RigidBody(1000.0, 1300.0, 2700.0, 1800.0), speed=SPEED_M_S, coefficients=REFERENCE
)


ANGLE_NOISE_S = 0.05
"""The noise of the lateral plant's roll in rad over that of its rates in rad/s. The bare airframe
is not found where roll is the integral of p to the last bit, as no estimator's is."""


@dataclass(frozen=True, slots=True)
class Simulation:
    """Input and outputs (n,) of a simulation at ``t`` = k Ts in s.

    ``u`` is the rudder in rad, positive nose right, held over [t_k, t_k+1); ``y`` the yaw rate in
    rad/s at t_k with noise; ``yaw`` and ``roll`` in rad. roll is 0 where the plant has none. The
    lateral plant has the roll rate ``p`` in rad/s, with noise, and the lateral acceleration ``ay``
    in m/s^2, without; the others have None.
    """

    t: Floats
    u: Floats
    y: Floats
    yaw: Floats
    roll: Floats
    p: Floats | None = None
    ay: Floats | None = None


def simulate_plant(
    name: PlantName,
    excitation: Excitation,
    *,
    duration_s: float = 60.0,
    sample_time_s: float = 0.05,
    noise_std: float = 0.0,
    seed: int = 0,
    flight: SteadyFlight = REFERENCE_FLIGHT,
) -> Simulation:
    """Simulate a plant from rest: "yaw" eq. 22-23, "lateral" eq. 21, "rigid-body" eq. 17-18.

    All three have the same coefficients. White noise of ``noise_std`` rad/s is added to y
    and p, and to the lateral plant's roll ANGLE_NOISE_S of it.

    Raises:
        ConfigError: the plant is unknown, a value is outside its limits, or the rudder moves so
        much that the rigid body does not fly forward any more.
    """
    if name not in PLANTS:
        raise ConfigError(f"plant must be one of {', '.join(PLANTS)}, got {name!r}")
    if not 0.0 < sample_time_s < math.inf or not sample_time_s <= duration_s < math.inf:
        raise ConfigError(
            f"need 0 < sample time <= duration, got {sample_time_s!r} s and {duration_s!r} s"
        )
    if not 0.0 <= noise_std < math.inf:
        raise ConfigError(f"noise_std must be >= 0, got {noise_std!r}")
    count = round(duration_s / sample_time_s)
    u, rng = excitation.samples(count, sample_time_s), np.random.default_rng(seed)
    psi, psi_rate, gamma, *others = _RUNS[name](flight, -u, sample_time_s)
    t, y = np.arange(count) * sample_time_s, -psi_rate + noise_std * rng.standard_normal(count)
    if others:
        others[0] = others[0] + noise_std * rng.standard_normal(count)
        gamma = gamma + ANGLE_NOISE_S * noise_std * rng.standard_normal(count)
    return Simulation(np.asarray(t, np.float64), u, y, -psi, gamma, *others)


Run = Callable[[SteadyFlight, Floats, float], tuple[Floats, ...]]
"""A function of flight, -delta_h (n,) in rad and Ts in s: psi, psi' and gamma (n,), and of the
lateral plant p and ay (n,)."""


def _run_yaw(flight: SteadyFlight, u: Floats, ts: float) -> tuple[Floats, Floats, Floats]:
    plant = YawPlant.from_coefficients(flight.coefficients)
    psi, rate = (plant.linear(output).simulate(u, ts)[:, 0] for output in ("yaw", "yaw-rate"))
    return psi, rate, np.zeros(len(u))


def _run_lateral(flight: SteadyFlight, u: Floats, ts: float) -> tuple[Floats, ...]:
    plant = lateral_motion(flight.coefficients)
    controls = np.zeros((len(u), len(INPUTS)))
    controls[:, INPUTS.index("-delta_h")] = u
    psi, psi_rate, gamma, beta, p = plant.simulate(controls, ts).T
    # The side force turns the direction of flight, which is positive to the left, and ay is not.
    return psi, psi_rate, gamma, p, -flight.speed * flight.coefficients.a_z_beta * beta


def _run_rigid_body(flight: SteadyFlight, u: Floats, ts: float) -> tuple[Floats, Floats, Floats]:
    """Integrate from one change of the rudder to the next, between which the loads are smooth."""
    edges = sorted({0, *(np.flatnonzero(np.diff(u)) + 1), len(u) - 1})
    motion, angles, rates = flight.trim(), np.zeros((len(u), 3)), np.zeros(len(u))
    for start, stop in pairwise(edges):
        loads = partial(flight.loads, controls=np.array([0.0, u[start], 0.0]))
        flown = fly(flight.body, motion, loads, np.arange(start, stop + 1) * ts)
        angles[start : stop + 1] = flown.angles
        rates[start : stop + 1] = flown.angular_rate[:, 1]
        motion = Motion(*(each[-1] for each in astuple(flown)))
    return np.unwrap(angles[:, 0]), rates, angles[:, 2]


_RUNS: dict[str, Run] = {"yaw": _run_yaw, "lateral": _run_lateral, "rigid-body": _run_rigid_body}
