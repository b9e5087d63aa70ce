"""Reasons that the estimates themselves give, and the verdict on all methods together."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from yawid.blocks import EstimateBlock, Floats, Status
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank, SampleHistory
from yawid.estimation.methods import METHODS
from yawid.results.coherence import Coherence, coherence_at, coherence_reasons
from yawid.results.excitation import LEAST_STROKE, Movement, around, excitation
from yawid.results.hidden import UNSEEN, Cause, what_hides
from yawid.results.judge_rudder import stroke_reasons
from yawid.results.judge_samples import (
    UNCERTAIN_WN,
    UNCERTAIN_ZETA,
    damper_reasons,
    excitation_reasons,
    feedback_reasons,
    flight_reasons,
    input_reasons,
    narrower,
    rate_reasons,
    reaction_shares,
    rough_reasons,
)
from yawid.results.reasons import Reason, Verdict

LEAST_SIMULATION_PCT = 40.0
LEAST_HELD_BACK_PCT = 30.0
"""The least fits in percent of a free-running model, over all samples and over held-back ones. With
less it has learned something else; good flights have 73 to 95 %."""
IN_GUSTS_PCT, IN_GUSTS_WN = 20.0, 0.05
"""The least simulated fit, and the greatest relative sigma of wn, where the rudder clearly drives
the mode: in strong gusts, answers that are right to 5 % have fits of 20 to 40 %."""
WHITE_P, LEAST_COLOUR = 0.01, 0.1
"""Residuals are coloured where the test of whiteness fails and an autocorrelation is large enough
to matter: any long record fails the test alone."""
WORTH_A_WORD = 0.01
"""The part of wn, and the change of zeta, above which a shift is worth a warning."""
DISAGREE_SIGMAS = 3.0
DISAGREE_SHARE = 0.05
"""Two methods disagree if they differ by more than this many sigmas, and more than this part of the
value."""
MOVING_SHARE = 0.08
"""The part of itself by which an estimate may still move at the end, even beyond 3 sigma."""
CLEAR = 0.1
"""A squared coherence so far above chance is clear."""
REACTS = 0.7
"""Where yaw rate and roll explain a greater part of the rudder, they may be what moves it."""
ALIKE = 1.1
"""Methods whose wn differ by less than this factor agree on it."""
BETTER = 0.5
"""Another method replaces the first where its sigma of wn is below this part of the first one's, of
noise or in total: the part of sigma from other structures is much the same for both."""
SOUND = (Status.TRACKING, Status.HELD)
"""The statuses with which an estimator may answer."""


class Estimates(Protocol):
    """Estimates to be judged: those of a bank over a stream, or those of fits over a manoeuvre."""

    @property
    def config(self) -> RunConfig:
        """The configuration they were made with."""

    @property
    def sample_time_s(self) -> float:
        """The grid's Ts in s."""

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods; the first one is the preferred one."""

    @property
    def estimators(self) -> Mapping[str, Any]:
        """By method, an object with the state that :class:`yawid.RecursiveArmax` has."""

    @property
    def last(self) -> Mapping[str, EstimateBlock]:
        """By method, the newest rows with their covariance."""

    def history(self) -> SampleHistory:
        """Return the samples as the estimators saw them."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """The figures of one estimator that are judged; what is unknown is NaN.

    ``dutch_roll`` is (wn, wn_std, zeta, zeta_std) with sigmas of noise, ``total_std`` holds the
    total sigmas of wn and zeta. ``next_moves`` says how far the next richer structure moves wn and
    zeta, ``rate_moves`` how far a low rate does. ``autocorrelation`` is the residuals' largest.
    ``spr_margin`` is above 0 where ELS is sure to converge (1/C - 1/2 is positive real).
    ``early_response`` is the mean yaw rate over the first half period after a unit step of the
    rudder. ``simulation_pct`` is the part of the yaw rate that the model explains from the inputs
    alone, ``held_back_pct`` the same for samples that it had not seen. ``before`` holds wn and zeta
    of a third of the memory ago. ``tries`` is how many fits of these samples were made to be
    judged, this one included: see :func:`yawid.results.judge_samples.narrower`.
    """

    status: int
    updates: int
    dutch_roll: Floats
    total_std: Floats
    next_moves: Floats
    rate_moves: Floats
    whiteness_p: float
    autocorrelation: float
    spr_margin: float
    early_response: float
    simulation_pct: float
    held_back_pct: float
    before: Floats
    tries: int = 1

    def knows_better(self, other: "Evidence") -> bool:
        """Return whether a sigma of wn, of noise or total, is less than half the other's."""
        noise = float(self.dutch_roll[1]) < BETTER * float(other.dutch_roll[1])
        return noise or float(self.total_std[0]) < BETTER * float(other.total_std[0])

    def matters(self, moves: Floats) -> bool:
        """Return whether something that moves wn and zeta so far (2,) is worth a warning.

        It is where one of them moves by more than its total sigma, or by more than 1 % (zeta by
        0.01), and where it is unknown how far they move.
        """
        least = np.minimum(self.total_std, WORTH_A_WORD * np.array([self.dutch_roll[0], 1.0]))
        return bool(np.any(moves > least) or np.isnan(moves).any())

    def moved(self, reason: Reason, moves: Floats, what: str) -> Reason:
        """Return the warning, whose text now ends with ``what`` and how far wn and zeta move."""
        share, zeta = (np.nan_to_num(moves) / (self.dutch_roll[0], 1.0)).tolist()
        return replace(reason, text=f"{reason.text}{what} {self.said(moves)}", moves=(share, zeta))

    def said(self, moves: Floats) -> str:
        """Return in words how far something moves wn and zeta (2,)."""
        if np.isnan(moves).any():
            return "wn and zeta by an unknown amount"
        share = 100.0 * float(moves[0] / self.dutch_roll[0])
        return f"wn by about {share:.1f} % and zeta by {moves[1]:.3f}"


