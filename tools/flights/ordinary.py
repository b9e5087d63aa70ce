"""Ordinary flights: an autopilot holds course, height and speed, and nobody moves the rudder.

The course turns by 20 to 110 degrees at times. The roll hold hears the noisy signals that ATTITUDE
reports. JSBSim flies at 100 Hz, or a small linear aircraft that is propagated exactly. The truth is
the bare aircraft's Dutch roll, linearised at the mean airspeed and altitude flown.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfilt

from flights.drawn import Played
from flights.flight import (
    MILSPEC,
    PITCH_GAIN,
    PITCH_RATE_GAIN,
    SENSED,
    SENSED_MS,
    Floats,
    jsbsim_rudder,
    trimmed,
)
from flights.fly import Made, within
from flights.linear import GRAVITY, SEVERITY
from flights.plan import FOOT, KNOT, LEAD_IN_S, FlightPlan
from flights.surgery import join
from flights.telemetry import Link, telemetry
from flights.truth import linear_dutch_rolls, mean_plan

STEP_S, STEP_MS, LOOP_S = 0.01, 10, 0.001 * SENSED_MS
"""The step of the simulation, and that of the autopilot's loop."""
LAWS = {
    "hold": (1.0, 0.0, 0.0, 0.0),
    "arduplane": (0.5, 3.0, 1.9, 0.03),
    "px4": (0.4, 0.0, 2.0, 0.0),
}
"""The roll laws: time constant in s from angle to rate, corner in Hz of the filter of the wanted
rate (0: none), integral and derivative as shares of the rate's gain. Those named after an autopilot
have the structure of its source and the ratios of its default gains."""
DERIVATIVE_HZ, MOST_INTEGRAL = 12.0, 0.3
BANK, BANK_RATE, COURSE_GAIN = 0.42, 0.35, 0.8
"""Limits of the bank in rad and of its rate in rad/s, and bank per rad of course."""
WASHOUT_S = 3.0
PHI, THETA, PSI, P, Q, R, KT, FEET, CLIMB = range(9)
STATES = (
    *SENSED, "velocities/vc-kts", "position/h-sl-ft", "velocities/h-dot-fps", "velocities/vg-fps",
    "fcs/throttle-cmd-norm",
)  # fmt: skip
LINE_HZ, TRIAL_S = 0.05, 120.0
"""Width of a line in the gyro's signals, and length of the flight that says how strong it is."""


@dataclass(frozen=True, slots=True)
class Ordinary:
    """An ordinary flight as data.

    ``plan.roll_gain`` and ``roll_rate_gain`` are the first two gains of every law of LAWS. The
    rudder is ``mix`` times the aileron, less ``damper`` times the yaw rate without its steady part.
    ``frozen`` turns JSBSim's gusts from north and east into the aircraft's axes. ``backlash`` is
    half of the aileron's play. ``line`` is a narrow oscillation in the gyro's signals: the axes (of
    "pr"), its frequency in rad/s, its power as a share of the yaw rate's without the turns.
    ``turns_s`` are the least and the most time between turns; None: no turns. What is sent is the
    aileron times ``sent_aileron`` and r times ``sent_r``, and the roll of ``late_ms`` before.
    """

    plan: FlightPlan
    link: Link
    severity: int = 0
    law: str = "hold"
    mix: float = 0.0
    damper: float = 0.0
    servo_lag_s: float = 0.0
    frozen: bool = False
    backlash: float = 0.0
    line: tuple[str, float, float] | None = None
    turns_s: tuple[float, float] | None = (35.0, 90.0)
    sent_aileron: float = 1.0
    sent_r: float = 1.0
    late_ms: int = 0

    def start(self) -> Any:
        """Return the aircraft at trim, and in its turbulence."""
        fdm = trimmed(self.plan)
        fdm.set_dt(STEP_S)
        fdm["propulsion/fuel_freeze"] = 1.0  # the mass stays that of the truth
        fdm["atmosphere/randomseed"] = self.link.seed
        fdm["atmosphere/turb-type"] = MILSPEC
        fdm[SEVERITY] = self.severity
        return fdm

    def blow(self, fdm: Any) -> None:
        """Turn JSBSim's gusts into the aircraft's axes for the next step, if they are frozen.

        JSBSim turns them by the direction of the wind: here a wind of nearly nothing.
        """
        if self.frozen:
            heading = fdm[SENSED[PSI]]
            fdm["atmosphere/wind-north-fps"] = 1e-3 * math.cos(heading)
            fdm["atmosphere/wind-east-fps"] = -1e-3 * math.sin(heading)


