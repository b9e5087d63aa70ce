"""Which gain to set: the band that the predictions allow, and the first step towards it.

The least margins are those at the 95 % bound of the model: 45 degrees and, where it is known, 6 dB,
at every airspeed asked for. Real records show why a band is given and no number: a gain designed
for zeta .30 gave .26 to .32 there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from statistics import NormalDist
from typing import Final

import numpy as np

from yawid.answers.damper_report import DamperAt, DamperGain, Recommended
from yawid.blocks import Bools, Floats, finite
from yawid.damper.autopilots import Law
from yawid.damper.loop import closed_dutch_roll, known_frequencies, margins, settling_times
from yawid.models.closed_airframe import ClosedAirframe
from yawid.models.draws import Aircraft
from yawid.models.flown import Flown

LEAST_PHASE_DEG, LEAST_GAIN_DB = 45.0, 6.0
BOUND_PCT: Final = 5.0
"""The percentile of the draws that a margin is given at, and a gain in zeta is judged at."""
AIM: Final = (0.3, 0.4)
"""The damping ratios aimed at."""
AIM_HALF: Final = 0.05
SURE: Final = NormalDist().inv_cdf(1.0 - BOUND_PCT / 100.0)
"""The sigmas by which zeta must exceed the aim, so that it does with the same 95 %."""
FIRST_STEP: Final = 0.1
"""The most zeta that a first step from no damper may add."""
MOST_RAISED: Final = 2.0
LARGEST_ZETA_ADDED: Final = 0.6
FINE: Final = 40
"""The gains between 0 and the largest that are tried."""
LEAST_KNOWN: Final = 0.8
"""The share of the draws that must have the pair, or wn and zeta are left out."""


@dataclass(frozen=True, slots=True)
class Closed:
    """Predictions for gains (m,), ascending, at airspeeds (v,): of each number an array (v, m).

    wn in rad/s, zeta and the settling time are the draws' medians with their sigmas, NaN where too
    few draws have the pair. The margins are their 5th percentiles, NaN where more than 5 % of the
    draws cross |L| = 1 where the model is not known. ``damps`` says whether a gain adds damping in
    95 % of the draws, True at the least gain, which is 0 or the flown one.
    """

    gains: Floats
    airspeeds_m_s: Sequence[float]
    wn_rad_s: Floats
    wn_std: Floats
    zeta: Floats
    zeta_std: Floats
    settling_s: Floats
    settling_std: Floats
    gain_margin_db: Floats
    phase_margin_deg: Floats
    damps: Bools

    def at(self, v: int, m: int) -> dict[str, float]:
        """Return what is known of one gain at one airspeed, by the names of ``DamperAt``."""
        _, *names = DamperAt.__struct_fields__
        return finite({name: float(getattr(self, name)[v, m]) for name in names})


@dataclass(frozen=True, slots=True)
class Predicted:
    """The damped aircraft, for sentences and pages.

    ``laws`` are by airspeed. ``pilot`` (n,) is the rudder that the pilot moved in ``manoeuvre``.
    """

    aircraft: Aircraft | ClosedAirframe
    laws: tuple[Law, ...]
    closed: Closed
    manoeuvre: Flown
    pilot: Floats


def aimed(aim: float | None) -> tuple[float, float]:
    """Return the lowest and the highest zeta that are aimed at."""
    return AIM if aim is None else (aim - AIM_HALF, aim + AIM_HALF)


def closed_with(
    aircraft: Aircraft | ClosedAirframe, laws: Sequence[Law], gains: Floats,
    airspeeds_m_s: Sequence[float], sample_time_s: float,
) -> Closed:  # fmt: skip
    """Return the predictions for gains (m,), ascending, at airspeeds with one law each."""
    rows = []
    for law, speed in zip(laws, airspeeds_m_s, strict=True):
        G = aircraft.at(speed)  # noqa: N806
        wn = float(np.median(np.abs(G.dutch_roll)))
        phase, gain, beyond = margins(G, law, gains, known_frequencies(wn, sample_time_s))
        s = closed_dutch_roll(G, law, gains)
        zeta = -s.real / np.abs(s)
        # A pair that has become two real poles is damped more than any pair.
        more = np.where(np.isnan(zeta) & np.isfinite(zeta[0]), np.inf, zeta) - zeta[0]
        damps = _bound(np.where(np.isnan(more), -np.inf, more)) > 0.0
        unknown = np.where(beyond.mean(axis=1) > BOUND_PCT / 100.0, np.nan, 0.0)
        least = [_bound(each) + unknown for each in (gain, phase)]
        of_pair = (np.abs(s), zeta, settling_times(G, law, gains, s))
        rows.append((*chain(*map(spread, of_pair)), *least, damps | (gains == gains[0])))
    return Closed(gains, airspeeds_m_s, *(np.stack(each) for each in zip(*rows, strict=True)))


def _bound(values: Floats) -> Floats:
    return np.asarray(np.percentile(values, BOUND_PCT, axis=-1, method="lower"))


def spread(values: Floats) -> tuple[Floats, Floats]:
    """Return the medians (m,) of draws (m, n), and the sigmas of all draws about them.

    A draw whose pair has become two real poles, NaN, counts in sigma with its last value as a pair:
    without it sigma would fall at that gain.
    """
    known = np.isfinite(values)
    some = np.where(known.any(axis=1, keepdims=True), values, 0.0)
    middle = np.where(known.mean(axis=1) >= LEAST_KNOWN, np.nanmedian(some, axis=1), np.nan)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values))[:, None], 0), axis=0)
    apart = np.take_along_axis(values, last, axis=0) - middle[:, None]
    count = np.maximum(np.isfinite(apart).sum(axis=1), 1)
    std = np.sqrt(np.nansum(apart**2, axis=1) / count)
    return middle, np.where(np.isfinite(middle), std, np.nan)


def largest_gain(
    aircraft: Aircraft | ClosedAirframe, laws: Sequence[Law], airspeeds_m_s: Sequence[float]
) -> float:
    """Return the gain that would add about .6 of zeta, were there no lag, at each airspeed.

    With |L| at wn, a damper without lag adds |L| zeta.
    """
    most = 0.0
    for law, speed in zip(laws, airspeeds_m_s, strict=True):
        G = aircraft.at(speed)  # noqa: N806
        p = G.dutch_roll
        wn, zeta = float(np.median(np.abs(p))), float(np.median(-p.real / np.abs(p)))
        at = np.array([1j * wn])
        size = float(np.median(np.abs(G.at(at)))) * law.scaling
        most = max(most, LARGEST_ZETA_ADDED / max(size * max(zeta, 0.02), 1e-9))
    return most


def nice(step: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is not above ``step``."""
    unit = 10.0 ** np.floor(np.log10(step) + 1e-9)
    return float(max(unit * each for each in (1.0, 2.0, 5.0) if unit * each <= step * (1 + 1e-9)))


