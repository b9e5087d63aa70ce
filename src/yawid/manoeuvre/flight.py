"""A flight's answers from its usable manoeuvres, one for each loop, by a random-effects mean.

Another loop makes it another aircraft. From one condition to another wn = kappa V, zeta is
constant, and the numbers of eq. 22-23 go with a power of V, the equivalent airspeed (``POWERS``).
Manoeuvres scatter by more than the sigma of one fit, so the flight's sigma is that of the next
manoeuvre: sqrt(tau^2 + se^2), with tau the scatter between them (DerSimonian and Laird 1986). What
the structure leaves out is common to all of them: that part of sigma is added and does not shrink.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from msgspec import structs

from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import (
    TAU_WN_SHARE,
    TAU_ZETA,
    BetweenStd,
    DutchRoll,
    Flight,
    Manoeuvre,
    Value,
)
from yawid.blocks import Bools, Floats
from yawid.manoeuvre.conditions import SIGMAS, Finding
from yawid.manoeuvre.judge import rough_reasons
from yawid.quantities.vehicles import AIRFRAME

FEW = 4
"""Up to this number, manoeuvres do not show how much they scatter: there tau has a floor. With more
of them the floor sinks, as the uncertainty of a scatter does."""
DISAGREE_WN = 0.1
"""The part of wn by which a manoeuvre must differ to disagree with the others."""
LEAST_STD = 1e-6
"""The least relative sigma: a record without noise has sigma 0, and by the weight of 1e-9 the other
manoeuvres of a flight would be lost in rounding."""
LEAST_AGREEING = 2.0 / 3.0
"""The share of weight that must agree, or else ``manoeuvres_disagree`` is fatal: without it two
that differ would be one answer. Carried over from earlier pooling."""
LEFT_OUT: Final = (": it is left out of the answer", ": they are left out of the answer")
POWERS: Final = {
    "K": 1, "T_theta_s": -1, "a_z_beta": 1, "a_my_omega_y": 1, "a_my_beta": 2, "a_my_delta_h": 2,
}  # fmt: skip
"""The power of V with which each number of eq. 22-23 goes at constant air density: derivatives of
moments by angles as V^2, those by rates and of forces as V; T is 1 / a_z, K is a_delta a_z / wn^2.
"""


@dataclass(frozen=True, slots=True)
class Pooled:
    """A mean over manoeuvres, its standard error, and ``tau``, the scatter between them.

    ``noise`` is the standard error that noise alone explains, ``beyond`` the error that all have in
    common.
    """

    mean: float
    error: float
    tau: float
    noise: float
    beyond: float

    @property
    def std_mean(self) -> float:
        """The sigma of the mean."""
        return math.hypot(self.error, self.beyond)

    @property
    def std(self) -> float:
        """The sigma of the result of a next manoeuvre."""
        return math.sqrt(self.error**2 + self.tau**2 + self.beyond**2)

    def times(self, by: float) -> Value:
        """Return it in another unit or at another airspeed."""
        return Value(by * self.mean, by * self.std, by * self.noise)


def pooled(x: Floats, std: Floats, floor: float, beyond: Floats) -> Pooled:
    """Return the random-effects mean of x (n,) with their own sigmas of noise ``std`` (n,), n >= 1.

    ``floor`` is the least tau up to n = 4; from there it sinks as 1/sqrt(n - 1). ``beyond`` (n,)
    holds the sigmas that noise does not explain; their root mean square is common to all.
    """
    std = np.maximum(std, LEAST_STD * np.abs(x))
    weights = std**-2.0
    n, total = len(x), weights.sum()
    fixed = float(weights @ x / total)
    spread = float(weights @ (x - fixed) ** 2)
    surplus = total - (weights**2).sum() / total
    tau2 = max(0.0, (spread - (n - 1)) / surplus) if n > 1 else 0.0
    tau = max(math.sqrt(tau2), floor * min(1.0, math.sqrt((FEW - 1) / max(n - 1, 1))))
    weights = 1.0 / (std**2 + tau**2)
    mean = float(weights @ x / weights.sum())
    common = float(np.sqrt(np.mean(beyond**2)))
    return Pooled(mean, float(weights.sum() ** -0.5), tau, float(total**-0.5), common)


def flights_of(
    answered: Sequence[Manoeuvre], of_the_log: list[Reason], untrue: Finding | None = None
) -> list[Flight]:
    """Return an answer for each loop with a usable manoeuvre, the headline first.

    The headline is the loop in which most usable manoeuvres were flown, by number, then by time: by
    how well each is known, a setting that changes sigma would make it another aircraft. A verdict
    includes the reasons ``of_the_log``. ``untrue`` says why the airspeed cannot be true: then it is
    not reported. If no manoeuvre is usable, the one answer says why; without any there is none.
    """
    if not answered:
        return []
    if untrue is not None:
        of_the_log = [*of_the_log, untrue.reason]
    usable = [each for each in answered if each.verdict.usable]
    if not usable:
        return [_refused(answered, of_the_log)]
    by_loop: dict[str, list[Manoeuvre]] = {}
    for each in usable:
        by_loop.setdefault(each.loop, []).append(each)

    def flown(alike: list[Manoeuvre]) -> tuple[int, float]:
        return len(alike), sum(each.duration_s for each in alike)

    in_turn = sorted(by_loop.values(), key=flown, reverse=True)
    return [_together(alike, of_the_log, untrue) for alike in in_turn]


def _refused(answered: Sequence[Manoeuvre], of_the_log: list[Reason]) -> Flight:
    """Return a flight without a usable manoeuvre: its reasons are those of the best manoeuvre."""
    best = min(answered, key=lambda each: each.standing)
    where = f"manoeuvre {best.n}, {best.from_s:.0f} to {best.to_s:.0f} s: "
    said = [structs.replace(reason, text=where + reason.text) for reason in best.verdict.reasons]
    verdict = Verdict.of([*of_the_log, *said], best.verdict.method)
    return Flight(used=[], disagree=[], verdict=verdict)


def _together(
    alike: Sequence[Manoeuvre], of_the_log: list[Reason], untrue: Finding | None
) -> Flight:
    """Return the answer from the manoeuvres of one loop.

    An airspeed that is wrong by one factor still serves to compare manoeuvres.
    """
    rolls = np.array([_dutch_roll(each) for each in alike])
    speeds = np.array([each.airspeed_m_s or np.nan for each in alike])
    sources = {each.airspeed_source for each in alike}
    scaled = sources == {"airspeed"} and (untrue is None or untrue.is_factor)
    by = speeds if scaled else np.ones(len(alike))
    x, std = rolls[:, 0] / by, rolls[:, 1] / by
    agree, share = agreement(x, std, TAU_WN_SHARE * float(np.median(x)), DISAGREE_WN)
    used = [alike[i] for i in np.flatnonzero(agree).tolist()]
    rest = [(alike[i], float(rolls[i, 0])) for i in np.flatnonzero(~agree).tolist()]
    is_true, median = untrue is None, float(np.median(speeds[agree]))
    unit = median if scaled and math.isfinite(median) else 1.0
    speed = median if is_true and math.isfinite(median) else None
    heights = [h for each in used if (h := each.altitude_m) is not None]
    floor = TAU_WN_SHARE * float(np.median(x[agree]))
    _, _, zetas, zeta_stds, wn_beyond, zeta_beyond = rolls[agree].T
    wn = pooled(x[agree], std[agree], floor, wn_beyond / by[agree])
    zeta = pooled(zetas, zeta_stds, TAU_ZETA, zeta_beyond)
    physics = _physics(used, by[agree])
    swing = _swing(used, by[agree] / unit, zeta.mean)
    reasons = [*of_the_log, *_warnings(used), *rough_reasons(wn.mean * unit, wn.std * unit)]
    if rest:
        apart = [(each.n, f"wn {own:.3g} rad/s", each.airspeed_m_s) for each, own in rest]
        text = disagreement(apart, f"{wn.mean * unit:.3g} ± {wn.std * unit:.2g}", speed, len(used))
        reasons.append(left_out(text, len(apart), share))
    verdict = Verdict.of(reasons, Counter(m.verdict.method for m in used).most_common(1)[0][0])
    loop = used[0].loop
    return Flight(
        method=verdict.method,
        airspeed_m_s=speed,
        airspeed_source=_common(sources) if is_true else None,
        airspeed_kind=_common({m.airspeed_kind for m in alike}) if is_true else None,
        altitude_m=float(np.median(heights)) if heights else None,
        date=used[0].date,
        loop=loop,
        dutch_roll=DutchRoll.of(
            (wn.mean * unit, wn.std * unit, zeta.mean, zeta.std),
            (wn.noise * unit, zeta.noise),
            (wn.std_mean * unit, zeta.std_mean),
            has_level=loop == AIRFRAME,
        ),
        kappa_rad_m=wn.times(1.0) if scaled and is_true else None,
        K_per_V=physics["K"].times(1.0) if "K" in physics and scaled and is_true else None,
        physics={n: each.times(unit ** POWERS[n]) for n, each in physics.items()} or None,
        overshoot_pct=swing.get("overshoot_pct"),
        settling_s=swing.get("settling_s"),
        between_std=BetweenStd(wn_rad_s=wn.tau * unit, zeta=zeta.tau),
        used=[each.n for each in used],
        disagree=[each.n for each, _ in rest],
        verdict=verdict,
    )


def _common(values: set[str | None]) -> str | None:
    """Return the value that all have in common, None where they differ."""
    return next(iter(values)) if len(values) == 1 else None


def _warnings(used: Sequence[Manoeuvre]) -> Iterator[Reason]:
    """Yield the warnings that more than half of the manoeuvres used have.

    How well wn is known is judged of their mean.
    """
    said = [r for each in used for r in each.verdict.reasons if r.id != "poorly_known"]
    counts = Counter(reason.id for reason in said)
    for reason in said:
        count = counts.pop(reason.id, 0)
        if 2 * count > len(used):
            where = f"in {count} of {len(used)} manoeuvres: " if len(used) > 1 else ""
            yield structs.replace(reason, text=where + reason.text)


def agreement(x: Floats, std: Floats, floor: float, near: float) -> tuple[Bools, float]:
    """Return which of the numbers x (n,) agree with their weighted median, and the share of weight.

    A number disagrees if it differs from the median by more than the part ``near`` of it, and by
    more than three sigmas of the difference. All sigmas include the least scatter ``floor``, the
    same for all: as a part of each value it would give less weight to larger values for that alone.
    """
    total = np.hypot(std, floor)
    weights = total**-2.0
    order = np.argsort(x)
    summed = np.cumsum(weights[order])
    middle = order[int(np.searchsorted(summed, 0.5 * summed[-1]))]
    apart = np.abs(x - x[middle])
    sigma = np.hypot(total, total[middle])
    agree = (apart <= near * x[middle]) | (apart <= SIGMAS * sigma)
    return agree, float(weights[agree].sum() / weights.sum())


def disagreement(
    apart: Sequence[tuple[int, str, float | None]], rest: str, speed: float | None, count: int
) -> str:
    """Return in words which manoeuvres, by number, result and airspeed, differ from the ``rest``.

    The others are ``count`` manoeuvres at ``speed``, which is None where it is not compared.
    """
    said = []
    for n, own, v in apart:
        at = "" if v is None or speed is None else f" at {v:.1f} m/s"
        said.append(f"manoeuvre {n} has {own}{at}")
    others = f"the other {count} have" if count > 1 else "the other one has"
    at = "" if speed is None else f" at {speed:.1f} m/s"
    return f"{', '.join(said)}; {others} {rest}{at}"


def left_out(text: str, count: int, share: float) -> Reason:
    """Return the reason that ``count`` manoeuvres disagree with those of this share of weight."""
    text += LEFT_OUT[count > 1]
    return Reason(
        "manoeuvres_disagree", text, weight="warning" if share >= LEAST_AGREEING else "fatal"
    )


def _dutch_roll(each: Manoeuvre) -> tuple[float, ...]:
    """Return wn, zeta, each with its sigma of noise, then what noise does not explain of both."""
    roll = each.dutch_roll
    assert roll is not None  # a usable manoeuvre has one
    stds = np.array([roll.wn_std, roll.zeta_std], np.float64)
    noise = np.array([roll.wn_std_noise, roll.zeta_std_noise], np.float64)
    beyond = np.sqrt(np.maximum(stds**2 - noise**2, 0.0))
    return (roll.wn_rad_s, noise[0], roll.zeta, noise[1], *beyond.tolist())


def _physics(used: Sequence[Manoeuvre], speeds: Floats) -> dict[str, Pooled]:
    """Return the numbers of eq. 22-23 over the power of V with which they go, where known.

    ``speeds`` (n,) are the airspeeds of the n manoeuvres.
    """
    known = [(each.answer and each.answer.physics) or {} for each in used]
    return {
        name: mean
        for name, power in POWERS.items()
        if (mean := _mean([x.get(name) for x in known], speeds**power, TAU_WN_SHARE * abs(power)))
    }


def _swing(used: Sequence[Manoeuvre], faster: Floats, zeta: float) -> dict[str, Value]:
    """Return the overshoot and the settling time at the flight's airspeed, where known.

    ``faster`` (n,) are the airspeeds of the n manoeuvres over it. Between manoeuvres both scatter
    as zeta and wn do at least.
    """
    floors = {  # with the power of V with which each goes
        "overshoot_pct": (0, TAU_ZETA * math.pi / (1.0 - zeta**2) ** 1.5),
        "settling_s": (-1, math.hypot(TAU_WN_SHARE, TAU_ZETA / zeta)),
    }
    return {
        name: mean.times(1.0)
        for name, (power, least) in floors.items()
        if (mean := _mean([getattr(m.answer, name, None) for m in used], faster**power, least))
    }


def _mean(values: Sequence[Value | None], by: Floats, floor: float) -> Pooled | None:
    """Return the mean of the numbers of n manoeuvres over ``by`` (n,), None where none is known.

    ``floor`` is the least scatter between them, relative. Half of a variance counts as common to
    all manoeuvres: what a structure leaves out is.
    """
    rows = np.array([(each.value, each.std) if each else (None, None) for each in values], float)
    known = np.isfinite(rows).all(axis=1) & (rows[:, 1] > 0.0)
    if not known.any():
        return None
    x, std = (rows[known] / by[known, None]).T
    half = math.sqrt(0.5) * std
    return pooled(x, half, floor * abs(float(np.median(x))), half)
