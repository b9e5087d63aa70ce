"""The check whether the airspeed may be true, against ground speed, and bank with turn rate.

A blocked pitot tube, a wrong ARSPD_RATIO or a sensor that drifts gives a wrong airspeed that no
sigma shows, and with it a wrong kappa. Over several headings the ground speed is |f V h + w| with
the unit vector h of the heading, the wind w and the factor f by which the airspeed is too low: f is
estimated together with the wind. Without such turns, g tan(bank) / turn rate is a coarse airspeed
(aircraft slip); and on one heading the ground speed must not ask for a wind much faster than the
aircraft.

The check uses one sample a second, in order: where the stream is cut into blocks changes nothing.
"""

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from yawid.blocks import Floats, Held, Noted, SampleBlock
from yawid.quantities.airspeed import GRAVITY, density_ratio
from yawid.results.reasons import Reason

STRIDE_S: Final = 1.0
NOT_FLYING: Final = int(Held.HOVER | Held.LIFT_MOTORS | Held.ON_GROUND)
LONGEST_S: Final = 600.0
"""The time in s over which the wind is taken to be steady."""
EVERY, LEAST_ROWS = 5, 30
"""The number of rows after which the headings are checked again, and the least for a fit."""
MOST_MEAN, LEAST_SPREAD = 0.75, 0.1
"""What counts as several headings: the greatest length of their mean, and the least eigenvalue of
their second moment. An arc of 150 degrees has 0.74 and 0.14; two opposite headings have 0 and 0."""
MOST_SIGMA: Final = 0.03
"""The greatest relative sigma of a factor: with a greater one the headings were not different
enough."""
FACTOR: Final = 1.2
"""The factor beyond which an airspeed is implausible. Fourteen recorded flights had 1.00 to 1.11 in
each turn, and 1.00 to 1.04 in the median of a flight."""
LEAST_SCATTER, SIGMAS = 0.05, 3.0
"""The least relative scatter of one turn's factor, and the sigmas by which a factor must differ."""
HIGH: Final = 1.3
"""True over equivalent airspeed at 5000 m, which is allowed where the altitude is unknown."""
BANKED, BANK_STEADY = np.deg2rad((15.0, 60.0)), np.deg2rad(5.0)
"""The banks in rad that count as a turn, and the greatest change of a steady one in a second."""
LEAST_TURNING: Final = 20
"""The least number of seconds of turning, of which the scatter is counted as one value."""
SLIP, SLIP_SIGMA = 1.2, 0.12
"""How many times the bank is what a turn asks for, and its relative sigma: an aircraft slips. Four
aircraft had 0.95 to 1.5: ALFA, the C172P, seaway, and ArduPlane's simulator. With a limit of 2
instead of them, 2.6 at an unknown altitude, a halved airspeed was believed."""
TAIL_WIND, LEAST_WIND_M_S = 2.5, 10.0
"""The ratio of ground speed to airspeed, and the tail wind, beyond which an airspeed is
implausible."""
KEPT: Final = 3600
"""The number kept of seconds of turning, of seconds with a ground speed, and of factors."""


class Finding(NamedTuple):
    """Why the airspeed cannot be true; ``is_factor`` says that it is only wrong by one factor."""

    reason: Reason
    is_factor: bool


class Factor(NamedTuple):
    """The factor by which the airspeed must be multiplied, its sigma, and the wind in m/s."""

    value: float
    sigma: float
    wind_m_s: float


