"""The conditions in which a manoeuvre was flown, and therefore what aircraft its answer is of."""

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from yawid.blocks import FIRST_DATE_NS, Floats, Noted, SampleBlock
from yawid.quantities.airspeed import name_of, source_of
from yawid.quantities.vehicles import (
    AIRFRAME,
    ARDUPILOT,
    LOOP_UNKNOWN,
    PX4,
    WITH_ROLL_LOOP,
    mode_name,
)

BARE = {ARDUPILOT: {"MANUAL"}, PX4: {"MANUAL"}}
"""By autopilot, the flight modes in which only the sticks move the surfaces."""
LIMITED = {ARDUPILOT: {"TRAINING"}, PX4: set()}
"""By autopilot, the flight modes in which that depends on the bank."""
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Conditions:
    """When, how fast, how high and in which mode it was flown: fields of ``Manoeuvre``, same names.

    Times are in s since boot, ``date`` in UTC; airspeed in m/s, altitude in m above the sea.
    ``airspeed_kind`` is the kind that the source gives, a name of
    :class:`yawid.quantities.airspeed.Kind`.
    """

    from_s: float
    to_s: float
    duration_s: float
    date: str | None
    mode: str | None
    loop: str
    airspeed_m_s: float | None
    airspeed_std_m_s: float | None
    airspeed_source: str | None
    airspeed_kind: str | None
    altitude_m: float | None


def conditions(samples: SampleBlock, modes_of: tuple[int, int]) -> Conditions:
    """Return the conditions of a manoeuvre's samples; ``modes_of`` is (autopilot, vehicle type)."""
    used = samples.held == 0
    from_s, to_s = (samples.boot_us[[0, -1]] / 1e6).tolist()
    known = np.unique(samples.mode[np.isfinite(samples.mode)])
    names = [mode_name(*modes_of, int(mode)) for mode in known]
    loops = {loop_of(modes_of[0], name) for name in names} or {LOOP_UNKNOWN}
    speed, height = samples.airspeed[used], samples.altitude[used]
    airspeed = _mean(speed)
    source = source_of(samples.noted[used] & Noted.GROUND_SPEED.value != 0)
    kinds = samples.airspeed_kind[used & np.isfinite(samples.airspeed + samples.airspeed_kind)]
    kind, count = np.unique(kinds, return_counts=True)
    has_kind = source == "airspeed" and len(kind) > 0
    return Conditions(
        from_s=from_s,
        to_s=to_s,
        duration_s=to_s - from_s,
        date=_date(int(samples.unix_ns[0])),
        mode=" and ".join(names) or None,
        loop=loops.pop() if len(loops) == 1 else LOOP_UNKNOWN,
        airspeed_m_s=airspeed,
        airspeed_std_m_s=None if airspeed is None else float(np.nanstd(speed)),
        airspeed_source=None if airspeed is None else source,
        airspeed_kind=name_of(float(kind[np.argmax(count)])) if has_kind else None,
        altitude_m=_mean(height),
    )


def without_airspeed(found: Conditions) -> Conditions:
    """Return the conditions with the airspeed unknown."""
    return replace(
        found, airspeed_m_s=None, airspeed_std_m_s=None, airspeed_source=None, airspeed_kind=None
    )


def loop_of(autopilot: int, mode: str) -> str:
    """Return what the answer from a flight mode of this name is of: a constant of this file.

    An autopilot that holds roll, or a roll rate, makes it another aircraft: its Dutch roll has
    twice the damping or more.
    """
    if autopilot not in BARE or mode.startswith("mode "):
        return LOOP_UNKNOWN
    if mode in LIMITED[autopilot]:
        return LOOP_UNKNOWN
    return AIRFRAME if mode in BARE[autopilot] else WITH_ROLL_LOOP


def is_bare(modes_of: tuple[int, int], mode: float) -> bool:
    """Return whether only the sticks move the surfaces in a mode, NaN where it is unknown."""
    if not math.isfinite(mode):
        return False
    return loop_of(modes_of[0], mode_name(*modes_of, int(mode))) == AIRFRAME


def _mean(x: Floats) -> float | None:
    return float(np.nanmean(x)) if np.isfinite(x).any() else None


def _date(unix_ns: int) -> str | None:
    """Return the UTC time in ISO 8601, to the millisecond; None if it is a time since boot."""
    if unix_ns < FIRST_DATE_NS:
        return None
    when = EPOCH + timedelta(microseconds=unix_ns // 1000)
    return when.isoformat(timespec="milliseconds").replace("+00:00", "Z")
