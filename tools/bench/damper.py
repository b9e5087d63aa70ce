"""Compares what yawid damper predicts with JSBSim's linearisation with ArduPlane's damper closed.

    python tools/bench.py damper [--cases 100] [--logs DIR] [--jobs 2] [--csv FILE] [--readme]

For each place (aircraft and airspeed) a flight without the damper is replayed, and predicts wn and
zeta for gains that add .08 to .35 of zeta. The truth is the linearisation with the damper closed,
at the airspeed flown: washout, scaling, loop rate, and a servo that lags. zeta is right within the
larger of .05 and 15 %. The equations of the damper are written from ArduPlane's source, not taken
from src/yawid/damper, which they check.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from checks.judge import Row, kept
from flights.flight import Flight, Hands, trimmed
from flights.fly import Made
from flights.moved import CONDITIONS
from flights.plan import KNOT, STEP_S, FlightPlan, excitation
from flights.surgery import join
from flights.telemetry import Link, telemetry
from flights.truth import LATERAL, after_lead_in, dutch_roll, lateral, linear_dutch_rolls, mean_plan
from numpy.typing import NDArray

from bench.frame import FLOWN, all_rows, head, known, line, options_of
from yawid.tables.replay import replay

SEED = 3201
ADDED = (0.08, 0.15, 0.25, 0.35)
"""What the gains of a place add to zeta."""
LAGS_S, LOOPS_HZ, GYROS = (0.02, 0.05, 0.08), (50, 100, 200), (0.001, 0.003)
RIGHT, RIGHT_SHARE = 0.05, 0.15
RIGHT_SHARE_OF_ALL, WITHIN_SHARE_OF_ALL = 0.85, 0.9
REST_S = 10.0
COLUMNS = (
    "cases", "refused", "zeta right", "within 2 sigma", "wn off, median",
)  # fmt: skip


def plan_of(place: int) -> tuple[FlightPlan, Damper, Link]:
    """Return the flight of a place, its damper without gain, and its link."""
    rng = np.random.default_rng([SEED, place])
    aircraft, altitude_ft, speed_kt = CONDITIONS[place % len(CONDITIONS)]
    plan = FlightPlan(
        aircraft=aircraft, altitude_ft=altitude_ft, heading_deg=float(rng.integers(0, 360)),
        speed_kt=speed_kt * (1.0 if place < len(CONDITIONS) else 1.05),
        amplitude=round(float(rng.uniform(0.12, 0.25)), 3),
    )  # fmt: skip
    mode = linear_dutch_rolls(plan)["dutch_roll"]
    assert mode is not None
    period_s = math.tau / mode["wn_rad_s"]
    seconds = min(max(round(15.0 + 18.0 * period_s), 60), 100)
    plan = replace(plan, step_s=round(0.3 * period_s, 3), seconds=float(seconds))
    scaling = round(speed_kt * 0.514444 * float(rng.uniform(0.8, 1.2)), 1)
    damper = Damper(0.0, int(rng.choice(LOOPS_HZ)), scaling, float(rng.choice(LAGS_S)))
    link = Link(50, 50, rate_noise=float(rng.choice(GYROS)), seed=int(rng.integers(1, 2**31)))
    return plan, damper, link


def gain_for(plan: FlightPlan, damper: Damper, added: float) -> float:
    """Return the gain that adds about ``added`` to zeta in the linearisation at trim."""
    model, top = linear(plan, damper.servo_lag_s), 0.05
    start = _zeta(model.dutch_roll(damper))
    while top < 20.0 and _zeta(model.dutch_roll(replace(damper, gain=top))) - start < added:
        top *= 1.3
    return round(top, 3)


def _zeta(pole: complex) -> float:
    return -pole.real / abs(pole)


def flown(place: int) -> Made:
    """Fly a place; the truth has the mean airspeed and altitude flown."""
    plan, damper, link = plan_of(place)
    rudder = excitation(plan)
    rudder[-round(REST_S / STEP_S) :] = 0.0
    plan = replace(plan, parameters=damper.parameters())
    flight = LaggingFlight(plan, Hands(rudder), link, damper.servo_lag_s)
    log = join(telemetry(link, flight))
    mean = mean_plan(plan, after_lead_in(flight.flown))
    return Made(log, {"speed_kt": mean.speed_kt, "altitude_ft": mean.altitude_ft})


def place_rows(gains: int, folder: Path, place: int) -> list[Row]:
    """Return a row for each gain of a place."""
    log, mean = kept(folder, f"damper_{place:03d}", partial(flown, place))
    before = replay(log)
    plan, damper, _ = plan_of(place)
    model = linear(replace(plan, **mean), damper.servo_lag_s)
    rows: list[Row] = []
    for added in ADDED[:gains]:
        gain = gain_for(plan, damper, added)
        pole = model.dutch_roll(replace(damper, gain=gain))
        row: Row = {"aircraft": plan.aircraft, "place": place, "gain": gain, "added": added}
        row |= {"wn_true": abs(pole), "zeta_true": _zeta(pole)}
        found = before.damper(gains=[gain]).predicted
        closed = None if found is None else found.closed
        if closed is not None:
            at = int(np.argmin(np.abs(closed.gains - gain)))
            names = {"wn": closed.wn_rad_s, "zeta": closed.zeta, "zeta_std": closed.zeta_std}
            row |= {name: float(values[0, at]) for name, values in names.items()}
        rows.append(row)
    return rows


def is_right(row: Row) -> bool:
    """Return whether a damping ratio is as near to the truth as it has to be."""
    off = abs(row["zeta"] - row["zeta_true"])
    return bool(off <= max(RIGHT, RIGHT_SHARE * abs(row["zeta_true"])))


def is_within(row: Row) -> bool:
    """Return whether a prediction is within 2 sigma of the truth."""
    return bool(abs(row["zeta"] - row["zeta_true"]) <= 2.0 * row["zeta_std"])


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table; return which aims were missed."""
    options = options_of("damper", __doc__, arguments, cases=100, **FLOWN)
    gains = min(options.cases, len(ADDED))
    places = range(-(-options.cases // gains))
    rows = all_rows(options, partial(place_rows, gains), places)[: options.cases]
    yield from head("", COLUMNS)
    for name in [*dict.fromkeys(row["aircraft"] for row in rows), "all"]:
        its = [row for row in rows if name in (row["aircraft"], "all")]
        some = [row for row in its if "zeta" in row]
        right, within = sum(map(is_right, some)), sum(map(is_within, some))
        # A predicted pair that became two real poles has no wn; its zeta counts as wrong.
        off = known(np.median, np.array([abs(row["wn"] / row["wn_true"] - 1.0) for row in some]))
        of = len(some)
        shares = f"{right} of {of}", f"{within} of {of}", f"{100.0 * off:.1f} %"
        yield line(name, len(its), len(its) - of, *shares)
    few = right < RIGHT_SHARE_OF_ALL * of or within < WITHIN_SHARE_OF_ALL * of
    return f"{right} right and {within} within 2 sigma of {of}" if few else None


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


class LaggingFlight(Flight):
    """A flight whose rudder servo follows its command with a lag."""

    def __init__(self, plan: FlightPlan, hands: Hands, link: Link, lag_s: float) -> None:
        self._share = -math.expm1(-STEP_S / lag_s)
        self._servo: float | None = None
        super().__init__(plan, hands, link)

    def _moved(self, rudder: float) -> float:
        before = rudder if self._servo is None else self._servo
        self._servo = before + (rudder - before) * self._share
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
