"""The conditions in which a manoeuvre was flown, and whether the airspeed among them may be true.

A blocked pitot tube, a wrong ARSPD_RATIO or a sensor that drifts gives a wrong airspeed that no
sigma shows, and with it a wrong kappa. It is checked by one sample a second, by the first of these
that the flight allows:

    several headings    |f V h + w| = ground speed, with the unit vector h of the heading: the
                        factor f by which the true airspeed V is too low, and the wind w
    turns               f = g tan(bank) / (turn rate V): coarse, because aircraft slip
    else                the tail wind that the ground speed asks for, along the airspeed

Each has its sigma, and beyond three of them the airspeed is not true. Errors of 20 s count as one
value: gusts and slip change so slowly.
"""

import math
from collections import deque
from datetime import UTC, datetime
from typing import Final, NamedTuple

import numpy as np

from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Conditions
from yawid.blocks import FIRST_DATE_NS, Floats, Held, Noted, SampleBlock
from yawid.quantities.airspeed import GRAVITY, density_ratio, name_of, source_of, true_of_equivalent
from yawid.quantities.vehicles import (
    AIRFRAME,
    ARDUPILOT,
    LOOP_UNKNOWN,
    PX4,
    WITH_ROLL_LOOP,
    mode_name,
)

LOOPS: Final = {
    (ARDUPILOT, "MANUAL"): AIRFRAME,
    (PX4, "MANUAL"): AIRFRAME,
    (ARDUPILOT, "TRAINING"): LOOP_UNKNOWN,
}
"""The flight modes in which only the sticks move the surfaces, or in which that depends on the
bank. In every other one the autopilot holds roll or a roll rate, which makes it another aircraft:
its Dutch roll has twice the damping or more."""
NOT_FLYING: Final = int(Held.HOVER | Held.LIFT_MOTORS | Held.ON_GROUND)
KEPT: Final = 36_000
"""The seconds that are kept, ten hours."""
STRETCHES_S: Final = 120.0, 600.0
"""The lengths in s of the stretches in which several headings are looked for, the first one that
has any: some circles, and the legs of a survey. So long the wind is taken to be steady."""
SIGMAS: Final = 3.0
"""The sigmas beyond which a difference is no chance, which goes there in .3 %: of an airspeed, of a
manoeuvre from the others, of a servo lag from the one given, of a rudder that is reversed."""
ALIKE_S: Final = 20.0
"""The seconds of which the errors count as one value, and of which there must be one. With it, of
221 drawn and recorded flights none with its own airspeed is refused, and 134 to 143 are with 0.5 to
2 times it; with limits of the headings' spread instead of this sigma 20 to 27 were."""
SCATTER: Final = 0.05
"""The relative scatter of a stretch's factor at the least, as two may have the same by chance. One
that is known worse has no vote, which is what says that headings were not different enough."""
SENSOR_SIGMA: Final = 0.04
"""The relative sigma of a right airspeed. Fourteen recorded flights had factors of 1.00 to 1.11 in
each turn, and 1.00 to 1.04 in the median of a flight."""
HIGH: Final = 1.3
"""True over equivalent airspeed at 5000 m, which is allowed where the altitude is unknown."""
BANKED: Final = np.deg2rad((15.0, 60.0))
"""The banks in rad that count as a turn: less is wings level with some slip, and more is no steady
turn. Carried over from before the turns had a sigma."""
SLIP, SLIP_SIGMA = 1.2, 0.12
"""How many times the bank is what a turn asks for, and its relative sigma: an aircraft slips. Four
aircraft had 0.95 to 1.5: ALFA, the C172P, seaway, and ArduPlane's simulator. With a limit of 2
instead of them, 2.6 at an unknown altitude, a halved airspeed was believed."""
WIND_SHARE, WIND_M_S = 0.5, 3.0
"""The sigma of the wind along the track, as a part of the airspeed and in m/s, together. At 20 m/s,
and at rest, three of them are about what was carried over: 2.5 times the airspeed over ground, and
10 m/s of wind."""


class Finding(NamedTuple):
    """Why the airspeed cannot be true; ``is_factor`` says that it is only wrong by one factor."""

    reason: Reason
    is_factor: bool


