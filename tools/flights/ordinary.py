"""Ordinary flights: an autopilot holds course, height and speed, and nobody moves the rudder.

The course turns by 20 to 110 degrees at times. The roll hold hears the noisy signals that ATTITUDE
reports. JSBSim flies at 100 Hz, or a small linear aircraft that is propagated exactly. The truth is
the bare aircraft's Dutch roll, linearised at the mean airspeed and altitude flown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfilt

from flights.flight import PITCH_GAIN, PITCH_RATE_GAIN, SENSED, jsbsim_rudder, stir, trimmed
from flights.fly import Made
from flights.linear import GRAVITY
from flights.moved import CONDITIONS, RATES_HZ, SEVERITIES
from flights.plan import FOOT, KNOT, LEAD_IN_S, SENSED_MS, FlightPlan, Floats, Place, plan_at
from flights.quiet import quiet
from flights.surgery import join
from flights.telemetry import Link, Played, telemetry
from flights.truth import LATERAL, dutch_roll, lateral, linear_dutch_rolls, mean_plan

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
        stir(fdm, self.link.seed, self.severity)
        return fdm

    def blow(self, fdm: Any) -> None:
        """Turn JSBSim's gusts into the aircraft's axes for the next step, if they are frozen.

        JSBSim turns them by the direction of the wind: here a wind of nearly nothing.
        """
        if self.frozen:
            heading = fdm[SENSED[PSI]]
            fdm["atmosphere/wind-north-fps"] = 1e-3 * math.cos(heading)
            fdm["atmosphere/wind-east-fps"] = -1e-3 * math.sin(heading)


def within(value: float, most: float) -> float:
    """Return a value, limited to ``most`` on both sides."""
    return min(max(value, -most), most)


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
    noises = rng.normal(size=(n // every + 1, 6)) * flight.link.sigmas
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


SECONDS, ON_GROUND_S = 900.0, 400.0
ON_GROUND = ("hover", "taxi", "tumble", "parked")
HIGHEST_FT = 4000.0
"""Above it, there is no turbulence of severity 1 or 2 (MIL-F-8785C)."""
GYROS = (0.001, 0.003, 0.006)
LAGS_S = (0.0, 0.03, 0.06, 0.1)
MIXES = (0.5, 0.0, 0.3, 0.0)
SMALL_WN, SMALL_ZETA, SMALL_ROLL_S = (3.0, 12.0), (0.12, 0.31), (0.06, 0.15)
SMALL_TURNS_S = (15.0, 45.0)
NOT_DAMPED = 9
"""The number of JSBSim's aircraft whose zeta is below .45: all but the last, an A320."""
AXES = {"line in p": "p", "line in r": "r", "line in p and r": "pr"}
NOT_FLOWN = "hover, taxi, tumble, parked"
FAMILIES = (
    *AXES, "limit cycle", "yaw damper", "no turns", NOT_FLOWN, "aileron of wrong scale",
    "roll late by .1 s", "r scaled",
)  # fmt: skip
"""The hostile families: lines in the signals of these axes, and what changes a flight otherwise."""
LINES = np.geomspace(0.3, 3.0, 11)
"""Frequencies of lines as multiples of wn."""


def _link(rng: np.random.Generator, hz: float, gyro: float) -> Link:
    """Return a link whose servo messages come at other times than the attitudes."""
    return Link(
        hz,
        hz,
        gyro,
        seed=int(rng.integers(1, 2**31)),
        servo_ms=int(rng.integers(5, int(1000 / hz))),
    )