def estimate_reasons(
    method: str,
    evidence: Evidence,
    *,
    is_driven: bool = False,
    hidden: Cause | None = None,
    only_sign: str = "",
) -> Iterator[Reason]:
    """Judge one estimate by itself.

    ``is_driven`` says that rudder and yaw rate are clearly coherent at the mode found, that the
    rudder does not merely react, and that the methods agree on wn. Then a low fit may be due to
    gusts although wn is right. ``hidden`` is what hides the rudder's effect, None where unknown.
    ``only_sign`` is the --rudder-sign given where nothing else can be wrong, as in a record.
    """
    if evidence.status == Status.DIVERGED:
        yield Reason(
            "diverged",
            f"{method.upper()} diverged: its predictions are worse than the mean of the "
            "measurements",
        )
        return
    if evidence.updates == 0:
        yield Reason(
            "not_excited", "rudder and yaw rate never moved enough for the estimation to begin"
        )
        return
    against = [*_convergence(evidence), *_fit_reasons(evidence, is_driven, hidden or Cause(UNSEEN))]
    yield from against
    yield from _residual_reasons(evidence)
    if evidence.early_response < 0.0 and not any(reason.exit_code for reason in against):
        yield Reason(
            "wrong_sign",
            "positive rudder turns the nose left: "
            + (
                f"--rudder-sign {only_sign} is wrong for this record"
                if only_sign
                else "the servo is reversed or --rudder-sign is wrong"
            ),
        )


def _convergence(evidence: Evidence) -> Iterator[Reason]:
    """Judge whether there is a Dutch roll, whether it is known well enough, and no longer moves."""
    share = narrower(evidence.tries)
    wn_limit, zeta_limit = share * UNCERTAIN_WN, share * UNCERTAIN_ZETA
    wn, _, zeta, _ = evidence.dutch_roll.tolist()
    wn_std, zeta_std = evidence.total_std.tolist()
    if not math.isfinite(wn):
        yield Reason(
            "not_converged", "the model has no oscillatory mode, so there is no Dutch roll"
        )
    elif not (wn_std < wn_limit * wn and zeta_std < zeta_limit):
        text = (
            f"the Dutch roll is not known well enough: wn {wn:.3g} ± {wn_std:.2g} rad/s, "
            f"zeta {zeta:.3g} ± {zeta_std:.2g}"
        )
        moves = evidence.next_moves
        if moves[0] > wn_limit * wn or moves[1] > zeta_limit:
            text += (
                f"; a model with more parameters moves {evidence.said(moves)}, and the data held "
                "back do not show that it is the worse one"
            )
        yield Reason("not_converged", text)
    else:
        yield from _still_moving(evidence)
        yield from rough_reasons(wn, wn_std)


