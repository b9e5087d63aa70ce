"""Whether a manoeuvre's answer may be used, and if not, why and what would help.

What is asked is one thing: did this rudder make this yaw motion, and is its mode known well enough?

    driven   2 log(L / L_0) of the model against free decay of the same poles, and against the same
             rudder moved in time: by 0.2 to 1.5 periods, and round the record by more than 3
    known    the total sigma of wn and zeta, at least 2.5 periods, the simulated fit
    flown    the rudder's own part moved both ways, at one airspeed, not by the yaw rate itself

Free decay alone has the right wn and zeta whatever the rudder did, so that without the first row
another flight's rudder gives an answer that looks right. Where no other flights are named, a limit
was chosen on flights of JSBSim drawn with the seeds 8101 and 7101 and on their misled copies:
another flight's rudder, reversed, 0.4 s late. Tables report other ones.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from yawid.answers.reasons import Reason
from yawid.blocks import AIRSPEED_SHARE, Floats, SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.fit import fit_percent
from yawid.manoeuvre.answer import Answer
from yawid.manoeuvre.conditions import SIGMAS
from yawid.manoeuvre.feedback import rate_feedback
from yawid.manoeuvre.find import OTHER_SPEED, PERIODS, speed_factor
from yawid.manoeuvre.fit import WORTH_BIC, Fit, best_alone
from yawid.manoeuvre.likelihood import free_decay, freed, shifted, simulated
from yawid.manoeuvre.signals import Fitted
from yawid.results.excitation import LEAST_STROKE, own_part
from yawid.results.judge_samples import COLLINEAR, closeness, message_rate_reasons

UNCERTAIN_WN: Final = 0.1
"""The total sigma of wn, as a part of it, from which nothing follows from it. With a limit of 40
for the ratios it let no answer of 543 misled manoeuvres pass, and a take-off roll was refused."""
UNCERTAIN_ZETA, LEAST_UNCERTAIN_ZETA, ZETA_SHARE = 0.1, 0.04, 0.4
"""The total sigma of zeta from which nothing follows from it; of a light mode it may be that share
of zeta. With 0.1 alone a T38 in severity 3 had .14 ± .07 for .36; with a share of 0.25 seven right
flights of the seed 8201 in gusts had no answer."""
ROUGH_WN: Final = 0.05
"""The total sigma of wn, as a part of it, from which it is a rough value: a warning, of 31
manoeuvres in 288. Carried over from earlier judging."""
LEAST_DRIVEN: Final = 40.0
"""The least ratio against free decay, and against the rudder moved in time. At 20, of a rudder that
is 0.4 s late one copy in 88 had a usable answer, 10 % off. Of misled copies that pass the test of
shifts by chance none had more than 25 against free decay."""
SHIFTS, NEAR_PERIODS, FAR_PERIODS, FAR = 12, (0.2, 1.5), 3.0, 99
"""How many shifts there are, and of how many periods: a zero and a lag imitate less than 0.2."""
LEAST_PCT: Final = 40.0
"""The least simulated fit in percent. Of a T38 in heavy gusts it was 30, and zeta 0.2 too low."""
LEAST_SWINGS: Final = 2
"""The least strokes of the rudder, there and back. Of one way alone its gain is the bias."""
LEAST_RATIO, LOW_RATIO = 4.0, 10.0
"""Samples in a period of the mode below which there is no answer, and below which zeta is
uncertain: a step of the command is known to a sample only."""
SATURATED: Final = 0.05
"""The part of the time at the stops from which there is a warning: beyond them the rudder's effect
is unknown. Carried over from earlier judging; none of 288 drawn and recorded manoeuvres has it."""
SOME_FED_BACK, MOST_FED_BACK = 0.5, 1.0
"""The part of the rudder near the mode that feeds back the yaw rate, for a warning and for none. On
flights of an ArduPlane answers were right up to 0.9, and 9 to 12 % too high from 1.3 on."""
CLEAR_PAIR: Final = 25.0
"""The chi-square of the pair's two residues from the rudder. Without it 34 of 500 simulated rolls
on a runway, a lag and bumps, had a line of the bumps as a usable Dutch roll."""


@dataclass(frozen=True, slots=True)
class ManoeuvreSetting:
    """What all manoeuvres of a run have in common.

    ``rates_hz`` holds the rates of yaw and rudder messages, ``modes_of`` autopilot and vehicle
    type.
    """

    config: RunConfig
    sample_time_s: float
    rates_hz: tuple[float, float]
    modes_of: tuple[int, int]


@dataclass(frozen=True)
class Evidence:
    """What a manoeuvre is judged by; ``answer`` is None where nothing was found."""

    samples: SampleBlock
    setting: ManoeuvreSetting
    turn_removed: bool
    seen: Fitted
    answer: Answer | None

    @cached_property
    def fit(self) -> Fit | None:
        """The fit of yaw rate alone with the least BIC."""
        return best_alone(self.seen.fits)

    @cached_property
    def explained_pct(self) -> float:
        """How much of the yaw rate it explains when it is simulated, in percent."""
        return math.nan if self.fit is None else fit_percent(*simulated(self.fit))

    @property
    def rudder(self) -> Floats:
        """The rudder (n,) in half travels, NaN where a sample is not used."""
        samples = self.samples
        used = np.isfinite(samples.y) & (samples.held == 0)
        return np.where(used, samples.u[:, 0] / self.setting.config.half_travel, np.nan)


def reasons(of: Evidence) -> Iterator[Reason]:
    """Yield what speaks against the answer, and what is worth a warning."""
    yield from _flown(of)
    yield from _inputs(of)
    yield from _rates(of)
    if of.answer is None or of.fit is None:
        yield Reason(
            "not_converged",
            "no oscillation of the yaw rate was found on which the structures of the fit agree",
        )
        return
    yield from _known(of.answer, of.fit, of.explained_pct)
    yield from _driven(of.fit)
    yield from _fed_back(of, of.answer.wn_rad_s.value)
    if (gain := of.answer.large_gain) > WORTH_BIC:
        yield Reason(
            "not_proportional",
            "large yaw rates are not in proportion to the rudder (a yaw damper at its limits, or "
            f"a large sideslip; BIC {gain:.0f} better with them apart): the answer is that of "
            "small motion",
        )
    rudder = of.answer.eq_23
    if (effect := of_the_pair(of.fit)) < CLEAR_PAIR:
        yield Reason(
            "mode_not_driven",
            "whether the rudder moves the oscillation found is not known: its residues from the "
            f"rudder have a chi-square of {effect:.0f}, at least {CLEAR_PAIR:g} is needed",
        )
    elif rudder.yaw_acceleration.value < -SIGMAS * rudder.yaw_acceleration.std:
        yield Reason(
            "wrong_sign",
            "positive rudder turns the nose left: the servo is reversed, or --rudder-sign is wrong",
            None if of.setting.config.rudder_unit is None else "Give the other --rudder-sign.",
        )


def of_the_pair(fit: Fit) -> float:
    """Return the chi-square of the pair's residues from the rudder, two numbers."""
    at = len(fit.theta) + 2 * fit.pair
    r, C = fit.elements[2 * fit.pair :][:2], fit.covariance[at : at + 2, at : at + 2]
    return float(r @ np.linalg.solve(C, r))