def factor_of(speed: Floats, yaw: Floats, over_ground: Floats) -> Factor | None:
    """Return the factor f with which |f V h + w| best fits the ground speed; None where unclear.

    ``speed`` (n,) is the true airspeed as reported and ``over_ground`` (n,) the ground speed, in
    m/s; ``yaw`` (n,) is the heading in rad.
    """
    heading = np.column_stack([np.cos(yaw), np.sin(yaw)])
    found = np.array([np.median(over_ground) / np.median(speed), 0.0, 0.0])
    for _ in range(12):  # Gauss-Newton; it settles within five steps
        track = found[0] * speed[:, None] * heading + found[1:]
        length = np.maximum(np.hypot(*track.T), 1e-6)
        unit = track / length[:, None]
        slope = np.column_stack([(unit * heading).sum(axis=1) * speed, unit])
        left = over_ground - length
        found = found + np.linalg.lstsq(slope, left, rcond=None)[0]
    if not np.isfinite(found).all() or np.linalg.matrix_rank(slope) < len(found):
        return None
    variance = float(left @ left) / max(len(left) - len(found), 1)
    sigma = math.sqrt(variance * float(np.linalg.inv(slope.T @ slope)[0, 0]))
    return Factor(float(found[0]), sigma, float(np.hypot(*found[1:])))


class AirspeedCheck:
    """The check over a whole run: feed it all samples, then ask for its ``finding``."""

    def __init__(self, sample_time_s: float) -> None:
        self._stride = max(1, round(STRIDE_S / sample_time_s))
        self._open = np.empty((0, 4))  # t, V, yaw, over ground
        self._new: list[tuple[float, float, float, float]] = []
        self._since = 0
        self._factors: deque[Factor] = deque(maxlen=KEPT)
        self._turns: deque[float] = deque(maxlen=KEPT)
        self._straight: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._last: tuple[int, float, float] | None = None  # k, yaw, roll
        self._knows_height = True

    def feed(self, samples: SampleBlock) -> None:
        """Take samples in."""
        rows = samples.k % self._stride == 0
        if not rows.any():
            return
        rows &= np.isfinite(samples.airspeed) & (samples.noted & Noted.GROUND_SPEED.value == 0)
        rows &= (samples.held & NOT_FLYING == 0) & (samples.on_ground != 1.0)
        some = samples.select(np.flatnonzero(rows))
        speed = _true_airspeed(some)
        self._knows_height &= bool(np.isfinite(density_ratio(some.altitude)).all())
        motion = some.yaw, some.roll, some.ground_speed
        columns = (x.tolist() for x in (some.k, some.boot_us / 1e6, speed, *motion))
        for k, t_s, each, yaw, roll, over_ground in zip(*columns, strict=True):
            self._turn(k, each, yaw, roll)
            if math.isfinite(over_ground):
                self._straight.append((each, over_ground))
                if math.isfinite(yaw):
                    self._heading(t_s, each, yaw, over_ground)

    def finding(self) -> Finding | None:
        """Return why the airspeed cannot be true, None where it may be or cannot be checked."""
        high = 1.0 if self._knows_height else HIGH
        if self._factors:
            return self._by_ground_speed(high)
        if len(self._turns) >= LEAST_TURNING:
            factors = np.array(self._turns) / SLIP
            factor = float(np.median(factors))
            scatter = 1.4826 * float(np.median(np.abs(factors / factor - 1.0)))
            of_turns = scatter / math.sqrt(len(factors) / LEAST_TURNING)
            sigma = math.hypot(SLIP_SIGMA, of_turns, math.log(high) / SIGMAS)
            if abs(math.log(factor)) > SIGMAS * sigma:
                text = (
                    f"bank and turn rate imply {factor:.2g} ± {factor * sigma:.1g} times the "
                    "airspeed reported"
                )
                return _finding(text, is_factor=False)
        if len(self._straight) >= LEAST_ROWS:
            return _tail_wind(*np.array(self._straight).T)
        return None

    def _by_ground_speed(self, high: float) -> Finding | None:
        """Judge by the median of the factors found over several headings."""
        values = np.array([each.value for each in self._factors])
        factor = float(np.median(values))
        if 1.0 / FACTOR <= factor <= FACTOR * high:
            return None
        scatter = 1.4826 * float(np.median(np.abs(values / factor - 1.0)))
        sigma = max(scatter, LEAST_SCATTER) / math.sqrt(len(values))
        if abs(math.log(factor)) <= SIGMAS * sigma:
            return None
        wind = float(np.median([each.wind_m_s for each in self._factors]))
        text = (
            f"the ground speed on several headings implies {factor:.3g} ± {factor * sigma:.2g} "
            f"times the airspeed reported, with {wind:.0f} m/s of wind"
        )
        return _finding(text, is_factor=scatter < FACTOR - 1.0)

    def _turn(self, k: int, speed: float, yaw: float, roll: float) -> None:
        """Take in a second: in a steady bank the airspeed is g tan(bank) / turn rate."""
        last, self._last = self._last, (k, yaw, roll)
        if last is None or k - last[0] != self._stride or not math.isfinite(yaw + roll):
            return
        rate = (yaw - last[1]) / STRIDE_S
        bank = 0.5 * (roll + last[2])
        is_steady = abs(roll - last[2]) < BANK_STEADY and BANKED[0] < abs(bank) < BANKED[1]
        if is_steady and rate * bank > 0.0:
            self._turns.append(GRAVITY * math.tan(bank) / (rate * speed))

    def _heading(self, t_s: float, speed: float, yaw: float, over_ground: float) -> None:
        """Take in a second with its heading; where there are several headings, find the factor."""
        self._new.append((t_s, speed, yaw, over_ground))
        self._since += 1
        if self._since % EVERY:
            return
        rows, self._new = np.concatenate([self._open, self._new]), []
        before = np.diff(rows[:, 0]) < 0.0
        if before.any():  # another boot
            rows = rows[np.flatnonzero(before)[-1] + 1 :]
        rows = self._open = rows[t_s - rows[:, 0] <= LONGEST_S]
        if len(rows) < LEAST_ROWS:
            return
        _, speeds, yaws, grounds = rows.T
        cos, sin = np.cos(yaws), np.sin(yaws)
        if not math.hypot(cos.mean(), sin.mean()) < MOST_MEAN:
            return
        moments = np.array([[cos @ cos, cos @ sin], [cos @ sin, sin @ sin]]) / len(rows)
        if float(np.linalg.eigvalsh(moments)[0]) < LEAST_SPREAD:
            return
        factor = factor_of(speeds, yaws, grounds)
        if factor is not None and factor.value > 0.0 and factor.sigma < MOST_SIGMA * factor.value:
            self._factors.append(factor)
            self._open = rows[:0]


