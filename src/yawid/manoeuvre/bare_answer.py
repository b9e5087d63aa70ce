"""The answer on the bare airframe: of one manoeuvre, and of a flight from all its manoeuvres.

It rests on the manoeuvres that pass the gates; where none does, on one fit over all of one speed.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np

from yawid.answers.reasons import KINDS, Reason, Verdict
from yawid.answers.run_summary import (
    TAU_WN_SHARE,
    TAU_ZETA,
    Bare,
    DutchRoll,
    Flight,
    Manoeuvre,
    TimeConstant,
    Value,
)
from yawid.blocks import AIRSPEED_SHARE
from yawid.lateral.airframe import Airframe, Known, with_modes
from yawid.lateral.fit_airframe import ANSWERED, fit_airframe, mean
from yawid.lateral.gates import GATES, facts_against, stopped_by
from yawid.lateral.motion import Motion
from yawid.manoeuvre.conditions import SIGMAS
from yawid.manoeuvre.feedback import rate_feedback
from yawid.manoeuvre.flight import DISAGREE_WN, LEAST_AGREEING, agreement, disagreement, left_out
from yawid.quantities.flying_qualities import dutch_roll_level, wrong_sign
from yawid.quantities.vehicles import AIRFRAME
from yawid.results.yaw_loop import damped_by

BARE_UNKNOWN: Final = "bare_unknown"
DISAGREE: Final = "manoeuvres_disagree"
WRONG_SIGN: Final = "wrong_sign"
CHECK_AILERON: Final = "Check the aileron's servo, and SERVOn_REVERSED of the output that moves it."
RECORD: Final = "Record ATTITUDE, an airspeed and all servo outputs, at 25 Hz or more."
LAG_DIFFERS: Final = "lag_differs"
"""Without it a lag that was .1 s wrong was believed, with wn up to 4 sigma off."""
OF_ALL: Final = frozenset((
    "lag_unknown", "several_minima", "wn_uncertain", "aileron_uncertain", "rudder_without_effect",
    "not_settled",
))  # fmt: skip
"""The gates that more manoeuvres may pass together; the others speak against the data."""
LAWS: Final[Mapping[str, int]] = {
    "Y_beta": 1, "Y_delta_r": 1, "L_p": 1, "L_r": 1, "N_p": 1, "N_r": 1,
    "L_beta": 2, "L_delta_a": 2, "L_delta_r": 2, "N_beta": 2, "N_delta_a": 2, "N_delta_r": 2,
    "wn_rad_s": 1, "zeta": 0, "roll_mode": -1, "spiral": 1, "servo_lag_s": 0, "rudder_mix": -2,
    "alpha_rad": -2,
}  # fmt: skip
"""The power of the airspeed to which each number is proportional, in air of one density."""
MOST_TOGETHER: Final = 6
"""The most manoeuvres of one airspeed in one fit, which takes longer with each."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """A manoeuvre's motion, or in words why there is none, and what the fit found in it."""

    n: int
    motion: Motion | str
    airframe: Airframe | None
    why: str = ""
    step: str | None = None

    @property
    def is_known(self) -> bool:
        """Whether all gates let the airframe pass."""
        return self.airframe is not None and not self.airframe.failed

    @property
    def may_join(self) -> bool:
        """Whether it may be in a fit over several manoeuvres."""
        return self.airframe is not None and self.airframe.failed.keys() <= OF_ALL


def yaw_damped(n: int, gains: str) -> Fitted:
    """Return manoeuvre ``n`` refused, as a yaw damper with these gains moved the rudder.

    On a flight of SITL with gains up to 8 wn was 9 % high, and nothing else showed it.
    """
    why, remedy = damped_by(gains)
    return Fitted(n, why, None, why, _sentences([remedy]))


def fitted(n: int, motion: Motion | str, servo_lag_s: float | None, flown: Manoeuvre) -> Fitted:
    """Fit the airframe to the motion of manoeuvre ``n``, unless that is refused without a fit.

    ``flown`` is its answer as flown, in which the rudder must have driven the yaw.
    """
    if isinstance(motion, str):
        return Fitted(n, motion, None, motion, RECORD)
    lacks = facts_against(motion, flown, servo_lag_s)
    if lacks:
        why, step = "; ".join(said for said, _ in lacks), _sentences([cure for _, cure in lacks])
        return Fitted(n, motion, None, why, step)
    found, why = _fit([motion], servo_lag_s)
    if found is not None:
        fed_back = stopped_by({"rudder_feeds_back": _fed_back(motion, found)})
        found = replace(found, failed={**fed_back, **found.failed})
    return Fitted(n, motion, found, why)


