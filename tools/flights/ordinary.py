"""Ordinary flights: an autopilot holds course, height and speed, and nobody moves the rudder.

The course turns by 20 to 110 degrees at times. The roll hold hears the noisy signals that ATTITUDE
reports. JSBSim flies at 100 Hz, or a small linear aircraft that is propagated exactly. The truth is
the bare aircraft's Dutch roll, linearised at the mean airspeed and altitude flown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfilt

from flights.flight import (
    MILSPEC,
    PITCH_GAIN,
    PITCH_RATE_GAIN,
    SENSED,
    Floats,
    jsbsim_rudder,
    trimmed,
)
from flights.fly import Made
from flights.linear import GRAVITY, GUST_M, GUST_M_S, SEVERITY, LinearAircraft
from flights.plan import FOOT, KNOT, LEAD_IN_S, FlightPlan
from flights.surgery import join
from flights.telemetry import Link, telemetry
from flights.truth import LATERAL, dutch_roll, linear_dutch_rolls, mean_plan

STEP_S, LOOP_STEPS = 0.01, 2
"""The simulation's step, and the number of steps in one loop of the autopilot, which has 50 Hz."""
STEP_MS, LOOP_S = round(1000 * STEP_S), STEP_S * LOOP_STEPS
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
PHI, THETA, PSI, P, Q, R = range(6)
STATES = (
    *SENSED, "velocities/vc-kts", "position/h-sl-ft", "velocities/h-dot-fps", "velocities/vg-fps",
    "fcs/throttle-cmd-norm",
)  # fmt: skip
KT, FEET, CLIMB = range(6, 9)
LINE_HZ, TRIAL_S = 0.05, 120.0
"""Width of a line in the gyro's signals, and length of the flight that says how strong it is."""
SPAN_M = 2.0


@dataclass(frozen=True, slots=True)
class Ordinary:
    """An ordinary flight as data.

    ``own`` has the derivatives of a linear aircraft, named as in sealed.toml. ``plan.roll_gain``
    and ``roll_rate_gain`` are the first two gains of every law of LAWS. The rudder is ``mix`` times
    the aileron, less ``damper`` times the yaw rate without its steady part. ``frozen`` turns
    JSBSim's gusts from north and east into the aircraft's axes. ``backlash`` is half of the
    aileron's play. ``line`` is a narrow oscillation in the gyro's signals: the axes (of "pr"), its
    frequency in rad/s, its power as a share of the yaw rate's without the turns. ``turns_s`` are
    the least and the most time between turns; None: no turns.
    """

    plan: FlightPlan
    link: Link
    own: dict[str, float] | None = None
    severity: int = 0
    law: str = "hold"
    mix: float = 0.0
    damper: float = 0.0
    servo_lag_s: float = 0.0
    frozen: bool = False
    backlash: float = 0.0
    line: tuple[str, float, float] | None = None
    turns_s: tuple[float, float] | None = (35.0, 90.0)

    def start(self) -> Any:
        """Return the aircraft at trim, and in its turbulence."""
        fdm = SmallAircraft(self.own, self.plan) if self.own else trimmed(self.plan)
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


class SmallAircraft(LinearAircraft):
    """A linear aircraft in a frozen field of gusts, which yaws and rolls it too.

    The gust b = -v/V moves past the aircraft, which so feels the yaw rate r + b', where its span
    filters b'; the rolling gust is a process of its own (MIL-F-8785C). The weight acts by the sine
    of the roll: its difference from the roll is held for a step.
    """

    def __init__(self, own: dict[str, float], plan: FlightPlan) -> None:
        super().__init__(own, plan)
        small, rows = self._M, [LATERAL.index("P"), LATERAL.index("R")]
        self._M = np.zeros((13, 13))
        self._M[:10, :10] = small
        self._M[rows, 10], self._M[rows, 11] = self.A[rows, rows[1]], self.A[rows, rows[0]]
        self._M[0, 12] = GRAVITY / self._speed
        self._x = np.append(self._x, np.zeros(3))
        self._slow = 0.0

    def run(self) -> None:
        """Propagate one step."""
        x = self._x
        x[12] = math.sin(x[1]) - x[1]
        super().run()
        if self._rng is not None:
            x, span_s = self._x, 3.0 * SPAN_M / math.pi / self._speed
            self._slow -= math.expm1(-STEP_S / span_s) * (x[9] - self._slow)
            x[10] = (x[9] - self._slow) / span_s
            keep = math.exp(-STEP_S * self._speed * 2.6 / math.sqrt(GUST_M * SPAN_M))
            sigma = 1.9 / math.sqrt(GUST_M * SPAN_M) * GUST_M_S * self._own[SEVERITY]
            x[11] = keep * x[11] + sigma * math.sqrt(1.0 - keep**2) * self._rng.normal()


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
        self._sum = _within(self._sum + self._ki * miss * LOOP_S, MOST_INTEGRAL)
        self._slope += _share(DERIVATIVE_HZ) * ((miss - self._before) / LOOP_S - self._slope)
        self._before = miss
        return slow * self._ff * self._wanted + self._kp * miss + self._sum + self._kd * self._slope