def _fit_reasons(evidence: Evidence, is_driven: bool, hidden: Cause) -> Iterator[Reason]:
    """Judge how much of the yaw rate the model explains; an unknown fit gives no reason."""
    simulated, held_back = evidence.simulation_pct, evidence.held_back_pct
    wn, wn_std = float(evidence.dutch_roll[0]), float(evidence.total_std[0])
    if is_driven and simulated >= IN_GUSTS_PCT and wn_std < IN_GUSTS_WN * wn:
        return
    low, least = [], []
    if simulated < LEAST_SIMULATION_PCT:
        low.append(f"{max(simulated, 0.0):.0f} % of the yaw rate (free run)")
        least.append(f"{LEAST_SIMULATION_PCT:.0f}")
    if held_back < LEAST_HELD_BACK_PCT:
        low.append(f"{max(held_back, 0.0):.0f} % of the last third, which was held back")
        least.append(f"{LEAST_HELD_BACK_PCT:.0f}")
    if low:
        if simulated >= LEAST_SIMULATION_PCT:
            hidden = Cause("the rudder rested there, or the aircraft was flown differently")
        yield Reason(
            "poor_fit",
            f"the inputs explain only {' and '.join(low)}: at least {' and '.join(least)} % "
            f"{'is' if len(least) == 1 else 'are'} needed; {hidden.text}",
            hidden.remedy,
        )


def _residual_reasons(evidence: Evidence) -> Iterator[Reason]:
    """Judge the residuals: they matter if they are coloured and a richer model moves the answer."""
    is_coloured = evidence.whiteness_p < WHITE_P and evidence.autocorrelation > LEAST_COLOUR
    if is_coloured and evidence.matters(evidence.next_moves):
        found = Reason(
            "coloured_residuals",
            f"the residuals are not white (autocorrelation {evidence.autocorrelation:.2f}): the "
            "model does not explain everything",
        )
        yield evidence.moved(found, evidence.next_moves, "; one with more parameters moves")


def _by_effect(reasons: Iterator[Reason], evidence: Evidence) -> Iterator[Reason]:
    """Yield the fatal reasons, and the warnings that matter with how far they move wn and zeta."""
    for reason in reasons:
        is_rate = reason.id == "rate_low"
        moves = evidence.rate_moves if is_rate else evidence.next_moves
        what = "; a higher rate moves" if is_rate else "; a model with more parameters moves"
        if reason.exit_code:
            yield reason
        elif evidence.matters(moves):
            yield evidence.moved(reason, moves, what)