def of_one_manoeuvre(samples: SampleBlock) -> Finding | None:
    """Return why the airspeed of a manoeuvre cannot be true, by its own samples alone."""
    rows = (samples.held == 0) & (samples.noted & Noted.GROUND_SPEED.value == 0)
    rows &= np.isfinite(samples.airspeed) & np.isfinite(samples.ground_speed)
    some = samples.select(np.flatnonzero(rows))
    return _tail_wind(_true_airspeed(some), some.ground_speed) if len(some) else None


def _true_airspeed(samples: SampleBlock) -> Floats:
    """Return the true airspeed (n,), the equivalent one where the altitude is unknown."""
    ratio = density_ratio(samples.altitude)
    return np.asarray(samples.airspeed / np.sqrt(np.where(np.isfinite(ratio), ratio, 1.0)))


def _tail_wind(speed: Floats, over_ground: Floats) -> Finding | None:
    """Judge true airspeeds (n,) against ground speeds (n,) on one heading or a few."""
    mean, ground = float(np.mean(speed)), float(np.mean(over_ground))
    if ground <= TAIL_WIND * mean or ground - mean <= LEAST_WIND_M_S:
        return None
    text = f"{ground:.0f} m/s over ground at an airspeed of {mean:.2g} m/s imply a tail wind of "
    return _finding(f"{text}{ground - mean:.0f} m/s", is_factor=False)


def _finding(text: str, *, is_factor: bool) -> Finding:
    return Finding(
        Reason("airspeed_implausible", f"{text}: the airspeed is treated as unknown"), is_factor
    )