class RollLaw:
    """A roll law of LAWS: aileron = FF w + kp m + the integral and the derivative of m.

    w is the wanted rate, the error of the angle by the time constant and behind a filter, and m is
    w less the roll rate. FF is such that the gain of the angle is ``roll_gain``. The gains of an
    autopilot's law vary with the airspeed: FF as 1/V, the others as 1/V^2.
    """

    def __init__(self, name: str, plan: FlightPlan) -> None:
        self._tau_s, corner_hz, integral, derivative = LAWS[name]
        self._kp, self._ff = plan.roll_rate_gain, plan.roll_gain * self._tau_s - plan.roll_rate_gain
        self._ki, self._kd = integral * self._kp, derivative * self._kp
        self._soften = _share(corner_hz) if corner_hz else 1.0
        self._speed_kt = plan.speed_kt if self._ki else 0.0
        self._wanted = self._sum = self._before = self._slope = 0.0

    def __call__(self, error: float, p: float, kt: float) -> float:
        """Return the aileron about trim, for an error of the roll in rad and p in rad/s."""
        slow = self._speed_kt / kt if self._speed_kt else 1.0
        self._wanted += self._soften * (error / self._tau_s - self._wanted)
        miss = slow**2 * (self._wanted - p)
        self._sum = within(self._sum + self._ki * miss * LOOP_S, MOST_INTEGRAL)
        self._slope += _share(DERIVATIVE_HZ) * ((miss - self._before) / LOOP_S - self._slope)
        self._before = miss
        return slow * self._ff * self._wanted + self._kp * miss + self._sum + self._kd * self._slope


def _share(corner_hz: float) -> float:
    """Return the share of a step that a filter of first order follows in one loop."""
    return -math.expm1(-math.tau * corner_hz * LOOP_S)


class Autopilot:
    """The loop of an ordinary flight: it turns the course, and holds course, height and speed."""

    def __init__(self, flight: Ordinary, fdm: Any, rng: np.random.Generator) -> None:
        self._flight, self._law, self._rng = flight, RollLaw(flight.law, flight.plan), rng
        self._trim = {name: fdm[name] for name in (*STATES, "fcs/elevator-cmd-norm")}
        self._aileron = fdm["fcs/aileron-cmd-norm"]
        self._rudder = jsbsim_rudder(fdm["fcs/rudder-cmd-norm"])
        self._turn_s = 20.0 if flight.turns_s else math.inf
        self._off = self._bank = self._slow = 0.0
        self._before = math.radians(flight.plan.heading_deg)

    def __call__(self, fdm: Any, t_s: float, sensed: list[float]) -> list[float]:
        """Return the outputs of aileron and rudder in units; move elevator and throttle."""
        trim, flight = self._trim, self._flight
        course = math.atan2(fdm["velocities/v-east-fps"], fdm["velocities/v-north-fps"])
        self._off -= math.remainder(course - self._before, math.tau)
        self._before = course
        if flight.turns_s and t_s > self._turn_s:
            self._off += math.radians(self._rng.uniform(20.0, 110.0)) * self._rng.choice([-1, 1])
            self._turn_s = t_s + self._rng.uniform(*flight.turns_s)
        self._bank += within(within(COURSE_GAIN * self._off, BANK) - self._bank, BANK_RATE * LOOP_S)
        kt, feet, climb = sensed[KT], sensed[FEET], sensed[CLIMB]
        error = trim[SENSED[PHI]] + self._bank - sensed[PHI]
        aileron = self._law(error, sensed[P], kt)
        self._slow += LOOP_S / WASHOUT_S * (sensed[R] - self._slow)
        rudder = flight.mix * aileron - flight.damper * (sensed[R] - self._slow)
        high, up = FOOT * (feet - trim[STATES[FEET]]), FOOT * climb
        nose = trim[SENSED[THETA]] - within(0.004 * high + 0.006 * up, 0.12)
        nose += 0.5 * (1.0 / math.cos(within(sensed[PHI], 0.8)) - 1.0)
        fdm["fcs/elevator-cmd-norm"] = within(
            trim["fcs/elevator-cmd-norm"]
            + PITCH_GAIN * (sensed[THETA] - nose) + PITCH_RATE_GAIN * sensed[Q], 1.0
        )  # fmt: skip
        throttle = trim["fcs/throttle-cmd-norm"] + 0.03 * (trim[STATES[KT]] - kt)
        for engine in range(4):
            fdm[f"fcs/throttle-cmd-norm[{engine}]"] = min(max(throttle, 0.0), 1.0)
        asked = (
            (self._aileron + aileron, flight.plan.aileron),
            (self._rudder + rudder, flight.plan.rudder),
        )
        return [servo.unit(servo.pulse(unit)) for unit, servo in asked]