def against_flown(found: Fitted, flown: Manoeuvre) -> Fitted:
    """Return a fit, refused where it is not the aircraft of a usable answer as flown.

    It must be that itself where only the sticks flew, else closed with the roll law, if one is
    found.
    """
    airframe, roll = found.airframe, flown.dutch_roll
    if airframe is None:
        return found
    own: tuple[Known, Known] | None = airframe.wn_rad_s, airframe.zeta
    if flown.loop != AIRFRAME:
        own = airframe.as_flown if flown.inputs == ["rudder"] else None
    if own is None or roll is None or not flown.verdict.usable:
        return found
    failed = {**airframe.failed, **stopped_by({"differs_from_flown": _away(own, roll)})}
    return replace(found, airframe=replace(airframe, failed=failed))


def _away(own: tuple[Known, Known], flown: DutchRoll) -> float:
    """Return by how many sums of both sigmas an answer as flown differs in wn or zeta."""
    return max(
        abs(own[0].value - flown.wn_rad_s) / (own[0].std + (flown.wn_std or 0.0)),
        abs(own[1].value - flown.zeta) / (own[1].std + (flown.zeta_std or 0.0)),
    )


def _fed_back(motion: Motion, found: Airframe) -> float:
    """Return the share of the rudder near the mode that is feedback of the yaw rate."""
    wn = found.wn_rad_s.value
    if not math.isfinite(wn):
        return 0.0
    middles_s = (np.arange(len(motion.r)) + 0.5) * motion.sample_time_s
    rudder, aileron = (
        np.interp(middles_s, motion.command_times_s(), u) for u in (motion.rudder, motion.aileron)
    )
    fed_back = rate_feedback(rudder, motion.r, aileron, wn, motion.sample_time_s)
    return 0.0 if fed_back is None else fed_back.share


def _fit(motions: Sequence[Motion], servo_lag_s: float | None) -> tuple[Airframe | None, str]:
    try:
        with np.errstate(all="ignore"):  # a step too far is not taken, and nobody need read of it
            return fit_airframe(motions, servo_lag_s=servo_lag_s), ""
    except Exception as error:  # whatever happens here, the answer as flown must stay
        return None, f"the fit failed: {error}"


def lateral_of(found: Fitted) -> Bare:
    """Return the answer on the airframe of one manoeuvre."""
    if found.airframe is None:
        return _unknown([found.n], found.why, found.step)
    return _answer(found.airframe, [found.n])


def _sentences(remedies: Sequence[str]) -> str:
    """Return what to do in sentences, each once."""
    return " ".join(f"{each[0].upper()}{each[1:]}." for each in dict.fromkeys(remedies))


def _unknown(used: Sequence[int], text: str, step: str | None) -> Bare:
    said = Reason(BARE_UNKNOWN, text, weight="warning")
    return Bare(used=list(used), verdict=Verdict(usable=False, reasons=[said], next=step))


def _answer(airframe: Airframe, used: Sequence[int]) -> Bare:
    if airframe.failed:
        return _stopped(airframe.failed, used)
    speed, gust = airframe.airspeed_m_s, airframe.gust_std_rad
    return _with_lag(_bare(_numbers(airframe), speed, gust, airframe.rho1, used), [airframe])


def _with_lag(found: Bare, airframes: Sequence[Airframe]) -> Bare:
    """Return an answer, with a warning where the airframes show another servo lag than given."""
    lags, stds = np.array([(a.free_lag_s.value, a.free_lag_s.std) for a in airframes]).T
    own, given = mean(lags, stds, "servo_lag_s", {}), airframes[0].given_lag_s
    if not abs(own.value - given.value) > SIGMAS * math.hypot(own.std, given.std):
        return found
    text = (
        f"the servo lag given is {given.value:.3g} s, and without it the fit finds "
        f"{own.value:.3f} ± {own.std:.3f} s"
    )
    return _warned(found, Reason(LAG_DIFFERS, text))


def _warned(found: Bare, *said: Reason) -> Bare:
    """Return a usable answer with further warnings."""
    reasons = [*found.verdict.reasons, *said]
    return msgspec.structs.replace(found, verdict=Verdict(usable=True, reasons=reasons))


def _stopped(failed: Mapping[str, float], used: Sequence[int], step: str = "") -> Bare:
    """Return an answer stopped by gates, the one that decides first, with the remedy of each.

    ``step`` replaces these remedies.
    """
    decides = list(GATES)
    names = sorted(failed, key=decides.index)
    said = [GATES[name].said(failed[name]) for name in names]
    step = step or _sentences([GATES[name].remedy for name in names])
    return _unknown(used, "; ".join(said), step)


