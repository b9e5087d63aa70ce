"""A linear aircraft in place of JSBSim: four lateral states, and servos that lag.

    beta' = Y_beta a - r + g/V sin(roll) + Y_delta_r d_r
    p'    = L_beta a + L_p p_a + L_r r_a + L_delta_a d_a + L_delta_r d_r
    r'    = N_beta a + N_p p_a + N_r r_a + N_delta_a d_a + N_delta_r d_r
    roll' = p,   psi' = r,   d' = (command - d) / lag for rudder and aileron
    a = beta + b,   r_a = r + b' / (1 + 3 span / (pi V) s),   p_a = p + the rolling gust

Two things may make the mode depend on its size: a fin that stalls, for which a is replaced by
stall_rad tanh(a / stall_rad); and a yaw damper of the aircraft's own, without lag and not in any
log, whose part of the rudder is -damper_gain r between -damper_limit and damper_limit. The
linearisation is that of small motions: it has the damper, but neither the stall nor the limit.

It flies level at one airspeed through a frozen field of gusts (MIL-F-8785C), whose sideslip b moves
past it and so yaws it. Commands, gusts and all that is not linear are held for a step, which is
propagated by a matrix exponential.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from flights.plan import FOOT, KNOT, STEP_S, FlightPlan

Floats = NDArray[np.float64]
GRAVITY = 9.80665
STATES = ("beta", "attitude/phi-rad", "velocities/p-rad_sec", "velocities/r-rad_sec")
"""The lateral states, by JSBSim's names and in the order of ``flights.truth.LATERAL``."""
GUST_M_S, GUST_M, SPAN_M = 0.4, 30.0, 2.0
"""Standard deviation of the lateral gust for each severity, the length of a gust, and the span."""
COURSES = {"velocities/v-north-fps": math.cos, "velocities/v-east-fps": math.sin}
SEVERITY = "atmosphere/turbulence/milspec/severity"


class LinearAircraft:
    """A linear aircraft in flight; it has the properties of JSBSim that a flight reads and sets."""

    def __init__(self, own: Mapping[str, float], plan: FlightPlan) -> None:
        self.servo_lag_s, self._speed = own["servo_lag_s"], own["airspeed_m_s"]
        A = np.array(
            [
                [own["Y_beta"], GRAVITY / own["airspeed_m_s"], 0.0, -1.0],
                [0.0, 0.0, 1.0, 0.0],
                [own["L_beta"], 0.0, own["L_p"], own["L_r"]],
                [own["N_beta"], 0.0, own["N_p"], own["N_r"]],
            ]
        )
        self.aileron = np.array([0.0, 0.0, own["L_delta_a"], own["N_delta_a"]])
        right = np.array([own["Y_delta_r"], 0.0, own["L_delta_r"], own["N_delta_r"]])
        self.rudder = -right  # as JSBSim's, positive to the left
        # M is of the states, d_a, d_r, psi; the commands, the gusts of sideslip, yaw and roll, and
        # what the linear terms lack of each state's derivative.
        M, (p, r) = np.zeros((16, 16)), (2, 3)
        self._gain, self._limit = own.get("damper_gain", 0.0), own.get("damper_limit", 0.0)
        self._stall_rad, self._fin = own.get("stall_rad", math.inf), A[:, 0]
        self.A = A + self._gain * np.outer(self.rudder, np.eye(4)[r])
        M[:4, :4], M[:4, 4], M[:4, 5], M[:4, 12:] = self.A, self.aileron, -self.rudder, np.eye(4)
        M[:4, 9], M[[p, r], 10], M[[p, r], 11] = A[:, 0], A[[p, r], r], A[[p, r], p]
        M[[4, 5], [4, 5]], M[[4, 5], [7, 8]] = -1.0 / self.servo_lag_s, 1.0 / self.servo_lag_s
        M[6, 3] = 1.0
        self._M, self._x = M, np.zeros(16)
        self._x[6] = math.radians(plan.heading_deg)
        self.set_dt(STEP_S)
        self._behind, speed = 0.0, self._speed
        self._rng: np.random.Generator | None = None
        commands = (f"fcs/{name}-cmd-norm" for name in ("rudder", "aileron", "elevator"))
        still = ("attitude/theta-rad", "velocities/q-rad_sec", "velocities/h-dot-fps", SEVERITY)
        self._own = dict.fromkeys((*commands, *still), 0.0) | {
            "fcs/throttle-cmd-norm": 0.5, "position/h-sl-ft": plan.altitude_ft,
            "velocities/vc-kts": speed / KNOT,
            "velocities/vt-fps": speed / FOOT, "velocities/vg-fps": speed / FOOT,
        }  # fmt: skip

    def set_dt(self, step_s: float) -> None:
        """Set the length of a step, for which commands and gusts are held."""
        self._step, self._step_s = expm(self._M * step_s), step_s

    def run(self) -> None:
        """Propagate one step, in turbulence if a severity is set."""
        x, own = self._x, self._own
        x[7], x[8] = own["fcs/aileron-cmd-norm"], -own["fcs/rudder-cmd-norm"]
        if own[SEVERITY]:
            self._blow(x, GUST_M_S * own[SEVERITY])
        a, damped = x[0] + x[9], self._gain * x[3]
        beyond = damped - min(max(damped, -self._limit), self._limit)
        x[12:] = -self.rudder * beyond
        if self._stall_rad < math.inf:
            x[12:] += self._fin * (self._stall_rad * math.tanh(a / self._stall_rad) - a)
        x[12] += GRAVITY / self._speed * (math.sin(x[1]) - x[1])
        self._x = self._step @ x

    def _blow(self, x: Floats, sigma_m_s: float) -> None:
        """Set the gusts of the next step, for a lateral one of this standard deviation."""
        if self._rng is None:
            self._rng = np.random.default_rng(int(self._own["atmosphere/randomseed"]))
        passed_m = self._step_s * self._speed
        keep, roll_m = math.exp(-passed_m / GUST_M), math.sqrt(GUST_M * SPAN_M) / 2.6
        sigma = sigma_m_s / self._speed * math.sqrt(1.0 - keep**2)
        x[9] = keep * x[9] + sigma * self._rng.normal()
        span_s = 3.0 * SPAN_M / math.pi / self._speed
        self._behind -= math.expm1(-self._step_s / span_s) * (x[9] - self._behind)
        x[10] = (x[9] - self._behind) / span_s
        keep, sigma = math.exp(-passed_m / roll_m), 1.9 / math.sqrt(GUST_M * SPAN_M) * sigma_m_s
        x[11] = keep * x[11] + sigma * math.sqrt(1.0 - keep**2) * self._rng.normal()

    def __getitem__(self, name: str) -> float:
        """Return the present value of a property by its name in JSBSim."""
        if name in STATES:
            return float(self._x[STATES.index(name)])
        if name.startswith("attitude/psi"):
            return float(self._x[6] if name.endswith("rad") else math.degrees(self._x[6]))
        if name in COURSES:
            return float(COURSES[name](self._x[0] + self._x[6])) * self._own["velocities/vt-fps"]
        return self._own[name]

    def __setitem__(self, name: str, value: float) -> None:
        self._own[name] = value
