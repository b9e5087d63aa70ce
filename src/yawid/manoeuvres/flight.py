"""A flight's answer from all its usable manoeuvres, by a random-effects mean.

From one condition to another wn = kappa V, zeta is constant, and K is proportional to V (V is the
equivalent airspeed). Manoeuvres scatter by more than the sigma of one fit, so the flight's sigma is
that of the next manoeuvre: sqrt(tau^2 + se^2), with tau the scatter between them (DerSimonian and
Laird 1986). What the structure leaves out is common to all of them: that part of sigma is added and
does not shrink.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from yawid.answers.run_summary import (
    TAU_WN_SHARE,
    TAU_ZETA,
    BetweenStd,
    DutchRoll,
    Flight,
    Orders,
    Value,
)
from yawid.blocks import Bools, Floats
from yawid.manoeuvres.airspeed_check import Finding
from yawid.manoeuvres.answer import OTHER_ORDERS, Answered, Structure
from yawid.manoeuvres.conditions import AIRFRAME
from yawid.results.judge_estimate import DISAGREE_SIGMAS
from yawid.results.reasons import Reason, Verdict
from yawid.results.summary import as_summary

FEW = 4
"""Up to this number, manoeuvres do not show how much they scatter: there tau has a floor. With more
of them the floor sinks, as the uncertainty of a scatter does."""
DISAGREE_WN = 0.1
"""The part of wn by which a manoeuvre must differ to disagree with the others."""
LEAST_STD = 1e-9
"""The least relative sigma: a record without noise has sigma 0, and a weight must be finite."""
LEAST_AGREEING = 2.0 / 3.0
"""The share of weight that must agree, or else ``manoeuvres_disagree`` is fatal."""
BETTER_PCT = 1.0
"""Points that more parameters must add to the mean held-back fit to be chosen for a flight."""


@dataclass(frozen=True, slots=True)
class Pooled:
    """A mean over manoeuvres, its standard error, and ``tau``, the scatter between them.

    ``noise`` is the standard error that noise alone explains, ``beyond`` the error that all have in
    common, ``least`` how far wrong the mean may be by a warning.
    """

    mean: float
    error: float
    tau: float
    noise: float
    beyond: float
    least: float = 0.0

    @property
    def std(self) -> float:
        """The sigma of the result of a next manoeuvre."""
        return max(math.sqrt(self.error**2 + self.tau**2 + self.beyond**2), self.least)


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


def flight_of(
    answered: Sequence[Answered], of_the_log: list[Reason], untrue: Finding | None = None
) -> tuple[Flight, Verdict] | None:
    """Return the flight's answer and its verdict, which includes the reasons ``of_the_log``.

    ``untrue`` says why the airspeed cannot be true: then it is not reported. None is returned where
    there is no manoeuvre. Each ``loop`` makes it another aircraft: only that with the most usable
    manoeuvres answers, of equally many the airframe.
    """
    if not answered:
        return None
    if untrue is not None:
        of_the_log = [*of_the_log, untrue.reason]
    usable = [each for each in answered if each.verdict.usable]
    if not usable:
        return _refused(answered, of_the_log)
    loops = [each.found.loop for each in usable]
    loop = max(dict.fromkeys(loops), key=lambda name: (loops.count(name), name == AIRFRAME))
    alike = [each for each in usable if each.found.loop == loop]
    orders = _orders(alike)
    told = [each.structures.get(orders) or next(iter(each.structures.values())) for each in alike]
    return _together(alike, told, orders, of_the_log, untrue)


def _refused(answered: Sequence[Answered], of_the_log: list[Reason]) -> tuple[Flight, Verdict]:
    """Return a flight without a usable manoeuvre: its reasons are those of the best manoeuvre.

    The best is the one with the fewest fatal reasons; of several, the longest, which contains the
    most of what was flown.
    """
    best = min(answered, key=lambda each: (each.verdict.weight[0], -each.found.duration_s))
    where = f"manoeuvre {best.found.n}, {best.found.from_s:.0f} to {best.found.to_s:.0f} s: "
    said = [replace(reason, text=where + reason.text) for reason in best.verdict.reasons]
    verdict = Verdict.of([*of_the_log, *said], best.verdict.method)
    return Flight(used=[], disagree=[], verdict=as_summary(verdict)), verdict


def _orders(alike: Sequence[Answered]) -> tuple[int, ...]:
    """Return the flight's orders: the richer ones if they add 1 point to the mean held-back fit.

    With more parameters a model has more modes to choose from. In each manoeuvre both orders must
    have found the same one; otherwise the manoeuvres' own orders are returned.
    """
    own = next(iter(alike[0].structures))
    gains = []
    for each in alike:
        first, other = next(iter(each.structures.values())), each.structures.get(OTHER_ORDERS)
        if other is None or not np.isfinite(other.dutch_roll).all():
            return own
        if abs(other.dutch_roll[0] - first.dutch_roll[0]) > DISAGREE_WN * first.dutch_roll[0]:
            return own
        gains.append(other.held_back_pct - first.held_back_pct)
    known = [gain for gain in gains if math.isfinite(gain)]
    return OTHER_ORDERS if known and np.mean(known) > BETTER_PCT else own


def _together(
    alike: Sequence[Answered],
    told: Sequence[Structure],
    orders: tuple[int, ...],
    of_the_log: list[Reason],
    untrue: Finding | None,
) -> tuple[Flight, Verdict]:
    """Return the answer from the manoeuvres of one aircraft, all estimated with the same orders.

    ``told`` holds their results. An airspeed that is wrong by one factor still serves to compare
    manoeuvres.
    """
    speeds = np.array([each.found.airspeed_m_s or np.nan for each in alike])
    sources = {each.found.airspeed_source for each in alike}
    scaled = sources == {"airspeed"} and (untrue is None or untrue.is_factor)
    by = speeds if scaled else np.ones(len(alike))
    rolls = np.array([each.dutch_roll for each in told])
    x, std = rolls[:, 0] / by, rolls[:, 1] / by
    agree, share = _agreement(x, std)
    used = [each for each, is_in in zip(alike, agree, strict=True) if is_in]
    apart = [each for each, is_in in zip(alike, agree, strict=True) if not is_in]
    speed = float(np.median(speeds[agree])) if np.isfinite(speeds[agree]).all() else None
    unit = speed if scaled and speed is not None else 1.0
    has_kappa = scaled and untrue is None
    if untrue is not None:
        speed = None
    heights = [h for each in used if (h := each.found.altitude_m) is not None]
    warned = list(_warnings(used))
    moves = np.max([(0.0, 0.0), *(reason.moves for reason in warned)], axis=0)
    wn, zeta = _averages([(*each.dutch_roll, *each.beyond) for each in told], by, agree, moves)
    reasons = [*of_the_log, *warned]
    if apart:
        text = _disagreement(apart, wn.mean * unit, wn.std * unit, speed, len(used))
        reasons.append(Reason("manoeuvres_disagree", text, warns=share >= LEAST_AGREEING))
    verdict = Verdict.of(reasons, _most_common(each.verdict.method for each in used))
    loop = used[0].found.loop
    flight = Flight(
        method=verdict.method,
        orders=Orders(*orders),
        airspeed_m_s=speed,
        airspeed_source=_common(sources) if untrue is None else None,
        airspeed_kind=_common({m.found.airspeed_kind for m in alike}) if untrue is None else None,
        altitude_m=float(np.median(heights)) if heights else None,
        date=used[0].found.date,
        loop=loop,
        dutch_roll=DutchRoll.of(
            (wn.mean * unit, wn.std * unit, zeta.mean, zeta.std),
            (wn.noise * unit, zeta.noise),
            has_level=loop == AIRFRAME,
        ),
        kappa_rad_m=Value(wn.mean, wn.std, wn.noise) if has_kappa else None,
        K_per_V=_gain(np.array([(*each.gain, each.beyond[2]) for each in told])[agree], by[agree])
        if has_kappa
        else None,
        between_std=BetweenStd(wn_rad_s=wn.tau * unit, zeta=zeta.tau),
        used=[each.found.n for each in used],
        disagree=[each.found.n for each in apart],
        verdict=as_summary(verdict),
    )
    return flight, verdict


def _averages(
    told: Sequence[tuple[float, ...]], by: Floats, agree: Bools, moves: Floats
) -> tuple[Pooled, Pooled]:
    """Return the means of wn / ``by`` and of zeta over the manoeuvres that agree.

    A row of ``told`` holds wn, its sigma, zeta, its sigma, and the sigmas of both that noise does
    not explain. ``moves`` (2,) is how far wn (relative) and zeta may be wrong by a warning.
    """
    wn, wn_std, zeta, zeta_std, wn_beyond, zeta_beyond = np.array(told)[agree, :6].T
    wn, wn_std, wn_beyond = wn / by[agree], wn_std / by[agree], wn_beyond / by[agree]
    x = pooled(wn, wn_std, TAU_WN_SHARE * float(np.median(wn)), wn_beyond)
    rest = pooled(zeta, zeta_std, TAU_ZETA, zeta_beyond)
    return replace(x, least=float(moves[0]) * x.mean), replace(rest, least=float(moves[1]))


def _most_common(methods: Iterable[str | None]) -> str | None:
    """Return the method that answered the most manoeuvres, of several the first one."""
    return Counter(methods).most_common(1)[0][0]


def _common(values: set[str | None]) -> str | None:
    """Return the value that all have in common, None where they differ."""
    return next(iter(values)) if len(values) == 1 else None


def _warnings(used: Sequence[Answered]) -> Iterator[Reason]:
    """Yield the warnings that more than half of the manoeuvres used have."""
    said = [reason for each in used for reason in each.verdict.reasons]
    counts = Counter(reason.id for reason in said)
    for reason in said:
        count = counts.pop(reason.id, 0)
        if 2 * count > len(used):
            where = f"in {count} of {len(used)} manoeuvres: " if len(used) > 1 else ""
            yield replace(reason, text=where + reason.text)


def _agreement(x: Floats, std: Floats) -> tuple[Bools, float]:
    """Return which of wn or wn / V (n,) agree with the weighted median, and their share of weight.

    A value disagrees if it differs from the median by more than 10 %, and by more than three sigmas
    of the difference. All sigmas include the least scatter, as the same number for all: as a part
    of each value it would give less weight to larger values for that reason alone.
    """
    total = np.hypot(std, TAU_WN_SHARE * float(np.median(x)))
    weights = total**-2.0
    order = np.argsort(x)
    summed = np.cumsum(weights[order])
    middle = order[int(np.searchsorted(summed, 0.5 * summed[-1]))]
    apart = np.abs(x - x[middle])
    sigma = np.hypot(total, total[middle])
    agree = (apart <= DISAGREE_WN * x[middle]) | (apart <= DISAGREE_SIGMAS * sigma)
    return agree, float(weights[agree].sum() / weights.sum())


def _disagreement(
    apart: Sequence[Answered], wn: float, std: float, speed: float | None, count: int
) -> str:
    """Return in words which manoeuvres disagree with the others."""
    said = []
    for each in apart:
        roll, v = each.found.dutch_roll, each.found.airspeed_m_s
        at = "" if v is None or speed is None else f" at {v:.1f} m/s"
        assert roll is not None  # it may be used
        said.append(f"manoeuvre {each.found.n} has wn {roll.wn_rad_s:.3g} rad/s{at}")
    others = f"the other {count} have" if count > 1 else "the other one has"
    at = "" if speed is None else f" at {speed:.1f} m/s"
    them = "it is" if len(apart) == 1 else "they are"
    return f"{', '.join(said)}; {others} {wn:.3g} ± {std:.2g}{at}: {them} left out of the answer"


def _gain(gains: Floats, speeds: Floats) -> Value | None:
    """Return K / V from gains at airspeeds (n,); None where unknown.

    ``gains`` (n, 3) holds K, its sigma of noise, and the sigma that noise does not explain.
    """
    known = np.isfinite(gains).all(axis=1) & (gains[:, 1] > 0.0)
    if not known.any():
        return None
    x, std, beyond = (gains[known] / speeds[known, None]).T
    found = pooled(x, std, TAU_WN_SHARE * abs(float(np.median(x))), beyond)
    return Value(found.mean, found.std, found.noise)