def jsbsim(
    seed: int, number: int, seconds: float = SECONDS, places: Sequence[Place] = tuple(CONDITIONS)
) -> Ordinary:
    """Return flight ``number`` of a seed: aircraft and severity are a grid, rates come in turn."""
    rng = np.random.default_rng([seed, 0, number])
    names = list(dict.fromkeys(place[0] for place in places))
    turn, at = divmod(number, len(names))
    its = [place for place in places if place[0] == names[at]]
    speeds = [place[2] for place in its]
    knots = round(float(rng.uniform((min(speeds) + max(speeds)) / 2.0, max(speeds))), 1)
    plan = plan_at(
        (names[at], min(its[0][1], HIGHEST_FT), knots), seconds=seconds, manoeuvre="none"
    )
    step = turn + at
    return Ordinary(
        _gains(rng, plan),
        _link(rng, RATES_HZ[step % 3], GYROS[(at + 2 * turn) % 3]),
        severity=SEVERITIES[turn % 4],
        law=list(LAWS)[(step + turn // 3) % 3],
        mix=MIXES[(step + turn // 4) % 4],
        servo_lag_s=float(rng.choice(LAGS_S)),
        frozen=bool((at + turn // 2) % 2),
    )


def _gains(rng: np.random.Generator, plan: FlightPlan) -> FlightPlan:
    angle, rate = rng.uniform(0.6, 1.4), rng.uniform(0.4, 1.0)
    return replace(
        plan, heading_deg=float(rng.integers(0, 360)), roll_gain=round(angle * plan.roll_gain, 3),
        roll_rate_gain=round(rate * plan.roll_rate_gain, 4),
    )  # fmt: skip


def small(seed: int, number: int, seconds: float = SECONDS) -> Ordinary:
    """Return flight ``number`` of a seed by a small linear aircraft; their wn are spread evenly."""
    rng = np.random.default_rng([seed, 1, number])
    share = (number * 0.618034) % 1.0
    wn = SMALL_WN[0] * (SMALL_WN[1] / SMALL_WN[0]) ** share
    plan = replace(_small_aircraft(rng, wn), seconds=seconds)
    rates = [hz for hz in RATES_HZ if 2.5 * wn < 0.8 * math.pi * hz]
    return Ordinary(
        _gains(rng, plan),
        _link(rng, rates[number % len(rates)], 0.005),
        severity=SEVERITIES[number % 4],
        law=list(LAWS)[number // 3 % 3],
        mix=MIXES[number // 2 % 4],
        frozen=True,
        turns_s=SMALL_TURNS_S,
    )


def _small_aircraft(rng: np.random.Generator, wn: float) -> FlightPlan:
    """Return the plan of a small aircraft with a Dutch roll at about ``wn``."""
    while True:
        zeta, roll_s = (rng.uniform(*ends) for ends in (SMALL_ZETA, SMALL_ROLL_S))
        speed = rng.uniform(16.0, 22.0)
        own = {
            "airspeed_m_s": speed, "servo_lag_s": float(rng.choice(LAGS_S[1:])) / 2.0,
            "Y_beta": -rng.uniform(0.2, 0.6), "L_beta": -rng.uniform(0.5, 1.5) * wn**2,
            "L_p": -1.0 / roll_s, "L_r": rng.uniform(1.0, 3.0), "N_p": -rng.uniform(0.0, 0.6),
            "N_beta": rng.uniform(0.7, 1.0) * wn**2,
            "N_r": -2.0 * zeta * wn * rng.uniform(0.6, 1.1), "Y_delta_r": -0.1,
            "L_delta_a": rng.uniform(4.0, 7.0) / roll_s, "L_delta_r": -0.05 * wn**2,
            "N_delta_a": -rng.uniform(0.0, 2.0), "N_delta_r": 0.8 * wn**2,
        }  # fmt: skip
        hold = 2.5 / roll_s / own["L_delta_a"]
        plan = FlightPlan(
            "small", round(speed / KNOT, 2), 1000.0, manoeuvre="none",
            roll_gain=hold, roll_rate_gain=0.1 * hold, own=tuple(own.items()),
        )  # fmt: skip
        poles = np.linalg.eigvals(trimmed(plan).A)
        pair, real = poles[np.argmax(poles.imag)], poles.real[np.abs(poles.imag) < 1e-6]
        inside = (
            0.97 < abs(pair) / wn < 1.03
            and SMALL_ZETA[0] < -pair.real / abs(pair) < SMALL_ZETA[1]
            and SMALL_ROLL_S[0] < -1.0 / real.min() < SMALL_ROLL_S[1]
            and real.max() < 0.1
        )
        if inside:
            return plan


def hostile(seed: int, number: int, seconds: float = SECONDS) -> Made:
    """Return hostile log ``number`` of a seed: its family in turn, two of three by JSBSim."""
    nth, at = divmod(number, len(FAMILIES))
    family = FAMILIES[at]
    rng = np.random.default_rng([seed, 2, number])
    make, which = (small, number) if nth % 3 == 2 else (jsbsim, 10 * number + nth % NOT_DAMPED)
    if family != NOT_FLOWN:
        made = fly_ordinary(changed(family, rng, nth, make(seed, 1000 + which, seconds)))
    else:
        made = quiet(ON_GROUND[nth % 4], rng, lengths_s=(min(seconds, ON_GROUND_S),))
    assert made.truth is not None
    return Made(made.log, {"dutch_roll_open_loop": None} | made.truth | {"family": family})


def changed(family: str, rng: np.random.Generator, nth: int, flight: Ordinary) -> Ordinary:
    """Return a flight as the ``nth`` one of a hostile family."""
    match family:
        case "limit cycle":
            plan, hold = flight.plan, flight.plan.roll_gain
            stiff = replace(plan, roll_gain=2.5 * hold, roll_rate_gain=0.1 * hold)
            return replace(flight, plan=stiff, law="hold", backlash=0.03)
        case "yaw damper":
            added = rng.uniform(0.1, 0.4)  # of zeta
            wn, effect = _bare(flight)
            return replace(flight, damper=2.0 * added * wn / effect)
        case "no turns":
            return replace(flight, turns_s=None)
        case "aileron of wrong scale":
            return replace(flight, sent_aileron=(-1.0, 0.4, -0.6, 0.7)[nth % 4])
        case "roll late by .1 s":
            return replace(flight, late_ms=100)
        case "r scaled":
            return replace(flight, sent_r=(1.2, 0.8)[nth % 2])
    wn, _ = _bare(flight)
    w, share = float(LINES[nth % len(LINES)]) * wn, (0.3, 0.5, 1.0)[nth // 2 % 3]
    return replace(flight, line=(AXES[family], w, share))


def _bare(flight: Ordinary) -> tuple[float, float]:
    """Return wn in rad/s and N_delta_r of the bare aircraft at the plan's airspeed."""
    A, _, rudder = lateral(trimmed(flight.plan))
    mode = dutch_roll(A, rudder, LATERAL.index("R"))
    assert mode is not None
    return mode["wn_rad_s"], -float(rudder[LATERAL.index("R")])
