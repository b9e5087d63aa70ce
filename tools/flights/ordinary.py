"""Ordinary flights: an autopilot holds course, height and speed; no rudder is moved on purpose.

The course turns by 20 to 110 degrees at times. The roll hold hears the noisy signals that ATTITUDE
reports. JSBSim flies at 100 Hz, or a small linear aircraft that is propagated exactly. The truth is
the bare aircraft's Dutch roll, linearised at the mean airspeed and altitude flown.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfilt

from flights.flight import PITCH_GAIN, PITCH_RATE_GAIN, jsbsim_rudder, put, stir, trimmed
from flights.fly import Made
from flights.linear import GRAVITY
from flights.moved import CONDITIONS, RATES_HZ, SEVERITIES
from flights.plan import (
    FOOT,
    KNOT,
    LEAD_IN_S,
    SENSED,
    SENSED_MS,
    FlightPlan,
    Floats,
    Link,
    Place,
    plan_at,
)
from flights.quiet import quiet
from flights.surgery import join
from flights.telemetry import Played, telemetry
from flights.truth import LATERAL, dutch_roll, lateral, linear_dutch_rolls, mean_plan

STEP_S, STEP_MS, LOOP_S = 0.01, 10, 0.001 * SENSED_MS
"""The step of the simulation, and that of the autopilot's loop."""
LAWS = {
    "hold": (1.0, math.inf, 0.0, 0.0),
    "arduplane": (0.5, 3.0, 1.9, 0.03),
    "px4": (0.4, math.inf, 2.0, 0.0),
}
"""The roll laws: time constant in s from angle to rate, corner in Hz of the filter of the wanted
rate (inf: none), integral and derivative as shares of the rate's gain. Those named after an
autopilot have the structure of its source and the ratios of its default gains."""
PHI, THETA, PSI, P, Q, R, KT, FEET = range(8)
AILERON, ELEVATOR, RUDDER, THROTTLE = (
    f"fcs/{name}-cmd-norm" for name in ("aileron", "elevator", "rudder", "throttle")
)
STATES = (
    *SENSED, "velocities/vc-kts", "position/h-sl-ft", "velocities/h-dot-fps", "velocities/vg-fps",
    THROTTLE,
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
    P and R), its frequency in rad/s, its power as a share of the yaw rate's without the turns.
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
    line: tuple[tuple[int, ...], float, float] | None = None
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
            put(fdm, {
                "atmosphere/wind-north-fps": 1e-3 * math.cos(fdm[STATES[PSI]]),
                "atmosphere/wind-east-fps": -1e-3 * math.sin(fdm[STATES[PSI]]),
            })  # fmt: skip


def within(value: float, most: float) -> float:
    """Return a value, limited to ``most`` on both sides."""
    return min(max(value, -most), most)


def roll_law(name: str, plan: FlightPlan) -> Callable[[float, float, float], float]:
    """Return a roll law of LAWS: its aileron about trim for a roll error in rad, p in rad/s, kt.

    aileron = FF w + kp m + the integral and the derivative of m: w is the wanted rate, the error of
    the angle by the time constant and behind a filter, and m is w less the roll rate. FF is such
    that the gain of the angle is ``roll_gain``. The integral ends at .3, and the derivative has a
    filter of 12 Hz. The gains of an autopilot's law vary with the airspeed: FF as 1/V, the others
    as 1/V^2.
    """
    tau_s, corner_hz, integral, derivative = LAWS[name]
    kp, ff = plan.roll_rate_gain, plan.roll_gain * tau_s - plan.roll_rate_gain
    soft, quick = (-math.expm1(-math.tau * hz * LOOP_S) for hz in (corner_hz, 12.0))
    wanted = total = before = slope = 0.0

    def aileron(error: float, p: float, kt: float) -> float:
        nonlocal wanted, total, before, slope
        slow = plan.speed_kt / kt if integral else 1.0
        wanted += soft * (error / tau_s - wanted)
        miss = slow**2 * (wanted - p)
        total = within(total + integral * kp * miss * LOOP_S, 0.3)
        slope += quick * ((miss - before) / LOOP_S - slope)
        before = miss
        return slow * ff * wanted + kp * miss + total + derivative * kp * slope

    return aileron