def _numbers(of: Airframe) -> dict[str, Known]:
    """Return what is answered of an airframe by the names of LAWS."""
    return {
        "wn_rad_s": of.wn_rad_s, "zeta": of.zeta, "roll_mode": of.roll_s, "spiral": of.spiral_s,
        "servo_lag_s": of.servo_lag_s, "rudder_mix": of.rudder_mix, "alpha_rad": of.alpha_rad,
        **of.derivatives,
    }  # fmt: skip


def _bare(
    numbers: Mapping[str, Known], airspeed_m_s: float, gust: float, rho1: float, used: Sequence[int]
) -> Bare:
    wn, zeta = numbers["wn_rad_s"], numbers["zeta"]
    bare = Bare(
        dutch_roll=DutchRoll(
            wn_rad_s=wn.value, wn_std=wn.std, zeta=zeta.value, zeta_std=zeta.std,
            level=dutch_roll_level(wn.value, zeta.value),
        ),
        roll_mode=_constant(numbers["roll_mode"]),
        spiral=_constant(numbers["spiral"]),
        derivatives={
            name: value
            for name in Bare.NAMES
            if name in numbers and (value := _value(numbers[name])) is not None
        },
        alpha_rad=_value(numbers["alpha_rad"]),
        servo_lag_s=_value(numbers["servo_lag_s"]), rudder_mix=_value(numbers["rudder_mix"]),
        gust_std_rad=gust, whiteness_rho1=rho1, airspeed_m_s=airspeed_m_s, used=list(used),
        verdict=Verdict(usable=True, reasons=[]),
    )  # fmt: skip
    said = [
        Reason(WRONG_SIGN, text, CHECK_AILERON if name == "L_delta_a" else None)
        for name, x in numbers.items()
        if (text := wrong_sign(name, x.value, x.std))
    ]
    return _warned(msgspec.structs.replace(bare, rudder_mix=None), *said) if said else bare


def _value(known: Known) -> Value | None:
    if not math.isfinite(known.value):
        return None
    return Value(known.value, known.std if math.isfinite(known.std) else None)


def _constant(known: Known) -> TimeConstant | None:
    if not math.isfinite(known.value):
        return None
    return TimeConstant(known.value, known.std if math.isfinite(known.std) else None)


def bare_of(
    found: Sequence[Fitted], servo_lag_s: float | None, flown: Flight | None = None
) -> Bare | None:
    """Return the airframe of a flight at the median airspeed of the manoeuvres used.

    None is returned where there is no manoeuvre. Where no airframe is known the reasons are those
    of the manoeuvre whose fit knows wn best. ``flown`` is the flight's usable answer as flown where
    only the sticks moved the surfaces: that must be the same aircraft.
    """
    if not found:
        return None
    known = [(each.airframe, [each.n]) for each in found if each.is_known and each.airframe]
    if not known:
        known = [pair for group in _of_one_speed(found) if (pair := _together(group, servo_lag_s))]
    if not known:
        return lateral_of(min(found, key=_uncertainty))
    agree, share = _agreement([each for each, _ in known])
    used, apart = ([each for each, own in zip(known, agree, strict=True) if own == is_in]
                   for is_in in (True, False))  # fmt: skip
    numbers = sorted(n for _, ns in used for n in ns)
    answer = _answer(*used[0]) if len(used) == 1 else _pooled([a for a, _ in used], numbers)
    if apart:
        text = _disagreement(apart, answer)
        if share < LEAST_AGREEING:
            text = f"the manoeuvres do not show one airframe: {text}"
            both = sorted(n for _, ns in known for n in ns)
            return _unknown(both, text, KINDS[DISAGREE].now)
        answer = _warned(answer, left_out(text, len(apart), share))
    if failed := dict(_against_pool(answer, found, flown)):
        return _stopped(failed, answer.used, KINDS[DISAGREE].now)
    return _with_correlations(answer, [each for each, _ in used])


def _agreement(airframes: Sequence[Airframe]) -> tuple[np.ndarray, float]:
    """Return which airframes (n,) are one aircraft's by wn / V and by zeta; the share of weight."""
    speeds, wn, wn_std, zeta, zeta_std = np.array([
        (a.airspeed_m_s, a.wn_rad_s.value, a.wn_rad_s.std, a.zeta.value, a.zeta.std)
        for a in airframes
    ]).T  # fmt: skip
    x, std = wn / speeds, np.fmin(wn_std, wn) / speeds  # a sigma that is not known is large
    agree, share = agreement(x, std, TAU_WN_SHARE * float(np.median(x)), DISAGREE_WN)
    by_zeta, of_zeta = agreement(zeta, np.fmin(zeta_std, 1.0), TAU_ZETA, 0.0)
    both = agree & by_zeta
    return both, min(share, of_zeta) if both.any() else 0.0