def flown(flight: Ordinary) -> tuple[Floats, Floats, Floats]:
    """Fly; return the true STATES (n, 11), the outputs (n, 2) in units, and the noises (m, 6).

    The outputs are aileron and rudder at each step; the noises are those of the sensors in each
    loop.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed.
    """
    plan, fdm = flight.plan, flight.start()
    rng = np.random.default_rng([flight.link.seed, 47])
    autopilot = Autopilot(flight, fdm, rng)
    n, every = round(plan.seconds / STEP_S) + 2, SENSED_MS // STEP_MS
    sigmas = [flight.link.angle_noise] * 3 + [flight.link.rate_noise] * 3
    noises = rng.normal(size=(n // every + 1, 6)) * sigmas
    if flight.line:
        _add_line(flight, noises, rng)
    follow = -math.expm1(-STEP_S / max(flight.servo_lag_s, 1e-9))
    states, outputs = np.zeros((n, len(STATES))), np.zeros((n, 2))
    moved: list[float] = []
    for k in range(n):
        states[k] = [fdm[name] for name in STATES]
        if k % every == 0:
            sensed = states[k].copy()
            sensed[: len(SENSED)] += noises[k // every]
            aileron, rudder = autopilot(fdm, k * STEP_S, sensed.tolist())
        outputs[k] = aileron, rudder
        played, *moved = moved or [aileron, aileron, rudder]
        gap = aileron - played
        played += gap - within(gap, flight.backlash)
        now = zip(moved, (played, rudder), strict=True)
        moved = [played, *(at + follow * (to - at) for at, to in now)]
        fdm["fcs/aileron-cmd-norm"], fdm["fcs/rudder-cmd-norm"] = moved[1], jsbsim_rudder(moved[2])
        flight.blow(fdm)
        fdm.run()
    return states, outputs, noises


def _add_line(flight: Ordinary, noises: Floats, rng: np.random.Generator) -> None:
    """Add the flight's line to the noise of its gyro (n, 6)."""
    assert flight.line
    axes, wn_rad_s, share = flight.line
    trial, _, _ = flown(replace(flight, line=None, plan=replace(flight.plan, seconds=TRIAL_S)))
    r = trial[:, R] - GRAVITY / (KNOT * trial[:, KT]) * np.sin(trial[:, PHI])
    low = butter(2, LINE_HZ / 2, fs=1.0 / LOOP_S, output="sos")
    slow = sosfilt(low, rng.normal(size=(2, len(noises))))
    angle = wn_rad_s * LOOP_S * np.arange(len(noises))
    line = slow[0] * np.cos(angle) - slow[1] * np.sin(angle)
    line *= math.sqrt(share) * r.std() / line.std()
    for axis in axes:
        noises[:, {"p": P, "r": R}[axis]] += line


def fly_ordinary(flight: Ordinary) -> Made:
    """Fly; return the log and its truth, which has the flight's conditions.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed.
    """
    plan, (states, outputs, noises) = flight.plan, flown(flight)
    path = np.column_stack([np.arange(len(states)) * STEP_S, states[:, [KT, FEET]]])
    mean = mean_plan(plan, path[path[:, 0] > LEAD_IN_S])
    states[:, PSI] = np.unwrap(states[:, PSI])
    states[:, R] *= flight.sent_r
    noises[:, R] *= flight.sent_r
    late = flight.late_ms // STEP_MS
    states[late:, PHI] = states[: len(states) - late, PHI].copy()
    sent = {"aileron": flight.sent_aileron * outputs[:, 0], "rudder": outputs[:, 1]}
    past = Played(plan, dict(zip(STATES, states.T, strict=True)), sent, STEP_MS, noises)
    truth = {
        "aircraft": plan.aircraft, "rate_hz": flight.link.attitude_hz,
        "rudder": "mixed" if flight.mix else "resting", "mean_kt": mean.speed_kt,
        "dutch_roll_open_loop": linear_dutch_rolls(mean)["dutch_roll_open_loop"],
    }  # fmt: skip
    return Made(join(telemetry(flight.link, past)), truth | asdict(flight))