def recommended(closed: Closed, flown: float, aim: float | None) -> Recommended | None:
    """Return the band and the gain to fly next; None where no gain may be recommended.

    ``closed`` has finely spaced gains from 0 on. A gain may be recommended where it and all lower
    ones have the margins and add damping at every airspeed, 95 % sure.
    """
    low_aim, high_aim = aimed(aim)
    gains = closed.gains
    stable = closed.phase_margin_deg >= LEAST_PHASE_DEG  # NaN is not
    stable &= closed.gain_margin_db >= LEAST_GAIN_DB
    allowed = np.logical_and.accumulate((stable & closed.damps).all(axis=0))
    zeta = np.where(np.isnan(closed.zeta), np.inf, closed.zeta)
    # The last gain whose least damped airspeed is within the aim, and the first that reaches it.
    least = zeta.min(axis=0)
    within = int(np.flatnonzero(least <= high_aim).max(initial=0))
    if (high := min(int(np.count_nonzero(allowed)) - 1, within)) < 1:
        return None
    low = int(np.flatnonzero(least >= low_aim).min(initial=high))
    band = float(gains[low]), float(gains[high])
    if flown > 0.0:
        step = min(max(flown, band[0]), band[1], MOST_RAISED * flown)
    else:
        added = (zeta - zeta[:, :1]).max(axis=0)
        first = int(np.flatnonzero(added <= FIRST_STEP)[-1])
        step = float(gains[min(max(first, 1), max(low, 1))])
    return Recommended(low=band[0], high=band[1], next=step)


def table(closed: Closed) -> list[DamperGain]:
    """Return the predictions as they are printed."""
    speeds = [*enumerate(map(float, closed.airspeeds_m_s))]
    return [
        DamperGain(value=gain, at=[DamperAt(airspeed_m_s=v, **closed.at(i, m)) for i, v in speeds])
        for m, gain in enumerate(closed.gains.tolist())
    ]