def _disagreement(apart: Sequence[tuple[Airframe, list[int]]], rest: Bare) -> str:
    """Return in words which airframes differ from that of the rest."""
    roll = rest.dutch_roll
    assert roll is not None  # only airframes that are known are compared
    said = [
        (n, f"wn {a.wn_rad_s.value:.3g} rad/s, zeta {a.zeta.value:.2g}", a.airspeed_m_s)
        for a, ns in apart
        for n in ns
    ]
    own = f"wn {roll.wn_rad_s:.3g} rad/s, zeta {roll.zeta:.2g}"
    return disagreement(said, own, rest.airspeed_m_s, len(rest.used))


def _against_pool(
    found: Bare, each: Sequence[Fitted], flown: Flight | None
) -> Iterator[tuple[str, float]]:
    """Yield what was found for the gates that stop the answer from all, each of which passed."""
    roll = found.dutch_roll
    assert roll is not None  # it is known
    yield from stopped_by({"wn_uncertain": (roll.wn_std or 0.0) / roll.wn_rad_s}).items()
    if flown is None or flown.dutch_roll is None or found.airspeed_m_s is None:
        return
    speeds = [e.motion.airspeed_m_s for e in each
              if e.n in flown.used and isinstance(e.motion, Motion)]  # fmt: skip
    by = float(np.median(speeds)) / found.airspeed_m_s if speeds else 1.0
    wn = Known(by * roll.wn_rad_s, by * (roll.wn_std or 0.0))
    own = wn, Known(roll.zeta, roll.zeta_std or 0.0)
    yield from stopped_by({"differs_from_flown": _away(own, flown.dutch_roll)}).items()


def _uncertainty(found: Fitted) -> float:
    """Return the sigma of wn over wn, infinite where there is none."""
    wn = Known() if found.airframe is None else found.airframe.wn_rad_s
    share = wn.std / wn.value
    return share if math.isfinite(share) else math.inf


def _with_correlations(found: Bare, airframes: Sequence[Airframe]) -> Bare:
    """Return it with the mean correlations, and with the names that every prior determines."""
    names = [*(found.derivatives or {}), "alpha_rad", "servo_lag_s"]
    at = [ANSWERED.index(name) for name in names]
    rows = np.mean([each.correlations for each in airframes], axis=0)[np.ix_(at, at)]
    prior = [n for n in ANSWERED if all(n in each.from_prior for each in airframes)]
    if len(airframes) > 1:
        found = with_modes(found, rows)
    return msgspec.structs.replace(
        found, correlations=rows.round(4).tolist(), from_prior=prior or None
    )


def _of_one_speed(found: Sequence[Fitted]) -> list[list[Fitted]]:
    """Return the manoeuvres that may be fitted together, in groups of one airspeed."""
    groups: list[list[Fitted]] = []
    for each in found:
        if not each.may_join or isinstance(each.motion, str):
            continue
        v = each.motion.airspeed_m_s
        near = [g for g in groups if abs(_speed(g[0]) - v) <= AIRSPEED_SHARE * v]
        if near:
            near[0].append(each)
        else:
            groups.append([each])
    return [group[:MOST_TOGETHER] for group in groups if len(group) > 1]


def _speed(each: Fitted) -> float:
    assert isinstance(each.motion, Motion)  # only such are grouped
    return each.motion.airspeed_m_s


def _together(
    group: Sequence[Fitted], servo_lag_s: float | None
) -> tuple[Airframe, list[int]] | None:
    agree, share = _agreement([each.airframe for each in group if each.airframe is not None])
    group = [each for each, own in zip(group, agree, strict=True) if own]
    if share < LEAST_AGREEING or len(group) < 2:
        return None
    motions = [each.motion for each in group if isinstance(each.motion, Motion)]
    found, _ = _fit(motions, servo_lag_s)
    if found is None or found.failed:
        return None
    return found, [each.n for each in group]


def _pooled(airframes: Sequence[Airframe], used: Sequence[int]) -> Bare:
    """Return the weighted mean of several airframes, each brought to the median airspeed by LAWS.

    Sigma is that of the mean, made larger where they scatter by more than their own sigmas; what a
    linear model is worth stays in it whole.
    """
    speeds = np.array([each.airspeed_m_s for each in airframes])
    middle = float(np.median(speeds))
    rows = [_numbers(each) for each in airframes]
    numbers: dict[str, Known] = {}
    for name in rows[0]:
        by = (middle / speeds) ** LAWS[name]
        value = by * np.array([row[name].value for row in rows])
        std = np.abs(by) * np.array([row[name].std for row in rows])
        numbers[name] = mean(value, std, name, numbers)
    gust = float(np.median([each.gust_std_rad for each in airframes]))
    rho1 = max((each.rho1 for each in airframes), key=abs)
    return _with_lag(_bare(numbers, middle, gust, rho1, used), airframes)
