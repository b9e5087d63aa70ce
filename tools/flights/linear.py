"""A linear aircraft in place of JSBSim: four lateral states, and servos that lag.

    beta' = Y_beta a - r + g/V roll + Y_delta_r d_r       a = beta + gust
    p'    = L_beta a + L_p p + L_r r + L_delta_a d_a + L_delta_r d_r
    r'    = N_beta a + N_p p + N_r r + N_delta_a d_a + N_delta_r d_r
    roll' = p,   psi' = r,   d' = (command - d) / lag for rudder and aileron

It flies level at one airspeed. Commands are held for a step and propagated by a matrix exponential.
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
GUST_M_S, GUST_M = 0.4, 30.0
"""Standard deviation of the lateral gust for each severity, and the length of a gust."""
SEVERITY = "atmosphere/turbulence/milspec/severity"


class LinearAircraft:
    """A linear aircraft in flight; it has the properties of JSBSim that a flight reads and sets."""

    def __init__(self, own: Mapping[str, float], plan: FlightPlan) -> None:
        self.servo_lag_s, self._speed = own["servo_lag_s"], own["airspeed_m_s"]
        self.A, self.aileron, self.rudder = _matrices(own)
        M = np.zeros((10, 10))  # the states, d_a, d_r, psi; then the commands and the gust
        M[:4, :4], M[:4, 4], M[:4, 5] = self.A, self.aileron, -self.rudder
        M[:4, 9] = self.A[:, 0]
        M[[4, 5], [4, 5]], M[[4, 5], [7, 8]] = -1.0 / self.servo_lag_s, 1.0 / self.servo_lag_s
        M[6, 3] = 1.0
        self._M, self._x = M, np.zeros(10)
        self._x[6] = math.radians(plan.heading_deg)
        self.set_dt(STEP_S)
        speed = self._speed
        self._rng: np.random.Generator | None = None
        commands = (f"fcs/{name}-cmd-norm" for name in ("rudder", "aileron", "elevator"))
        still = ("attitude/theta-rad", "velocities/q-rad_sec", "velocities/h-dot-fps", SEVERITY)
        self._own = dict.fromkeys((*commands, *still), 0.0) | {
            "fcs/throttle-cmd-norm": 0.5, "position/h-sl-ft": plan.altitude_ft,
            "velocities/vc-kts": speed / KNOT, "velocities/ve-kts": speed / KNOT,
            "velocities/vt-fps": speed / FOOT, "velocities/vg-fps": speed / FOOT,
        }  # fmt: skip

    def set_dt(self, step_s: float) -> None:
        """Set the length of a step, for which commands and gust are held."""
        self._step = expm(self._M * step_s)
        self._keep = math.exp(-step_s * self._speed / GUST_M)
        self._gust_rad = GUST_M_S / self._speed * math.sqrt(1.0 - self._keep**2)

    def run(self) -> None:
        """Propagate one step, in turbulence if a severity is set."""
        x, own = self._x, self._own
        x[7], x[8] = own["fcs/aileron-cmd-norm"], -own["fcs/rudder-cmd-norm"]
        if own[SEVERITY]:
            if self._rng is None:
                self._rng = np.random.default_rng(int(own["atmosphere/randomseed"]))
            x[9] = self._keep * x[9] + own[SEVERITY] * self._gust_rad * self._rng.normal()
        self._x = self._step @ x

    def __getitem__(self, name: str) -> float:
        """Return the present value of a property by its name in JSBSim."""
        if name in STATES:
            return float(self._x[STATES.index(name)])
        if name.startswith("attitude/psi"):
            return float(self._x[6] if name.endswith("rad") else math.degrees(self._x[6]))
        return self._own[name]

    def __setitem__(self, name: str, value: float) -> None:
        self._own[name] = value


def _matrices(own: Mapping[str, float]) -> tuple[Floats, Floats, Floats]:
    """Return A (4, 4) of STATES, and the columns (4,) of aileron and rudder, positive nose left."""
    A = np.array(
        [
            [own["Y_beta"], GRAVITY / own["airspeed_m_s"], 0.0, -1.0],
            [0.0, 0.0, 1.0, 0.0],
            [own["L_beta"], 0.0, own["L_p"], own["L_r"]],
            [own["N_beta"], 0.0, own["N_p"], own["N_r"]],
        ]
    )
    aileron = np.array([0.0, 0.0, own["L_delta_a"], own["N_delta_a"]])
    return A, aileron, -np.array([own["Y_delta_r"], 0.0, own["L_delta_r"], own["N_delta_r"]])
