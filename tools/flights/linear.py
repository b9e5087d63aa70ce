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
from functools import cached_property

import numpy as np
from scipy.linalg import expm

from flights.plan import FOOT, KNOT, STEP_S, FlightPlan, Floats

GRAVITY = 9.80665
GUST_M_S, GUST_M, SPAN_M = 0.4, 30.0, 2.0
"""Standard deviation of the lateral gust for each severity, the length of a gust, and the span."""
SEVERITY = "atmosphere/turbulence/milspec/severity"


class LinearAircraft(dict[str, float]):
    """A linear aircraft in flight: the properties of JSBSim that a flight reads and sets."""

    def __init__(self, own: Mapping[str, float], plan: FlightPlan) -> None:
        self.servo_lag_s, self._speed = lag_s, speed = own["servo_lag_s"], own["airspeed_m_s"]
        bare = np.array(
            [
                [own["Y_beta"], GRAVITY / speed, 0.0, -1.0],
                [0.0, 0.0, 1.0, 0.0],
                [own["L_beta"], 0.0, own["L_p"], own["L_r"]],
                [own["N_beta"], 0.0, own["N_p"], own["N_r"]],
            ]
        )
        self.aileron = np.array([0.0, 0.0, own["L_delta_a"], own["N_delta_a"]])
        # As JSBSim's, positive to the left.
        self.rudder = -np.array([own["Y_delta_r"], 0.0, own["L_delta_r"], own["N_delta_r"]])
        self._gain, self._limit = own.get("damper_gain", 0.0), own.get("damper_limit", 0.0)
        self._stall_rad, self._fin = own.get("stall_rad", math.inf), bare[:, 0]
        self.A = bare + self._gain * np.outer(self.rudder, np.eye(4)[3])
        # M is of the states, d_a, d_r, psi; the commands, the gusts of sideslip, yaw and roll, and
        # what the linear terms lack of each state's derivative.
        self._M, turning = np.zeros((16, 16)), np.array([0.0, 0.0, 1.0, 1.0])
        self._M[:4] = np.column_stack([
            self.A, self.aileron, -self.rudder, np.zeros((4, 3)),
            bare[:, 0], turning * bare[:, 3], turning * bare[:, 2], np.eye(4),
        ])  # fmt: skip
        self._M[[4, 5, 4, 5, 6], [4, 5, 7, 8, 3]] = np.array([-1.0, -1.0, 1.0, 1.0, lag_s]) / lag_s
        self._x, self._behind = math.radians(plan.heading_deg) * np.eye(16)[6], 0.0
        self.set_dt(STEP_S)
        super().__init__(self._seen() | {
            "fcs/rudder-cmd-norm": 0.0, "fcs/aileron-cmd-norm": 0.0, "fcs/elevator-cmd-norm": 0.0,
            "fcs/throttle-cmd-norm": 0.5, "position/h-sl-ft": plan.altitude_ft, SEVERITY: 0.0,
            "velocities/vc-kts": speed / KNOT, "velocities/vt-fps": speed / FOOT,
            "velocities/vg-fps": speed / FOOT, "velocities/h-dot-fps": 0.0,
            "attitude/theta-rad": 0.0, "velocities/q-rad_sec": 0.0,
        })  # fmt: skip

    def set_dt(self, step_s: float) -> None:
        """Set the length of a step, for which commands and gusts are held."""
        self._step, self._step_s = expm(self._M * step_s), step_s

    def run(self) -> None:
        """Propagate one step, in turbulence if a severity is set."""
        x = self._x
        x[7], x[8] = self["fcs/aileron-cmd-norm"], -self["fcs/rudder-cmd-norm"]
        if self[SEVERITY]:
            self._blow(x, GUST_M_S * self[SEVERITY])
        a, damped = x[0] + x[9], self._gain * x[3]
        x[12:] = -self.rudder * (damped - min(max(damped, -self._limit), self._limit))
        if self._stall_rad < math.inf:
            x[12:] += self._fin * (self._stall_rad * math.tanh(a / self._stall_rad) - a)
        x[12] += GRAVITY / self._speed * (math.sin(x[1]) - x[1])
        self._x = self._step @ x
        self.update(self._seen())

    @cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(int(self["atmosphere/randomseed"]))

    def _blow(self, x: Floats, sigma_m_s: float) -> None:
        """Set the gusts of the next step, for a lateral one of this standard deviation."""
        passed_m, span_s = self._step_s * self._speed, 3.0 * SPAN_M / math.pi / self._speed
        keep, roll_m = math.exp(-passed_m / GUST_M), math.sqrt(GUST_M * SPAN_M) / 2.6
        sigma = sigma_m_s / self._speed * math.sqrt(1.0 - keep**2)
        x[9] = keep * x[9] + sigma * self._rng.normal()
        self._behind -= math.expm1(-self._step_s / span_s) * (x[9] - self._behind)
        x[10] = (x[9] - self._behind) / span_s
        keep, sigma = math.exp(-passed_m / roll_m), 1.9 / math.sqrt(GUST_M * SPAN_M) * sigma_m_s
        x[11] = keep * x[11] + sigma * math.sqrt(1.0 - keep**2) * self._rng.normal()

    def _seen(self) -> dict[str, float]:
        """Return the present motion by JSBSim's names."""
        beta, roll, p, r, _, _, psi, *_ = self._x.tolist()
        return {
            "attitude/phi-rad": roll, "velocities/p-rad_sec": p, "velocities/r-rad_sec": r,
            "attitude/psi-rad": psi,
            "velocities/v-north-fps": math.cos(beta + psi) * (self._speed / FOOT),
            "velocities/v-east-fps": math.sin(beta + psi) * (self._speed / FOOT),
        }  # fmt: skip
