"""The truth of a flight of JSBSim: what identification should find, and its sigma.

After the flight, the Dutch roll is linearised at the mean airspeed and altitude flown, closed with
the roll hold (``dutch_roll``) and bare (``dutch_roll_open_loop``). Its sigma has two parts: the
scatter of the airspeed times the slope over the airspeed, and the difference from the decay after a
rudder pulse in the simulation itself, with its actuators.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import jsbsim
import numpy as np
from numpy.typing import NDArray

from flights.flight import Flight, Hands, trimmed
from flights.linear import LinearAircraft
from flights.plan import LEAD_IN_S, STEP_S, FlightPlan, Floats, Servo, count, sealed

Mode = dict[str, float]
Line = dict[str, Any]
LATERAL = ("Beta", "Phi", "P", "R")  # FGLinearization's names
PHI, R = LATERAL.index("Phi"), LATERAL.index("R")
PULSE_MS, SEEN_MS, DECAY_S = 200, 50, 12.0
"""Length of the pulse whose decay is seen, the time from one value of it to the next, and to the
last."""
ORDER = 6
"""The number of poles in that decay."""
SLOPE_SHARE = 0.01
"""Step for the slope over the airspeed, as a fraction of it: trim and linearisation are smooth."""


def after_lead_in(flown: Sequence[tuple[float, ...]]) -> Floats:
    """Return the rows of ``flown`` (n, 3) after the lead-in; all rows if there is none after it."""
    rows = np.array(flown)
    return rows[rows[:, 0] > LEAD_IN_S] if rows[-1, 0] > LEAD_IN_S else rows


def mean_plan(plan: FlightPlan, flown: Floats) -> FlightPlan:
    """Return the plan with the mean airspeed and altitude of ``flown`` (n, 3): s, kt, ft."""
    knots, feet = flown[:, 1:3].mean(axis=0).tolist()
    return replace(plan, speed_kt=round(knots, 3), altitude_ft=round(feet, 1))


def modes_at(lines: dict[str, Line | None], knots: Floats) -> dict[str, Mode | None]:
    """Return the Dutch rolls of :func:`truth_lines`, if any, and their sigmas at airspeeds (n,)."""
    names = "wn_rad_s", "zeta", "wn_std", "zeta_std"
    return {
        of: line and dict(zip(names, np.ravel(at_airspeeds(line, knots)).tolist(), strict=True))
        for of, line in lines.items()
    }


def truth_lines(plan: FlightPlan, flown: Floats) -> dict[str, Line | None]:
    """Return the truth of a flight at any airspeed, by the names of :func:`linear_dutch_rolls`.

    ``line`` is the Dutch roll linearised at the mean airspeed ``mean_kt`` and altitude of ``flown``
    (``at``: wn, zeta) and its slope (``per_kt``); ``pulse`` is the difference of the decay after a
    pulse from it. A value is None if the linearisation or the pulse has no Dutch roll.
    """
    mean = mean_plan(plan, flown)
    step_kt = SLOPE_SHARE * mean.speed_kt
    faster = linear_dutch_rolls(replace(mean, speed_kt=mean.speed_kt + step_kt))
    bare = replace(mean, roll_gain=0.0, roll_rate_gain=0.0)
    exact = "servo_lag_s" in sealed(plan.aircraft)  # a linear aircraft's pulse says nothing more
    lines: dict[str, Line | None] = {}
    for (name, at), loop in zip(linear_dutch_rolls(mean).items(), (mean, bare), strict=True):
        modes = at, faster[name], at if exact else pulse_dutch_roll(loop)
        pairs = np.array([(m["wn_rad_s"], m["zeta"]) for m in modes if m is not None])
        lines[name] = None
        if len(pairs) == len(modes):
            slope, pulse = (pairs[1] - pairs[0]) / step_kt, pairs[2] - pairs[0]
            lines[name] = {
                "mean_kt": mean.speed_kt,
                "line": {"at": pairs[0].tolist(), "per_kt": slope.tolist()},
                "pulse": pulse.tolist(),
            }
    return lines


def at_airspeeds(line: Line, knots: Floats) -> tuple[Floats, Floats]:
    """Return wn in rad/s and zeta (2,) at the mean of airspeeds ``knots`` (n,), and the sigmas."""
    at, slope = np.array(line["line"]["at"]), np.array(line["line"]["per_kt"])
    value = at + slope * (float(knots.mean()) - line["mean_kt"])
    return value, np.hypot(slope * float(knots.std()), line["pulse"])


def linear_dutch_rolls(plan: FlightPlan) -> dict[str, Mode | None]:
    """Return the linearised Dutch rolls at a plan's trim: with its roll hold, and bare."""
    bare, closed = with_roll_hold(plan)
    return {"dutch_roll": dutch_roll(*closed, R), "dutch_roll_open_loop": dutch_roll(*bare, R)}


