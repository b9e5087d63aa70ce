"""Flies an aircraft of JSBSim with ArduPlane's yaw damper closed, and linearises it with it.

The damper has the noisy signals of the autopilot's sensors, runs at the loop's rate with the
washout of each call and the scaling by airspeed, and moves a servo that lags. Its equations are
written from ArduPlane's source, not taken from src/yawid/damper, which they check.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flights.flight import Flight, Hands, trimmed
from flights.plan import KNOT, STEP_S, FlightPlan
from flights.telemetry import Link
from flights.truth import LATERAL, dutch_roll, lateral

GRAVITY = 9.80665
KEPT = 0.9960080
"""The part of its output that the washout keeps at each call."""
UNITS = 180.0 / math.pi / 45.0
"""Units of rudder per rad/s: the damper works in degrees, of which 45 are one unit."""


@dataclass(frozen=True, slots=True)
class Damper:
    """ArduPlane's damper: its parameters, and the lag of the servo in s."""

    gain: float
    loop_hz: int
    scaling_m_s: float
    servo_lag_s: float
    turn: float = 1.0

    def parameters(self) -> tuple[tuple[str, float], ...]:
        """Return the parameters of the autopilot."""
        return (
            ("YAW2SRV_DAMP", self.gain), ("YAW2SRV_RLL", self.turn), ("YAW2SRV_INT", 0.0),
            ("YAW2SRV_SLIP", 0.0), ("YAW_RATE_ENABLE", 0.0), ("SCALING_SPEED", self.scaling_m_s),
            ("AIRSPEED_MIN", 0.6 * self.scaling_m_s), ("AIRSPEED_MAX", 2.0 * self.scaling_m_s),
            ("SCHED_LOOP_RATE", float(self.loop_hz)),
        )  # fmt: skip

    def scaler(self, airspeed_m_s: float) -> float:
        """Return the factor of the rudder at an airspeed."""
        speed = self.scaling_m_s
        low, high = min(0.5, speed / (4.0 * speed)), max(2.0, speed / (0.7 * 0.6 * speed))
        return min(max(speed / airspeed_m_s, low), high)


class DampedFlight(Flight):
    """A flight with the damper closed."""

    def __init__(self, plan: FlightPlan, hands: Hands, link: Link, damper: Damper) -> None:
        self._damper, self._part = damper, 0.0
        self._before = self._washed = 0.0
        self._servo: float | None = None
        super().__init__(replace(plan, parameters=damper.parameters()), hands, link)

    def _commands(self) -> tuple[float, float, float]:
        rudder, aileron, elevator = super()._commands()
        damper = self._damper
        if self.ms % (1000 // damper.loop_hz) == 0:
            speed = max(self["velocities/vc-kts"] * KNOT, 1.0)
            error = self.sensed(5) - GRAVITY / speed * math.sin(self.sensed(0)) * damper.turn
            self._washed = KEPT * self._washed + error - self._before
            self._before = error
            self._part = -UNITS * damper.gain * damper.scaler(speed) ** 2 * self._washed
        return rudder + self._part, aileron, elevator

    def _moved(self, rudder: float) -> float:
        if self._servo is None or self._damper.servo_lag_s == 0.0:
            self._servo = rudder
        self._servo += (rudder - self._servo) * -math.expm1(
            -STEP_S / max(self._damper.servo_lag_s, 1e-9)
        )
        return self._servo


@dataclass(frozen=True, slots=True)
class Linear:
    """The lateral motion at a trim: A (5, 5) of beta, roll, p, r and the servo, and b (5,)."""

    A: NDArray[np.float64]
    b: NDArray[np.float64]
    airspeed_m_s: float

    def closed(self, damper: Damper) -> NDArray[np.float64]:
        """Return the matrix (8, 8) with the damper: washout, and its delay by a second Pade."""
        speed = self.airspeed_m_s
        rate = np.zeros(5)
        rate[LATERAL.index("R")] = 1.0
        rate[LATERAL.index("Phi")] = -GRAVITY / speed * damper.turn
        washout = -math.log(KEPT) * damper.loop_hz
        k = UNITS * damper.gain * damper.scaler(speed) ** 2
        T = 0.5 / damper.loop_hz
        # Pade (2, 2): 1 - 12 s / T / (s^2 + 6 s / T + 12 / T^2), as two states in canonical form.
        pade = np.array([[0.0, 1.0], [-12.0 / T**2, -6.0 / T]])
        M = np.zeros((8, 8))
        M[:5, :5] = self.A
        M[5, :5], M[5, 5] = washout * rate, -washout
        M[6:, 6:] = pade
        M[7, :5], M[7, 5] = rate, -1.0
        delayed = np.zeros(8)
        delayed[:5], delayed[5] = rate, -1.0
        delayed[7] = -12.0 / T
        M[:5] -= k * np.outer(self.b, delayed)
        return M

    def dutch_roll(self, damper: Damper) -> complex:
        """Return the closed Dutch roll's pole, followed from a gain of 0 in small steps."""
        start = dutch_roll(self.A, self.b, LATERAL.index("R"))
        assert start is not None
        wn, zeta = start["wn_rad_s"], start["zeta"]
        pole = wn * complex(-zeta, math.sqrt(1.0 - zeta**2))
        for share in np.linspace(0.0, 1.0, 41):
            poles = np.linalg.eigvals(self.closed(replace(damper, gain=share * damper.gain)))
            pole = complex(poles[np.argmin(np.abs(poles - pole))])
        return pole


def linear(plan: FlightPlan, servo_lag_s: float) -> Linear:
    """Return the linearised lateral motion at a plan's trim, with roll hold and a servo's lag."""
    fdm = trimmed(plan)
    A4, aileron, rudder = lateral(fdm)
    hold = np.zeros(len(LATERAL))
    hold[LATERAL.index("Phi")], hold[LATERAL.index("P")] = plan.roll_gain, plan.roll_rate_gain
    A, b = np.zeros((5, 5)), np.zeros(5)
    A[:4, :4], A[:4, 4] = A4 - np.outer(aileron, hold), -rudder
    A[4, 4], b[4] = -1.0 / servo_lag_s, 1.0 / servo_lag_s
    return Linear(A, b, float(fdm["velocities/vc-kts"]) * KNOT)