def _still_moving(evidence: Evidence) -> Iterator[Reason]:
    """Judge whether the estimate has settled: while it moves, its sigma says nothing."""
    for name, i in (("wn", 0), ("zeta", 2)):
        now, sigma = float(evidence.dutch_roll[i]), float(evidence.dutch_roll[i + 1])
        before = float(evidence.before[i // 2])
        moved = abs(now - before)
        if moved > DISAGREE_SIGMAS * sigma and moved > MOVING_SHARE * abs(now):
            yield Reason(
                "not_converged",
                f"{name} still moves: it was {before:.3g} a third of the memory ago and is now "
                f"{now:.3g} ± {evidence.total_std[i // 2]:.2g}; if the aircraft was flown "
                "differently there, as in a turn, choose a stretch by --from and --to",
            )
            return


def agreement_reasons(
    evidence: Mapping[str, Evidence], refused: Mapping[str, list[Reason]], answers: str
) -> Iterator[Reason]:
    """Compare the Dutch roll of the answer with that of each method that checks it.

    ``refused`` holds the reasons of the methods that are unusable. Where 1/C - 1/2 is not positive
    real, ELS need not converge to the truth: then a difference from RML only concerns ELS, and it
    checks nothing. Neither does an ELS that is unusable.
    """
    for other in METHODS[answers].checked_by:
        if other in evidence:
            yield from _checked(evidence, refused, answers, other)


def _checked(
    evidence: Mapping[str, Evidence], refused: Mapping[str, list[Reason]], answers: str, other: str
) -> Iterator[Reason]:
    """Compare the Dutch roll of the answer with that of one ``other`` method."""
    is_doubtful = other in refused or not evidence[other].spr_margin > 0.0
    if METHODS[other].needs_spr and is_doubtful:
        return
    if other in refused:
        if (
            answers in refused
            and not np.isfinite([evidence[each].dutch_roll[0] for each in (answers, other)]).any()
        ):
            return  # neither was estimated: there is nothing to compare
        why = next(reason for reason in refused[other] if reason.exit_code)
        text = f"{other.upper()}, which checks the answer, cannot be used ({why})"
        yield Reason("els_rml_disagree", text)
        return
    first, second = (each for each in METHODS if each in (answers, other))
    one, two = evidence[first].dutch_roll, evidence[second].dutch_roll
    for name, i in (("wn", 0), ("zeta", 2)):
        difference = abs(float(one[i] - two[i]))
        sigma = math.hypot(float(one[i + 1]), float(two[i + 1]))
        own, total = evidence[answers].dutch_roll[i], float(evidence[answers].total_std[i // 2])
        if difference > max(DISAGREE_SIGMAS * sigma, DISAGREE_SHARE * abs(own), total):
            yield Reason(
                "els_rml_disagree",
                f"{name} is {one[i]:.3g} by {first.upper()} and {two[i]:.3g} by {second.upper()}, "
                f"with a total sigma of {total:.2g}: they differ by "
                f"{100.0 * difference / abs(own):.0f} %, so the noise model matters",
            )
            return


@dataclass(frozen=True, slots=True)
class JudgedMethods:
    """How the rudder moved, and by method the coherence at its mode and the reasons against it.

    ``reacts`` is the part of the rudder that yaw rate and roll explain.
    """

    moved: Movement
    reacts: float
    coherence: Mapping[str, Coherence | None]
    reasons: Mapping[str, list[Reason]]

    @property
    def refused(self) -> dict[str, list[Reason]]:
        """The methods whose estimates are unusable, with their reasons."""
        return {
            method: reasons
            for method, reasons in self.reasons.items()
            if any(reason.exit_code for reason in reasons)
        }


def judge_methods(
    bank: Estimates, evidence: Mapping[str, Evidence], rates_hz: tuple[float, float]
) -> JudgedMethods:
    """Judge each method by itself; ``rates_hz`` are the rates of yaw and rudder messages."""
    history, travel_unit = bank.history(), bank.config.half_travel
    rudder = np.where(np.isfinite(history.y), history.u[:, 0], np.nan)
    moved = excitation(rudder, history.aileron, history.mode, travel_unit, bank.sample_time_s)
    excited = np.where(around(moved.excited, bank.sample_time_s), rudder, np.nan)
    coherence, reasons = {}, {}
    found_wn = np.array([evidence[method].dutch_roll[0] for method in bank.methods])
    alike = bool(found_wn.max() < ALIKE * found_wn.min())
    reacts = reaction_shares(history)[0]
    excites = reacts < REACTS and alike
    low = any(each.simulation_pct < LEAST_SIMULATION_PCT for each in evidence.values())
    is_copy = moved.most_own < LEAST_STROKE
    hidden = what_hides(history, bank.config, bank.sample_time_s, is_copy=is_copy) if low else None
    only_sign = bank.config.rudder_sign if bank.config.rudder_unit is not None else ""
    for method in bank.methods:
        mode, tries = evidence[method].dutch_roll, evidence[method].tries
        wn, ts_s = float(mode[0]), bank.sample_time_s
        found = coherence_at(excited, history.y, wn, ts_s, tries) if wn > 0.0 else None
        coherence[method] = found
        is_driven = excites and found is not None and found.squared > found.limit + CLEAR
        reasons[method] = [
            *_by_effect(rate_reasons(*rates_hz, 1.0 / bank.sample_time_s, mode), evidence[method]),
            *estimate_reasons(
                method, evidence[method], is_driven=is_driven, hidden=hidden, only_sign=only_sign
            ),
            *coherence_reasons(wn, found),
        ]
    return JudgedMethods(moved, reacts, coherence, reasons)


def bank_verdict(
    bank: Estimates,
    evidence: Mapping[str, Evidence],
    rates_hz: tuple[float, float],
    others: list[Reason],
    *,
    first_answers: bool = False,
) -> Verdict:
    """Return the verdict on samples and estimates, with the ``others``, the log's own reasons.

    The first method answers unless it is unusable and another is not, or another one's sigma of wn
    is less than half as large; with ``first_answers`` the others only check it.
    """
    config, history = bank.config, bank.history()
    grounded = bank.grounded / max(bank.taken, 1) if isinstance(bank, Bank) else 0.0
    judged = judge_methods(bank, evidence, rates_hz)
    sound = [method for method in bank.methods if method not in judged.refused]
    answers = bank.methods[0] if first_answers or not sound else sound[0]
    for method in [] if first_answers else sound[1:]:
        if evidence[method].knows_better(evidence[answers]):
            answers = method
    reasons = [
        *others,
        *excitation_reasons(judged.moved, config.travel_said, grounded),
        *stroke_reasons(judged.moved, config),
        *input_reasons(config.inputs, history.u, config.stop),
        *flight_reasons(history, config.turn),
        *_by_effect(feedback_reasons(config.inputs, history), evidence[answers]),
        *damper_reasons(history, judged.reacts, evidence[answers].early_response),
        *judged.reasons[answers],
    ]
    if not (first_answers and answers in judged.refused):
        reasons += agreement_reasons(evidence, judged.refused, answers)
    return Verdict.of(reasons, answers)