def conditions(
    samples: SampleBlock, n: int, modes_of: tuple[int, int]
) -> tuple[Conditions, Reason | None]:
    """Return the conditions of manoeuvre ``n`` from its samples; why its airspeed is not true.

    Such an airspeed is unknown. ``modes_of`` is (autopilot, vehicle type).
    """
    used = samples.select(np.flatnonzero(samples.held == 0))
    by_ground = used.noted & Noted.GROUND_SPEED.value != 0
    names = [mode_name(*modes_of, int(m)) for m in np.unique(samples.mode) if math.isfinite(m)]
    loops = {loop_of(modes_of[0], name) for name in names} or {LOOP_UNKNOWN}
    both = used.select(np.flatnonzero(~by_ground & np.isfinite(used.airspeed + used.ground_speed)))
    speed = true_of_equivalent(both.airspeed, both.altitude)
    untrue = _tail_wind(speed, both.ground_speed) if len(both) else None
    known = np.isfinite(used.airspeed) & (untrue is None)
    source = source_of(by_ground) if known.any() else None
    kinds = used.airspeed_kind[known & np.isfinite(used.airspeed_kind)]
    kind, count = np.unique(kinds, return_counts=True)
    has_kind = source == "airspeed" and len(kind) > 0
    from_s, to_s = (samples.boot_us[[0, -1]] / 1e6).tolist()
    unix_ns = int(samples.unix_ns[0])
    date = datetime.fromtimestamp(unix_ns // 10**6 / 1e3, UTC).isoformat(timespec="milliseconds")
    found = Conditions(
        n=n,
        from_s=from_s,
        to_s=to_s,
        duration_s=to_s - from_s,
        date=date.replace("+00:00", "Z") if unix_ns >= FIRST_DATE_NS else None,
        mode=" and ".join(names) or None,
        loop=loops.pop() if len(loops) == 1 else LOOP_UNKNOWN,
        airspeed_m_s=_mean(used.airspeed[known]),
        airspeed_std_m_s=float(used.airspeed[known].std()) if known.any() else None,
        airspeed_source=source,
        airspeed_kind=name_of(float(kind[np.argmax(count)])) if has_kind else None,
        altitude_m=_mean(used.altitude),
    )
    return found, None if untrue is None else untrue.reason


def loop_of(autopilot: int, mode: str) -> str:
    """Return what the answer from a flight mode of this name is of."""
    if autopilot not in (ARDUPILOT, PX4) or mode.startswith("mode "):
        return LOOP_UNKNOWN
    return LOOPS.get((autopilot, mode), WITH_ROLL_LOOP)


def is_bare(modes_of: tuple[int, int], mode: float) -> bool:
    """Return whether only the sticks move the surfaces in a mode, NaN where it is unknown."""
    if not math.isfinite(mode):
        return False
    return loop_of(modes_of[0], mode_name(*modes_of, int(mode))) == AIRFRAME


class AirspeedCheck:
    """The check of the airspeed over a whole run: feed it all samples, then ask for ``finding``.

    It keeps one sample a second, of ten hours: where the stream is cut into blocks changes nothing.
    """

    def __init__(self, sample_time_s: float) -> None:
        self._second = max(1, round(1.0 / sample_time_s))
        self._kept: deque[list[float]] = deque(maxlen=KEPT)

    def feed(self, samples: SampleBlock) -> None:
        """Take samples in."""
        rows = (samples.k % self._second == 0) & np.isfinite(samples.airspeed)
        rows &= samples.noted & Noted.GROUND_SPEED.value == 0
        rows &= (samples.held & NOT_FLYING == 0) & (samples.on_ground != 1.0)
        some = samples.select(np.flatnonzero(rows))
        speed = true_of_equivalent(some.airspeed, some.altitude)
        columns = some.boot_us / 1e6, speed, some.yaw, some.roll, some.ground_speed
        is_high = np.isnan(density_ratio(some.altitude))
        self._kept.extend(np.column_stack([some.k, *columns, is_high]).tolist())

    def finding(self) -> Finding | None:
        """Return why the airspeed cannot be true, None where it may be or cannot be checked."""
        k, t_s, speed, yaw, roll, over_ground, is_high = np.reshape(self._kept, (-1, 7)).T
        high = HIGH if is_high.any() else 1.0
        good = np.isfinite(yaw + over_ground)
        factors = _by_headings(t_s[good], speed[good], yaw[good], over_ground[good])
        if len(factors):
            return _by_ground_speed(factors, math.log(high) / SIGMAS)
        rate, bank = np.diff(yaw), 0.5 * (roll[1:] + roll[:-1])
        turns = (np.diff(k) == self._second) & (rate * bank > 0.0)
        turns &= (BANKED[0] < np.abs(bank)) & (np.abs(bank) < BANKED[1])
        if np.count_nonzero(turns) >= ALIKE_S:
            by_bank = GRAVITY * np.tan(bank[turns]) / (rate[turns] * speed[1:][turns]) / SLIP
            factor, scatter = _middle(by_bank)
            of_turns = scatter / math.sqrt(len(by_bank) / ALIKE_S)
            sigma = math.hypot(SLIP_SIGMA, of_turns, math.log(high) / SIGMAS)
            if abs(math.log(factor)) > SIGMAS * sigma:
                text = f"bank and turn rate imply {factor:.2g} ± {factor * sigma:.1g} times the "
                return _finding(f"{text}airspeed reported", is_factor=False)
        known = np.isfinite(over_ground)
        if np.count_nonzero(known) < ALIKE_S:
            return None
        return _tail_wind(speed[known], over_ground[known])


def _by_headings(t_s: Floats, speed: Floats, yaw: Floats, over_ground: Floats) -> Floats:
    """Return the factor and the wind in m/s (m, 2) of each stretch that has several headings."""
    found = []
    for length_s in STRETCHES_S:
        ends = np.flatnonzero(np.diff(t_s // length_s)) + 1
        for rows in np.split(np.arange(len(t_s)), ends):
            if len(rows) < ALIKE_S:
                continue
            fitted = factor_of(speed[rows], yaw[rows], over_ground[rows])
            if fitted is not None and fitted[1] < SCATTER * fitted[0]:
                found.append((fitted[0], fitted[2]))
        if found:
            break
    return np.reshape(found, (-1, 2))


def factor_of(speed: Floats, yaw: Floats, over_ground: Floats) -> tuple[float, float, float] | None:
    """Return the factor f with which |f V h + w| best fits the ground speed, its sigma, and |w|.

    ``speed`` (n,) is the true airspeed as reported and ``over_ground`` (n,) the ground speed, in
    m/s; ``yaw`` (n,) is the heading in rad. None where it is unclear.
    """
    heading = np.column_stack([np.cos(yaw), np.sin(yaw)])
    found = np.array([np.median(over_ground) / np.median(speed), 0.0, 0.0])
    for _ in range(12):  # Gauss-Newton; it settles within five steps
        track = found[0] * speed[:, None] * heading + found[1:]
        length = np.maximum(np.hypot(*track.T), 1e-6)
        unit = track / length[:, None]
        slope = np.column_stack([(unit * heading).sum(axis=1) * speed, unit])
        left = over_ground - length
        step, _, rank, _ = np.linalg.lstsq(slope, left, rcond=None)
        found = found + step
    if not np.isfinite(found).all() or rank < len(found):
        return None
    variance = ALIKE_S * float(left @ left) / max(len(left) - len(found), 1)
    sigma = math.sqrt(variance * float(np.linalg.inv(slope.T @ slope)[0, 0]))
    return float(found[0]), sigma, float(np.hypot(*found[1:]))


def _by_ground_speed(factors: Floats, height_sigma: float) -> Finding | None:
    """Judge by the median of the factors (m, 2) found over several headings."""
    factor, scatter = _middle(factors[:, 0])
    sigma = max(scatter, SCATTER) / math.sqrt(len(factors))
    total = math.hypot(sigma, SENSOR_SIGMA, height_sigma)
    if abs(math.log(factor)) <= SIGMAS * total:
        return None
    text = (
        f"the ground speed on several headings implies {factor:.3g} ± {factor * sigma:.2g} times "
        f"the airspeed reported, with {np.median(factors[:, 1]):.0f} m/s of wind"
    )
    return _finding(text, is_factor=scatter < SIGMAS * SCATTER)


def _middle(values: Floats) -> tuple[float, float]:
    """Return the median of values (n,) and their relative scatter around it."""
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values / middle - 1.0)))


def _mean(x: Floats) -> float | None:
    return float(np.nanmean(x)) if np.isfinite(x).any() else None


def _tail_wind(speed: Floats, over_ground: Floats) -> Finding | None:
    """Judge true airspeeds (n,) against ground speeds (n,) on one heading or a few."""
    mean, ground = float(speed.mean()), float(over_ground.mean())
    sigma = math.hypot(WIND_SHARE * mean, WIND_M_S)
    if ground - mean <= SIGMAS * sigma:
        return None
    text = f"{ground:.0f} m/s over ground at an airspeed of {mean:.2g} m/s imply a tail wind of "
    return _finding(f"{text}{ground - mean:.0f} m/s", is_factor=False)


def _finding(text: str, *, is_factor: bool) -> Finding:
    text += ": the airspeed is treated as unknown"
    return Finding(Reason("airspeed_implausible", text), is_factor)