def _flown(of: Evidence) -> Iterator[Reason]:
    """Judge how it was flown: the rudder's own movement, and the airspeed."""
    samples, rudder, config = of.samples, of.rudder, of.setting.config
    aileron = samples.aileron[np.isfinite(samples.aileron)]
    own = rudder
    if len(aileron) and float(np.ptp(aileron)) > 0.0:  # an aileron at rest explains nothing
        own = own_part(rudder, samples.aileron, samples.mode, samples.sample_time_s)
    moves = swings(own[np.isfinite(own)], LEAST_STROKE)
    if moves < LEAST_SWINGS:
        how = "in one direction only" if moves else f"less than {100 * LEAST_STROKE:.0f} %"
        yield Reason(
            "not_excited",
            f"the rudder by itself moved {how}: it must move by {100 * LEAST_STROKE:.0f} % of "
            f"{config.travel_said} or more, there and back",
        )
    known = rudder[np.isfinite(rudder)]
    stroke = float(known.max(initial=0.0) - known.min(initial=0.0))
    stroke_deg = math.degrees(stroke * config.half_travel)
    if stroke_deg < config.stroke_floor_deg:
        yield Reason(
            "not_excited",
            f"the rudder moved by {stroke_deg:.2g} deg: at least {config.stroke_floor_deg:g} deg "
            "is needed where its travel is unknown (give --rudder-max-deg)",
        )
    factor = speed_factor(samples.airspeed[np.isfinite(samples.airspeed)], samples.sample_time_s)
    if factor > OTHER_SPEED:
        yield Reason(
            "not_converged",
            f"the first and the last airspeed differ by a factor of {factor:.2f}, and wn varies "
            f"with it: at most {OTHER_SPEED:g} is allowed; choose a stretch by --from and --to",
        )
    speed = samples.airspeed[np.isfinite(rudder) & np.isfinite(samples.airspeed)]
    few = np.ones(1) if len(speed) < 2 else speed
    low, middle, high = np.percentile(few, [5.0, 50.0, 95.0]).tolist()
    if high - low > 2.0 * AIRSPEED_SHARE * abs(middle):
        yield Reason(
            "airspeed_changed",
            f"the airspeed ranged from {low:.1f} to {high:.1f} m/s: wn and the gain vary with it",
        )