@lru_cache(maxsize=32)
def with_roll_hold(plan: FlightPlan) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Return A and the rudder command's column of the bare airframe, and with the roll hold.

    The states are those of LATERAL, and of a linear aircraft aileron and rudder, whose servos lag.
    Results are cached: with a piston engine, JSBSim's linearisation takes up to 1 s, sometimes 12.
    """
    fdm = trimmed(plan)
    A, aileron, rudder = lateral(fdm)
    # aileron = trim - hold @ (x - trim), with x as LATERAL
    hold = np.array([0.0, plan.roll_gain, plan.roll_rate_gain, 0.0])
    if not isinstance(fdm, LinearAircraft):
        return (A, rudder), (A - np.outer(aileron, hold), rudder)
    rate, surfaces = 1.0 / fdm.servo_lag_s, np.stack([aileron, rudder], axis=1)
    bare, closed = (
        np.block([[A, surfaces], [-rate * np.stack([each, 0.0 * hold]), -rate * np.eye(2)]])
        for each in (0.0 * hold, hold)
    )
    command = np.append(np.zeros(len(bare) - 1), rate)
    return (bare, command), (closed, command)


def lateral(fdm: Any) -> tuple[Floats, Floats, Floats]:
    """Return A (4, 4) of the lateral states and the columns (4,) of aileron and rudder commands.

    ``fdm`` is at its trim.
    """
    if isinstance(fdm, LinearAircraft):
        return fdm.A, fdm.aileron, fdm.rudder
    linear = jsbsim.FGLinearization(fdm)
    states, inputs = list(linear.x_names), list(linear.u_names)
    rows = [states.index(name) for name in LATERAL]
    B = np.array(linear.input_matrix)[rows]
    A = np.array(linear.system_matrix)[np.ix_(rows, rows)]
    return A, B[:, inputs.index("DaCmd")], B[:, inputs.index("DrCmd")]


def dutch_roll(A: Floats, b: Floats, output: int) -> Mode | None:
    """Return the oscillatory pair with the largest energy from input ``b`` to state ``output``."""
    poles, modes = np.linalg.eig(A)
    return strongest_pair(poles, modes[output] * np.linalg.solve(modes, b.astype(complex)))


def strongest_pair(poles: NDArray[np.complex128], residues: NDArray[np.complex128]) -> Mode | None:
    """Return wn_rad_s and zeta of the pair with the largest ``|R|^2 / (2 |Re p|)``, if any."""
    pairs = poles.imag > 1e-3
    if not pairs.any():
        return None
    energy = np.abs(residues) ** 2 / np.maximum(2.0 * np.abs(poles.real), 1e-9)
    p = poles[np.argmax(np.where(pairs, energy, -1.0))]
    return {"wn_rad_s": float(abs(p)), "zeta": float(-p.real / abs(p))}


def yaw_rates(plan: FlightPlan, pulse: float) -> Floats:
    """Return the yaw rate (n,) in rad/s after a rudder pulse from trim, with the roll hold.

    The servos have 32 766 steps of travel on each side, as quantisation would hide the end of the
    decay.
    """
    fine = Servo(1, 32_767, 65_533)
    plan = replace(plan, seconds=DECAY_S + 1.0, rudder=fine, aileron=fine, true_feedback=True)
    rudder = np.zeros(count(DECAY_S) + PULSE_MS)
    rudder[1 : PULSE_MS + 1] = pulse
    flight, rates = Flight(plan, Hands(rudder, nose_held=False)), []
    for ms in range(PULSE_MS + SEEN_MS, len(rudder), SEEN_MS):
        flight.advance_to(ms)
        rates.append(flight["velocities/r-rad_sec"])
    return np.array(rates)


@lru_cache(maxsize=32)
def pulse_dutch_roll(plan: FlightPlan) -> Mode | None:
    """Return the Dutch roll in the decay after a small rudder pulse, without any linearisation.

    The same flight without the pulse is subtracted, which removes trim errors and drift. The decay
    is ``sum(a_i exp(p_i t))``. The poles follow from the shift of the Hankel matrix within its
    first ORDER left singular vectors (Ho and Kalman).
    """
    decay = yaw_rates(plan, 0.02) - yaw_rates(plan, 0.0)
    hankel = np.lib.stride_tricks.sliding_window_view(decay, len(decay) // 2)
    left = np.linalg.svd(hankel.T)[0][:, :ORDER]
    z = np.linalg.eigvals(np.linalg.lstsq(left[:-1], left[1:], rcond=None)[0]).astype(complex)
    powers = z ** np.arange(len(decay))[:, None]
    amplitudes = np.linalg.lstsq(powers, decay.astype(complex), rcond=None)[0]
    return strongest_pair(np.log(z) / (STEP_S * SEEN_MS), amplitudes)