def autopilot(
    flight: Ordinary, fdm: Any, rng: np.random.Generator
) -> Callable[[float, list[float]], list[float]]:
    """Return the loop of a flight: it turns the course, and holds course, height and speed.

    It is called with the time in s and STATES as they are sensed, moves elevator and throttle, and
    returns the outputs of aileron and rudder in units.
    """
    plan, law = flight.plan, roll_law(flight.law, flight.plan)
    trim = {name: fdm[name] for name in (*STATES, AILERON, ELEVATOR, RUDDER)}
    off = bank = slow = 0.0
    before, turn_s = math.radians(plan.heading_deg), 20.0

    def outputs(t_s: float, sensed: list[float]) -> list[float]:
        nonlocal off, bank, slow, before, turn_s
        phi, theta, _, p, q, r, kt, feet, climb, *_ = sensed
        course = math.atan2(fdm["velocities/v-east-fps"], fdm["velocities/v-north-fps"])
        off -= math.remainder(course - before, math.tau)
        before = course
        if flight.turns_s and t_s > turn_s:
            off += math.radians(rng.uniform(20.0, 110.0)) * rng.choice([-1, 1])
            turn_s = t_s + rng.uniform(*flight.turns_s)
        # .8 of bank per rad of course, up to .42 rad, at .35 rad/s.
        bank += within(within(0.8 * off, 0.42) - bank, 0.35 * LOOP_S)
        aileron = law(trim[STATES[PHI]] + bank - phi, p, kt)
        slow += LOOP_S / 3.0 * (r - slow)  # a washout of 3 s
        rudder = flight.mix * aileron - flight.damper * (r - slow)
        nose = (
            trim[STATES[THETA]]
            - within(0.004 * (FOOT * (feet - trim[STATES[FEET]])) + 0.006 * (FOOT * climb), 0.12)
            + 0.5 * (1.0 / math.cos(within(phi, 0.8)) - 1.0)
        )
        pull = trim[ELEVATOR] + PITCH_GAIN * (theta - nose) + PITCH_RATE_GAIN * q
        throttle = min(max(trim[THROTTLE] + 0.03 * (trim[STATES[KT]] - kt), 0.0), 1.0)
        put(fdm, {ELEVATOR: within(pull, 1.0)} | {f"{THROTTLE}[{i}]": throttle for i in range(4)})
        return [
            plan.aileron.unit(plan.aileron.pulse(trim[AILERON] + aileron)),
            plan.rudder.unit(plan.rudder.pulse(jsbsim_rudder(trim[RUDDER]) + rudder)),
        ]

    return outputs