def _inputs(of: Evidence) -> Iterator[Reason]:
    """Judge the rudder at its stops, and an aileron that is an input and moves with it."""
    config = of.setting.config
    rudder = of.rudder[np.isfinite(of.rudder)] * config.half_travel
    stops = float(np.mean(np.abs(rudder) >= 0.99 * config.stop)) if len(rudder) else 0.0
    if stops > SATURATED:
        text = f"the rudder was at its stops for {100 * stops:.0f} % of the time"
        yield Reason("saturated", text)
    if of.fit is not None and len(of.fit.blocks.record.u.T) > 1:
        close = closeness(of.rudder, of.samples.aileron)
        if close > COLLINEAR:
            yield Reason(
                "collinear_inputs",
                f"rudder and aileron move together ({100 * close:.1f} % in common, at most "
                f"{100 * COLLINEAR:.1f} % are allowed): their effects cannot be separated",
            )


def _rates(of: Evidence) -> Iterator[Reason]:
    """Judge the message rates, by themselves and against the mode."""
    yield from message_rate_reasons(*of.setting.rates_hz)
    slowest, grid_hz = min(of.setting.rates_hz), 1.0 / of.setting.sample_time_s
    if of.answer is None or not of.answer.wn_rad_s.std < UNCERTAIN_WN * of.answer.wn_rad_s.value:
        return
    mode_hz, have_hz = of.answer.wn_rad_s.value / (2.0 * math.pi), min(slowest, grid_hz)
    if have_hz < LEAST_RATIO * mode_hz:
        yield Reason(
            "rate_too_low",
            f"the rate is {have_hz:.3g} Hz: {LEAST_RATIO * mode_hz:.3g} Hz are needed, "
            f"{LEAST_RATIO:g} samples in a period of the mode found",
        )
    elif have_hz < LOW_RATIO * mode_hz:
        better = f"; the log allows --rate {slowest:.3g}" if slowest > 1.05 * have_hz else ""
        yield Reason(
            "rate_low",
            f"the rate of {have_hz:.3g} Hz gives {have_hz / mode_hz:.1f} samples in a period of "
            f"the mode: {LOW_RATIO:g} are better{better}",
        )


def _known(answer: Answer, fit: Fit, explained_pct: float) -> Iterator[Reason]:
    """Judge how well the mode is known, and how much of the yaw rate its model explains."""
    (wn, wn_std), (zeta, zeta_std) = answer.wn_rad_s, answer.zeta
    said = f"wn {wn:.3g} ± {wn_std:.2g} rad/s, zeta {zeta:.3g} ± {zeta_std:.2g}"
    most = min(UNCERTAIN_ZETA, max(LEAST_UNCERTAIN_ZETA, ZETA_SHARE * zeta))
    if not (wn_std < UNCERTAIN_WN * wn and zeta_std < most):
        yield Reason(
            "not_converged",
            f"the Dutch roll is not known well enough: {said}; sigma must be below "
            f"{100 * UNCERTAIN_WN:g} % of wn, and {most:.2g} of zeta",
        )
    else:
        yield from rough_reasons(wn, wn_std)
    seconds = fit.blocks.record.seconds
    if (periods := seconds * wn / (2.0 * math.pi)) < PERIODS:
        yield Reason(
            "not_converged",
            f"the {seconds:.1f} s hold only {periods:.1f} periods of the Dutch roll found: at "
            f"least {PERIODS:g} are needed",
            "Choose a longer stretch, or fly longer manoeuvres.",
        )
    if explained_pct < LEAST_PCT:
        yield Reason(
            "poor_fit",
            f"the rudder explains only {max(explained_pct, 0.0):.0f} % of the yaw rate "
            f"(simulated): at least {LEAST_PCT:g} % are needed",
        )


