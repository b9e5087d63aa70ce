"""The answer on the bare airframe: of one manoeuvre, and of a flight from all its manoeuvres.

A manoeuvre that its gates stop has a verdict and no numbers. A flight's airframe rests on the
manoeuvres that pass; where none passes alone, one fit over those of one airspeed may still know the
servo's lag. From one airspeed to another derivatives and modes change by their laws (LAWS).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np

from yawid.answers.run_summary import (
    Bare,
    DutchRoll,
    Manoeuvre,
    ReasonSummary,
    TimeConstant,
    Value,
    VerdictSummary,
)
from yawid.blocks import AIRSPEED_SHARE
from yawid.lateral.airframe import Airframe, AsFlown, FailedGate, Known
from yawid.lateral.fit_airframe import ANSWERED, fit_airframe, floor
from yawid.lateral.gates import GATES
from yawid.lateral.motion import Motion
from yawid.manoeuvres.feedback import rate_feedback
from yawid.quantities.flying_qualities import dutch_roll_level
from yawid.quantities.vehicles import AIRFRAME
from yawid.results.structures import seen_in

BARE_UNKNOWN: Final = "bare_unknown"
OF_ALL: Final = frozenset(
    {"lag_unknown", "wn_uncertain", "aileron_uncertain", "rudder_without_effect", "not_settled"}
)
"""The gates that more manoeuvres may pass together; the others speak against the data."""
LAWS: Final[Mapping[str, int]] = {
    "Y_beta": 1, "Y_delta_r": 1, "L_p": 1, "L_r": 1, "N_p": 1, "N_r": 1,
    "L_beta": 2, "L_delta_a": 2, "L_delta_r": 2, "N_beta": 2, "N_delta_a": 2, "N_delta_r": 2,
    "wn_rad_s": 1, "zeta": 0, "roll_mode": -1, "spiral": 1, "servo_lag_s": 0, "rudder_mix": -2,
    "alpha_rad": -2,
}  # fmt: skip
"""The power of the airspeed to which each number is proportional, in air of one density."""
FED_BACK: Final = 0.1
"""The most of the rudder near the mode that may feed back the yaw rate: with .21 to .29 flights
of SITL in turbulence had zeta .46 to .57 for .63. Without a damper none is seen at all."""
MOST_APART: Final = 1.0
"""The most by which the airframe, flown as it was, may differ from the answer as flown, in sums of
both sigmas."""
NOT_DRIVEN: Final = frozenset({"not_excited", "mode_not_driven"})
"""The reasons against an answer as flown that also stop the airframe: at the end of a go-around,
with the rudder moved by the autopilot to one side, wn was 9 % low with a sigma of 2.5 %."""
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
        return self.airframe is not None and self.airframe.is_known

    @property
    def may_join(self) -> bool:
        """Whether it may be in a fit over several manoeuvres."""
        return self.airframe is not None and {g.name for g in self.airframe.failed} <= OF_ALL


def yaw_damped(n: int, gains: str) -> Fitted:
    """Return manoeuvre ``n`` refused, as a yaw damper with these gains moved the rudder.

    On a flight of SITL with gains up to 8 wn was 9 % high, and nothing else showed it.
    """
    name = "yaw damper" if "YAW2SRV_DAMP" in gains else "yaw-rate loop"
    why = f"the {name} ({gains}) moves the rudder by the yaw rate of the same sample"
    return Fitted(n, why, None, why, f"Switch the {name} off for the manoeuvre.")


def fitted(n: int, motion: Motion | str, servo_lag_s: float | None) -> Fitted:
    """Fit the airframe to the motion of manoeuvre ``n``."""
    if isinstance(motion, str):
        return Fitted(n, motion, None, motion)
    known = {"no_aileron": motion.aileron_known, "commands_on_grid": motion.commands_exact}
    if lacks := [GATES[name] for name, has in known.items() if not has]:  # no fit is needed
        return Fitted(n, motion, None, lacks[0].sentence, _sentence(lacks[0].remedy))
    found, why = _fit([motion], servo_lag_s)
    if found is not None and (share := _fed_back(motion, found)) > FED_BACK:
        gate = FailedGate("rudder_feeds_back", share, FED_BACK)
        found = replace(found, failed=(gate, *found.failed))
    return Fitted(n, motion, found, why)


def against_flown(found: Fitted, flown: Manoeuvre) -> Fitted:
    """Return a fit, refused where it does not go with the answer as flown.

    The rudder must have driven the yaw, and it must be the aircraft of a usable answer as flown.
    That is the airframe itself where only the sticks flew, else the airframe closed with the roll
    law found. Without a law, or where the aileron is an input as well, nothing is compared.
    """
    against = [each.id for each in flown.verdict.fatal if each.id in NOT_DRIVEN]
    if found.airframe is not None and against:
        why = f"the rudder did not drive the yaw: the answer as flown is {' and '.join(against)}"
        return Fitted(found.n, found.motion, None, why, "Move the rudder there and back.")
    airframe, roll = found.airframe, flown.dutch_roll
    if airframe is None or roll is None or not flown.verdict.usable:
        return found
    own: tuple[Known, Known] | None = airframe.wn_rad_s, airframe.zeta
    if flown.loop != AIRFRAME:
        own = _seen_as_flown(airframe.as_flown, flown, found.motion)
    if own is None:
        return found
    away = max(
        abs(own[0].value - roll.wn_rad_s) / (own[0].std + (roll.wn_std or 0.0)),
        abs(own[1].value - roll.zeta) / (own[1].std + (roll.zeta_std or 0.0)),
    )
    if away <= MOST_APART:
        return found
    gate = FailedGate("differs_from_flown", away, MOST_APART)
    return replace(found, airframe=replace(airframe, failed=(*airframe.failed, gate)))


def _seen_as_flown(
    closed: AsFlown | None, flown: Manoeuvre, motion: Motion | str
) -> tuple[Known, Known] | None:
    """Return wn and zeta that a model of the answer's orders sees of the airframe as flown.

    It has more poles than such a model, which in calm air is the nearest one in output error: for
    SITL's 10.37 rad/s three poles see 10.06. So the same is fitted to the yaw rate that the
    airframe should have. Without a law, or where the aileron is an input as well, it is None.
    """
    if closed is None or flown.inputs != ["rudder"] or isinstance(motion, str):
        return None
    yaw_rate = np.where(np.isfinite(motion.r), closed.yaw_rate, np.nan)
    seen = seen_in(flown.orders, motion.sample_time_s, closed.rudder[:, None], yaw_rate)
    wn, zeta = seen.tolist()
    if not wn > 0.0:
        return closed.wn_rad_s, closed.zeta
    share = wn / closed.wn_rad_s.value
    return Known(wn, share * closed.wn_rad_s.std), Known(zeta, closed.zeta.std)


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
        return fit_airframe(motions, servo_lag_s=servo_lag_s), ""
    except Exception as error:  # whatever happens here, the answer as flown must stay
        return None, f"the fit failed: {error}"


def lateral_of(found: Fitted) -> Bare:
    """Return the answer on the airframe of one manoeuvre."""
    if found.airframe is None:
        return _unknown([found.n], found.why, found.step)
    return _answer(found.airframe, [found.n])


def _sentence(remedy: str) -> str:
    return f"{remedy[0].upper()}{remedy[1:]}."


def _unknown(used: Sequence[int], text: str, step: str | None) -> Bare:
    said = ReasonSummary(BARE_UNKNOWN, "warning", text)
    return Bare(used=list(used), verdict=VerdictSummary(usable=False, reasons=[said], next=step))


def _answer(airframe: Airframe, used: Sequence[int]) -> Bare:
    if airframe.failed:
        gates = [(GATES[each.name], each) for each in airframe.failed]
        text = "; ".join(g.sentence.format(found=e.found, limit=e.limit) for g, e in gates)
        return _unknown(used, text, _sentence(gates[0][0].remedy))
    numbers = {
        "wn_rad_s": airframe.wn_rad_s, "zeta": airframe.zeta, "roll_mode": airframe.roll_s,
        "spiral": airframe.spiral_s, "servo_lag_s": airframe.servo_lag_s,
        "rudder_mix": airframe.rudder_mix, "alpha_rad": airframe.alpha_rad, **airframe.derivatives,
    }  # fmt: skip
    return _bare(numbers, airframe.airspeed_m_s, airframe.gust_std_rad, airframe.rho1, used)


def _bare(
    numbers: Mapping[str, Known], airspeed_m_s: float, gust: float, rho1: float, used: Sequence[int]
) -> Bare:
    wn, zeta = numbers["wn_rad_s"], numbers["zeta"]
    return Bare(
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
        verdict=VerdictSummary(usable=True, reasons=[]),
    )  # fmt: skip


def _value(known: Known) -> Value | None:
    if not math.isfinite(known.value):
        return None
    return Value(known.value, known.std if math.isfinite(known.std) else None)


def _constant(known: Known) -> TimeConstant | None:
    if not math.isfinite(known.value):
        return None
    return TimeConstant(known.value, known.std if math.isfinite(known.std) else None)


def bare_of(found: Sequence[Fitted], servo_lag_s: float | None) -> Bare | None:
    """Return the airframe of a flight at the median airspeed of the manoeuvres used.

    None is returned where there is no manoeuvre. Where no airframe is known the reasons are those
    of the manoeuvre whose fit knows wn best.
    """
    if not found:
        return None
    known = [(each.airframe, [each.n]) for each in found if each.is_known and each.airframe]
    if not known:
        known = [pair for group in _of_one_speed(found) if (pair := _together(group, servo_lag_s))]
    if not known:
        return lateral_of(min(found, key=_uncertainty))
    airframes = [each for each, _ in known]
    one = len(known) == 1
    answer = _answer(*known[0]) if one else _pooled(airframes, [n for _, ns in known for n in ns])
    return _with_correlations(answer, airframes)


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
    motions = [each.motion for each in group if isinstance(each.motion, Motion)]
    found, _ = _fit(motions, servo_lag_s)
    if found is None or not found.is_known:
        return None
    return found, [each.n for each in group]


def _pooled(airframes: Sequence[Airframe], used: Sequence[int]) -> Bare:
    """Return the weighted mean of several airframes, each brought to the median airspeed by LAWS.

    Sigma is that of the mean, made larger where they scatter by more than their own sigmas; what a
    linear model is worth stays in it whole.
    """
    speeds = np.array([each.airspeed_m_s for each in airframes])
    middle = float(np.median(speeds))
    rows = [
        {"wn_rad_s": a.wn_rad_s, "zeta": a.zeta, "roll_mode": a.roll_s, "spiral": a.spiral_s,
         "servo_lag_s": a.servo_lag_s, "rudder_mix": a.rudder_mix, "alpha_rad": a.alpha_rad,
         **a.derivatives}
        for a in airframes
    ]  # fmt: skip
    numbers = {}
    for name in rows[0]:
        by = (middle / speeds) ** LAWS[name]
        value = by * np.array([row[name].value for row in rows])
        std = np.abs(by) * np.array([row[name].std for row in rows])
        numbers[name] = _mean(value, std, name)
    gust = float(np.median([each.gust_std_rad for each in airframes]))
    rho1 = max((each.rho1 for each in airframes), key=abs)
    return _bare(numbers, middle, gust, rho1, used)


def _mean(value: np.ndarray, std: np.ndarray, name: str) -> Known:
    known = np.isfinite(value) & np.isfinite(std) & (std > 0.0)
    if not known.any():
        return Known()
    value, weights = value[known], std[known] ** -2.0
    mean = float(weights @ value / weights.sum())
    scatter = float(weights @ (value - mean) ** 2) / max(len(value) - 1, 1)
    variance = max(scatter, 1.0) / weights.sum() + floor(name, mean) ** 2 * (1.0 - 1.0 / len(value))
    return Known(mean, math.sqrt(variance))