def _share(corner_hz: float) -> float:
    """Return the share of a step that a filter of first order follows in one loop."""
    return -math.expm1(-math.tau * corner_hz * LOOP_S)


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)


class Flown:
    """An ordinary flight in the past: what telemetry sends, between the steps by interpolation.

    ``states`` (n, 11) are the true STATES at the steps, ``outputs`` (n, 2) the pulses of aileron
    and rudder in us, ``noises`` (n / LOOP_STEPS, 6) the noise of the sensors in each loop.
    """

    def __init__(self, plan: FlightPlan, states: Floats, outputs: Floats, noises: Floats) -> None:
        states[:, PSI] = np.unwrap(states[:, PSI])
        self.plan, self.states, self.outputs, self.noises = plan, states, outputs, noises
        self.advance_to(0)

    def advance_to(self, ms: int) -> None:
        """Advance to a millisecond after the start."""
        k, rest = divmod(ms, STEP_MS)
        here, there = self.states[k : k + 2]
        now = (here + rest / STEP_MS * (there - here)).tolist()
        self._now = dict(zip(STATES, now, strict=True)) | {"attitude/psi-deg": np.degrees(now[PSI])}
        self.aileron_us, self.rudder_us = self.outputs[k].astype(int).tolist()
        self.noise: list[float] | None = self.noises[k // LOOP_STEPS].tolist()

    def __getitem__(self, name: str) -> float:
        """Return the present value of a property by its name in JSBSim."""
        return float(self._now[name])

    def mode(self, flight: Ordinary) -> dict[str, float] | None:
        """Return the bare aircraft's Dutch roll at the mean airspeed and altitude flown."""
        if flight.own:
            small = SmallAircraft(flight.own, flight.plan)
            return dutch_roll(small.A, small.rudder, LATERAL.index("R"))
        times = np.arange(len(self.states)) * STEP_S
        flown = np.column_stack([times, self.states[:, [KT, FEET]]])[times > LEAD_IN_S]
        return linear_dutch_rolls(mean_plan(flight.plan, flown))["dutch_roll_open_loop"]


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
        """Return aileron and rudder in units; move elevator and throttle."""
        trim, flight = self._trim, self._flight
        if flight.own:
            course = sensed[PSI] + fdm["beta"]
        else:
            course = math.atan2(fdm["velocities/v-east-fps"], fdm["velocities/v-north-fps"])
        self._off -= math.remainder(course - self._before, math.tau)
        self._before = course
        if flight.turns_s and t_s > self._turn_s:
            self._off += math.radians(self._rng.uniform(20.0, 110.0)) * self._rng.choice([-1, 1])
            self._turn_s = t_s + self._rng.uniform(*flight.turns_s)
        self._bank += _within(
            _within(COURSE_GAIN * self._off, BANK) - self._bank, BANK_RATE * LOOP_S
        )
        kt, feet, climb = sensed[KT], sensed[FEET], sensed[CLIMB]
        error = trim[SENSED[PHI]] + self._bank - sensed[PHI]
        aileron = self._law(error, sensed[P], kt)
        self._slow += LOOP_S / WASHOUT_S * (sensed[R] - self._slow)
        rudder = flight.mix * aileron - flight.damper * (sensed[R] - self._slow)
        high, up = FOOT * (feet - trim[STATES[FEET]]), FOOT * climb
        nose = trim[SENSED[THETA]] - _within(0.004 * high + 0.006 * up, 0.12)
        nose += 0.5 * (1.0 / math.cos(_within(sensed[PHI], 0.8)) - 1.0)
        fdm["fcs/elevator-cmd-norm"] = _within(
            trim["fcs/elevator-cmd-norm"]
            + PITCH_GAIN * (sensed[THETA] - nose) + PITCH_RATE_GAIN * sensed[Q], 1.0
        )  # fmt: skip
        throttle = trim["fcs/throttle-cmd-norm"] + 0.03 * (trim[STATES[KT]] - kt)
        for engine in range(4):
            fdm[f"fcs/throttle-cmd-norm[{engine}]"] = min(max(throttle, 0.0), 1.0)
        return [self._aileron + aileron, self._rudder + rudder]


def flown(flight: Ordinary) -> Flown:
    """Fly.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed.
    """
    plan, fdm = flight.plan, flight.start()
    rng = np.random.default_rng([flight.link.seed, 47])
    autopilot = Autopilot(flight, fdm, rng)
    n = round(plan.seconds / STEP_S) + 2
    sigmas = [flight.link.angle_noise] * 3 + [flight.link.rate_noise] * 3
    noises = rng.normal(size=(n // LOOP_STEPS + 1, 6)) * sigmas
    if flight.line:
        _add_line(flight, noises, rng)
    follow = -math.expm1(-STEP_S / max(flight.servo_lag_s, 1e-9))
    states, outputs = np.zeros((n, len(STATES))), np.zeros((n, 2))
    moved: list[float] = []
    for k in range(n):
        now = [fdm[name] for name in STATES]
        if k % LOOP_STEPS == 0:
            noise = [*noises[k // LOOP_STEPS].tolist(), *[0.0] * len(STATES[KT:])]
            asked = autopilot(fdm, k * STEP_S, [a + b for a, b in zip(now, noise, strict=True)])
            servos = (plan.aileron, asked[0]), (plan.rudder, asked[1])
            pulses = [servo.pulse(unit) for servo, unit in servos]
            aileron, rudder = plan.aileron.unit(pulses[0]), plan.rudder.unit(pulses[1])
        states[k], outputs[k] = now, pulses
        played, *moved = moved or [aileron, aileron, rudder]
        gap = aileron - played
        played += gap - _within(gap, flight.backlash)
        moved = [
            played,
            *(a + follow * (b - a) for a, b in zip(moved, (played, rudder), strict=True)),
        ]
        fdm["fcs/aileron-cmd-norm"], fdm["fcs/rudder-cmd-norm"] = moved[1], jsbsim_rudder(moved[2])
        flight.blow(fdm)
        fdm.run()
    return Flown(plan, states, outputs, noises)


def _add_line(flight: Ordinary, noises: Floats, rng: np.random.Generator) -> None:
    """Add the flight's line to the noise of its gyro (n, 6)."""
    assert flight.line
    axes, wn_rad_s, share = flight.line
    trial = flown(replace(flight, line=None, plan=replace(flight.plan, seconds=TRIAL_S))).states
    r = trial[:, R] - GRAVITY / (KNOT * trial[:, KT]) * np.sin(trial[:, PHI])
    slow = sosfilt(butter(2, LINE_HZ / 2, fs=1.0 / LOOP_S, output="sos"),
                   rng.normal(size=(2, len(noises))))  # fmt: skip
    angle = wn_rad_s * LOOP_S * np.arange(len(noises))
    line = slow[0] * np.cos(angle) - slow[1] * np.sin(angle)
    line *= math.sqrt(share) * r.std() / line.std()
    for axis in axes:
        noises[:, {"p": P, "r": R}[axis]] += line


def fly_ordinary(
    flight: Ordinary, change: Callable[[Flown], None] | None = None, **facts: Any
) -> Made:
    """Fly; return the log, and the truth with the items of ``facts``.

    ``change`` alters what is sent of the flight, but not the flight.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed.
    """
    past = flown(flight)
    mode = past.mode(flight)
    if change:
        change(past)
    plan, link, line = flight.plan, flight.link, flight.line
    conditions = {
        "aircraft": plan.aircraft, "severity": flight.severity, "rate_hz": link.attitude_hz,
        "rudder": "mixed" if flight.mix else "resting", "mix": flight.mix, "law": flight.law,
        "roll_gain": plan.roll_gain, "roll_rate_gain": plan.roll_rate_gain,
        "servo_lag_s": flight.servo_lag_s, "frozen": flight.frozen, "damper": flight.damper,
        "backlash": flight.backlash, "line": line, "turns": flight.turns_s is not None,
        "rate_noise": link.rate_noise, "seconds": plan.seconds, "link_seed": link.seed,
        "airspeed_kt": round(float(past.states[:, KT].mean()), 2), "dutch_roll_open_loop": mode,
    }  # fmt: skip
    return Made(join(telemetry(link, past)), conditions | facts)