def rough_reasons(wn_rad_s: float, wn_std: float) -> Iterator[Reason]:
    """Judge whether the total sigma of wn allows more than a rough value."""
    if wn_std > ROUGH_WN * wn_rad_s:
        yield Reason(
            "poorly_known",
            f"wn is only known to {100 * wn_std / wn_rad_s:.0f} % ({wn_rad_s:.3g} ± {wn_std:.2g} "
            f"rad/s, one sigma): usable up to {100 * UNCERTAIN_WN:g} %, but a rough value above "
            f"{100 * ROUGH_WN:g} %",
        )


def _driven(fit: Fit) -> Iterator[Reason]:
    """Judge whether this rudder made the motion, and not free decay or another rudder."""
    record = fit.blocks.record
    rows, period = len(record.u), 2.0 * math.pi / math.exp(fit.log_pair[0]) / record.sample_time_s
    sizes = np.unique(np.round(np.geomspace(*NEAR_PERIODS, SHIFTS) * period).astype(int))
    moved = np.concatenate([-sizes[::-1], sizes])
    pairs = list(zip((2.0 * shifted(fit, moved)).tolist(), moved.tolist(), strict=True))
    near, late = min([*pairs, *((2.0 * freed(fit, late), late) for _, late in sorted(pairs)[:2])])
    apart = math.ceil(FAR_PERIODS * period)
    others = np.unique(np.linspace(apart, rows - apart, FAR).astype(int))
    if (free := 2.0 * free_decay(fit)) < LEAST_DRIVEN:
        yield Reason(
            "mode_not_driven",
            "the rudder explains the yaw rate hardly better than free decay alone: likelihood "
            f"ratio {max(free, 0.0):.0f}, at least {LEAST_DRIVEN:g} needed",
        )
    elif near < LEAST_DRIVEN:
        when = "later" if late > 0 else "earlier"
        yield Reason(
            "mode_not_driven",
            f"the same rudder {abs(late * record.sample_time_s):.2g} s {when} explains the yaw "
            f"rate nearly as well: likelihood ratio {max(near, 0.0):.0f}, at least "
            f"{LEAST_DRIVEN:g} needed",
            "Check the rudder's channel (--rudder) and that its times are those of the yaw rate.",
        )
    elif rows > 2 * apart and shifted(fit, others).min() < 0.0:
        yield Reason(
            "mode_not_driven",
            "the rudder of another part of the manoeuvre explains the yaw rate as well: the "
            "movements are too few or too alike",
        )


def _fed_back(of: Evidence, wn_rad_s: float) -> Iterator[Reason]:
    """Judge how much of the rudder near the mode feeds back the yaw rate."""
    samples, config = of.samples, of.setting.config
    rudder = of.rudder * config.half_travel
    y = samples.y - samples.turn_rate if of.turn_removed else samples.y
    y = np.where(np.isfinite(rudder), y, np.nan)
    found = rate_feedback(rudder, y, samples.aileron, wn_rad_s, samples.sample_time_s)
    if found is None or found.share <= SOME_FED_BACK:
        return
    said = (
        f"the rudder feeds back the yaw rate, as a yaw damper does (gain {found.gain:.2g} per "
        f"rad/s): near the mode that part is {found.share:.2f} times the whole rudder"
    )
    if found.share > MOST_FED_BACK:
        yield Reason(
            "mode_not_driven",
            f"{said}, and at most {MOST_FED_BACK:g} times is allowed: wn may be 12 % off",
            "Switch the yaw damper off for the manoeuvre (ArduPlane: YAW2SRV_DAMP = 0).",
        )
    else:
        yield Reason("closed_loop", f"{said}; beyond {MOST_FED_BACK:g} times it biases the answer")


def swings(x: Floats, least: float) -> int:
    """Return how many moves by at least ``least`` x (n,) made, in alternating directions."""
    count, low, high = 0, math.inf, -math.inf
    up = None
    for value in x.tolist():
        low, high = min(low, value), max(high, value)
        if up is not True and value - low >= least:
            up, high, count = True, value, count + 1
        elif up is not False and high - value >= least:
            up, low, count = False, value, count + 1
    return count