def flown(flight: Ordinary) -> tuple[Floats, Floats, Floats]:
    """Fly; return the true STATES (n, 11), the outputs (n, 2) in units, and the noises (m, 6).

    The outputs are aileron and rudder at each step; the noises are those of the sensors in each
    loop.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed.
    """
    fdm, rng = flight.start(), np.random.default_rng([flight.link.seed, 47])
    steer = autopilot(flight, fdm, rng)
    n, every = round(flight.plan.seconds / STEP_S) + 2, SENSED_MS // STEP_MS
    noises = rng.normal(size=(n // every + 1, 6)) * flight.link.sigmas
    if flight.line:
        axes, wn_rad_s, share = flight.line
        angle = wn_rad_s * LOOP_S * np.arange(len(noises), dtype=np.float64)
        noises[:, axes] += _line(flight, rng, angle, share)
    follow = -math.expm1(-STEP_S / max(flight.servo_lag_s, 1e-9))
    states, outputs = np.zeros((n, len(STATES))), np.zeros((n, 2))
    play = np.array([flight.backlash, 0.0])
    shafts = moved = outputs[0]  # a view: as the autopilot begins
    for k in range(n):
        states[k] = [fdm[name] for name in STATES]
        if k % every == 0:
            outputs[k : k + every] = steer(
                k * STEP_S,
                [*(states[k, :6] + noises[k // every]).tolist(), *states[k, 6:].tolist()],
            )
        shafts = np.clip(shafts, outputs[k] - play, outputs[k] + play)
        moved = moved + follow * (shafts - moved)
        fdm[AILERON], fdm[RUDDER] = moved[0], jsbsim_rudder(moved[1])
        flight.blow(fdm)
        fdm.run()
    return states, outputs, noises


def _line(flight: Ordinary, rng: np.random.Generator, angle: Floats, share: float) -> Floats:
    """Return a line (n, 1) with this share of the flight's yaw rate, at angles (n,) in rad."""
    trial, _, _ = flown(replace(flight, line=None, plan=replace(flight.plan, seconds=TRIAL_S)))
    r = trial[:, R] - GRAVITY / (KNOT * trial[:, KT]) * np.sin(trial[:, PHI])
    low = butter(2, LINE_HZ / 2, fs=1.0 / LOOP_S, output="sos")
    slow = sosfilt(low, rng.normal(size=(2, len(angle))))
    line = slow[0] * np.cos(angle) - slow[1] * np.sin(angle)
    return np.asarray(line * (math.sqrt(share) * r.std() / line.std()))[:, None]


def fly_ordinary(flight: Ordinary) -> Made:
    """Fly; return the log and its truth, which has the flight's conditions.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed.
    """
    plan, (states, outputs, noises) = flight.plan, flown(flight)
    path = np.column_stack([np.arange(len(states)) * STEP_S, states[:, [KT, FEET]]])
    mean = mean_plan(plan, path[path[:, 0] > LEAD_IN_S])
    states[:, PSI] = np.unwrap(states[:, PSI])
    for each in (states, noises):
        each[:, R] *= flight.sent_r
    late = flight.late_ms // STEP_MS
    states[late:, PHI] = states[: len(states) - late, PHI].copy()
    past = Played(
        plan,
        dict(zip(STATES, states.T, strict=True)),
        {"aileron": flight.sent_aileron * outputs[:, 0], "rudder": outputs[:, 1]},
        STEP_MS,
        noises,
    )
    return Made(join(telemetry(flight.link, past)), {
        "aircraft": plan.aircraft, "rate_hz": flight.link.attitude_hz,
        "rudder": "mixed" if flight.mix else "resting", "mean_kt": mean.speed_kt,
        "dutch_roll_open_loop": linear_dutch_rolls(mean)["dutch_roll_open_loop"],
    } | asdict(flight))  # fmt: skip


LAGS_S = (0.0, 0.03, 0.06, 0.1)
MIXES = (0.5, 0.0, 0.3, 0.0)
SMALL_ZETA, SMALL_ROLL_S = (0.12, 0.31), (0.06, 0.15)
AXES = {"line in p": (P,), "line in r": (R,), "line in p and r": (P, R)}
NOT_FLOWN = "hover, taxi, tumble, parked"
FAMILIES = (
    *AXES, "limit cycle", "yaw damper", "no turns", NOT_FLOWN, "aileron of wrong scale",
    "roll late by .1 s", "r scaled",
)  # fmt: skip
"""The hostile families: lines in the signals of these axes, and what changes a flight otherwise."""


def _drawn(rng: np.random.Generator, plan: FlightPlan, hz: float, gyro: float) -> Ordinary:
    """Return a flight with a drawn roll hold, heading and seed; servos are sent at a drawn time."""
    return Ordinary(
        replace(
            plan,
            roll_gain=round(rng.uniform(0.6, 1.4) * plan.roll_gain, 3),
            roll_rate_gain=round(rng.uniform(0.4, 1.0) * plan.roll_rate_gain, 4),
            heading_deg=float(rng.integers(0, 360)),
        ),
        Link(
            hz,
            hz,
            gyro,
            seed=int(rng.integers(1, 2**31)),
            servo_ms=int(rng.integers(5, int(1000 / hz))),
        ),
    )


def jsbsim(
    seed: int, number: int, seconds: float, places: Sequence[Place] = tuple(CONDITIONS)
) -> Ordinary:
    """Return flight ``number`` of a seed: aircraft and severity are a grid, rates come in turn."""
    rng = np.random.default_rng([seed, 0, number])
    names = list(dict.fromkeys(place[0] for place in places))
    turn, at = divmod(number, len(names))
    its = [place for place in places if place[0] == names[at]]
    (name, feet, slow), (_, _, fast) = min(its), max(its)
    knots = round(float(rng.uniform((slow + fast) / 2.0, fast)), 1)
    # Above 4000 ft there is no turbulence of severity 1 or 2 (MIL-F-8785C).
    plan = plan_at((name, min(feet, 4000.0), knots), seconds=seconds, manoeuvre="none")
    step = turn + at
    return replace(
        _drawn(rng, plan, RATES_HZ[step % 3], (0.001, 0.003, 0.006)[(at + 2 * turn) % 3]),
        severity=SEVERITIES[turn % 4],
        law=list(LAWS)[(step + turn // 3) % 3],
        mix=MIXES[(step + turn // 4) % 4],
        servo_lag_s=float(rng.choice(LAGS_S)),
        frozen=bool((at + turn // 2) % 2),
    )


def small(seed: int, number: int, seconds: float) -> Ordinary:
    """Return flight ``number`` of a seed by a small linear aircraft.

    Their wn are spread evenly over 3 to 12 rad/s.
    """
    rng = np.random.default_rng([seed, 1, number])
    wn = 3.0 * 4.0 ** (number * 0.618034 % 1.0)
    rates = [hz for hz in RATES_HZ if 2.5 * wn < 0.8 * math.pi * hz]
    return replace(
        _drawn(rng, _small_aircraft(rng, wn, seconds), rates[number % len(rates)], 0.005),
        severity=SEVERITIES[number % 4],
        law=list(LAWS)[number // 3 % 3],
        mix=MIXES[number // 2 % 4],
        frozen=True,
        turns_s=(15.0, 45.0),
    )


def _small_aircraft(rng: np.random.Generator, wn: float, seconds: float) -> FlightPlan:
    """Return the plan of a small aircraft with a Dutch roll at about ``wn``."""
    while True:
        zeta, roll_s = (rng.uniform(*ends) for ends in (SMALL_ZETA, SMALL_ROLL_S))
        own = {
            "airspeed_m_s": rng.uniform(16.0, 22.0),
            "servo_lag_s": float(rng.choice(LAGS_S[1:])) / 2.0,
            "Y_beta": -rng.uniform(0.2, 0.6), "L_beta": -rng.uniform(0.5, 1.5) * wn**2,
            "L_p": -1.0 / roll_s, "L_r": rng.uniform(1.0, 3.0), "N_p": -rng.uniform(0.0, 0.6),
            "N_beta": rng.uniform(0.7, 1.0) * wn**2,
            "N_r": -2.0 * zeta * wn * rng.uniform(0.6, 1.1), "Y_delta_r": -0.1,
            "L_delta_a": rng.uniform(4.0, 7.0) / roll_s, "L_delta_r": -0.05 * wn**2,
            "N_delta_a": -rng.uniform(0.0, 2.0), "N_delta_r": 0.8 * wn**2,
        }  # fmt: skip
        hold = 2.5 / roll_s / own["L_delta_a"]
        plan = FlightPlan(
            "small", round(own["airspeed_m_s"] / KNOT, 2), 1000.0, seconds=seconds,
            manoeuvre="none", roll_gain=hold, roll_rate_gain=0.1 * hold, own=tuple(own.items()),
        )  # fmt: skip
        poles = np.linalg.eigvals(trimmed(plan).A)
        pair, real = poles[np.argmax(poles.imag)], poles.real[np.abs(poles.imag) < 1e-6]
        if (
            0.97 < abs(pair) / wn < 1.03
            and SMALL_ZETA[0] < -pair.real / abs(pair) < SMALL_ZETA[1]
            and SMALL_ROLL_S[0] < -1.0 / real.min() < SMALL_ROLL_S[1]
            and real.max() < 0.1
        ):
            return plan


def hostile(seed: int, number: int, seconds: float) -> Made:
    """Return hostile log ``number`` of a seed: its family in turn, two of three by JSBSim."""
    nth, at = divmod(number, len(FAMILIES))
    family, rng = FAMILIES[at], np.random.default_rng([seed, 2, number])
    if family == NOT_FLOWN:
        made = quiet(NOT_FLOWN.split(", ")[nth % 4], rng, lengths_s=[min(seconds, 400.0)])
    else:  # of JSBSim's aircraft the first nine: zeta of the last, an A320, is above .45
        make, which = (small, number) if nth % 3 == 2 else (jsbsim, 10 * number + nth % 9)
        made = fly_ordinary(changed(family, rng, nth, make(seed, 1000 + which, seconds)))
    return Made(made.log, {"dutch_roll_open_loop": None} | (made.truth or {}) | {"family": family})


def changed(family: str, rng: np.random.Generator, nth: int, flight: Ordinary) -> Ordinary:
    """Return a flight as the ``nth`` one of a hostile family."""
    hold = flight.plan.roll_gain
    stiff = replace(flight.plan, roll_gain=2.5 * hold, roll_rate_gain=0.1 * hold)
    simply: dict[str, dict[str, Any]] = {
        "limit cycle": {"plan": stiff, "law": "hold", "backlash": 0.03},
        "no turns": {"turns_s": None},
        "aileron of wrong scale": {"sent_aileron": (-1.0, 0.4, -0.6, 0.7)[nth % 4]},
        "roll late by .1 s": {"late_ms": 100},
        "r scaled": {"sent_r": (1.2, 0.8)[nth % 2]},
    }
    if family in simply:
        return replace(flight, **simply[family])
    A, _, rudder = lateral(trimmed(flight.plan))
    mode = dutch_roll(A, rudder, LATERAL.index("R"))
    assert mode is not None
    wn = mode["wn_rad_s"]
    if family == "yaw damper":  # it adds .1 to .4 to zeta
        added, effect = rng.uniform(0.1, 0.4), -float(rudder[LATERAL.index("R")])
        return replace(flight, damper=2.0 * added * wn / effect)
    multiple, share = np.geomspace(0.3, 3.0, 11)[nth % 11], (0.3, 0.5, 1.0)[nth // 2 % 3]
    return replace(flight, line=(AXES[family], float(multiple) * wn, share))
