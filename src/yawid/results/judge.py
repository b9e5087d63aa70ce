"""The verdict of a bank of estimators: samples, each method by itself, and which one answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from yawid.estimation.bank import Bank
from yawid.results.coherence import Coherence, coherence_at
from yawid.results.excitation import Excitation, around, excitation
from yawid.results.judge_estimate import (
    Evidence,
    agreement_reasons,
    coherence_reasons,
    estimate_reasons,
)
from yawid.results.judge_samples import (
    damper_reasons,
    excitation_reasons,
    feedback_reasons,
    flight_reasons,
    input_reasons,
    rate_reasons,
    reaction_shares,
)
from yawid.results.reasons import Reason, Verdict

CLEAR = 0.1
"""A squared coherence so far above chance is clear."""
REACTS = 0.7
"""A rudder of which yaw rate and roll explain more may be moved by what it is said to move."""
ALIKE = 1.1
"""Methods whose wn differ by less than this factor agree on it."""
BETTER = 0.5
"""Another method answers in place of the first where its sigma of wn is below this part of it."""


@dataclass(frozen=True, slots=True)
class Judged:
    """How the rudder moved, and by method the coherence at its mode and what speaks against it.

    ``reacts`` is the part of the rudder that yaw rate and roll explain.
    """

    moved: Excitation
    reacts: float
    coherence: Mapping[str, Coherence | None]
    reasons: Mapping[str, list[Reason]]

    @property
    def refused(self) -> dict[str, list[Reason]]:
        """The methods whose estimate may not be used, with their reasons."""
        return {
            method: reasons
            for method, reasons in self.reasons.items()
            if any(reason.kind.exit_code for reason in reasons)
        }


def judge_methods(
    bank: Bank,
    evidence: Mapping[str, Evidence],
    rates_hz: tuple[float, float],
    travel_unit: float,
) -> Judged:
    """Judge each method by itself.

    ``rates_hz`` of yaw and rudder messages; ``travel_unit`` is half the travel in the unit of u.
    """
    history = bank.history()
    rudder = np.where(np.isfinite(history.y), history.u[:, 0], np.nan)
    moved = excitation(rudder, history.aileron, history.mode, travel_unit, bank.sample_time_s)
    excited = np.where(around(moved.excited, bank.sample_time_s), rudder, np.nan)
    coherence, reasons = {}, {}
    found_wn = np.array([evidence[method].dutch_roll[0] for method in bank.methods])
    alike = bool(found_wn.max() < ALIKE * found_wn.min())
    reacts = reaction_shares(history)[0]
    excites = reacts < REACTS and alike
    for method in bank.methods:
        mode = evidence[method].dutch_roll
        wn = float(mode[0])
        found = coherence_at(excited, history.y, wn, bank.sample_time_s) if wn > 0.0 else None
        coherence[method] = found
        is_driven = excites and found is not None and found.squared > found.limit + CLEAR
        reasons[method] = [
            *rate_reasons(*rates_hz, 1.0 / bank.sample_time_s, mode),
            *estimate_reasons(method, evidence[method], is_driven=is_driven),
            *coherence_reasons(wn, found),
        ]
    return Judged(moved, reacts, coherence, reasons)


def bank_verdict(
    bank: Bank,
    evidence: Mapping[str, Evidence],
    rates_hz: tuple[float, float],
    travel_unit: float,
    others: list[Reason],
) -> Verdict:
    """Return the verdict of samples and estimates, and of the ``others`` that the log gives.

    The first method answers, unless it may not be used and another may, or another knows wn twice
    as well.
    """
    config, history = bank.config, bank.history()
    judged = judge_methods(bank, evidence, rates_hz, travel_unit)
    sound = [method for method in bank.methods if method not in judged.refused]
    answers = sound[0] if sound else config.method
    for method in sound[1:]:
        if evidence[method].dutch_roll[1] < BETTER * evidence[answers].dutch_roll[1]:
            answers = method
    reasons = [
        *others,
        *excitation_reasons(judged.moved),
        *input_reasons(config.inputs, history.u, travel_unit),
        *flight_reasons(history, config.turn),
        *feedback_reasons(config.inputs, history),
        *damper_reasons(judged.reacts, evidence[answers].early_response),
        *judged.reasons[answers],
        *agreement_reasons(evidence, judged.refused),
    ]
    return Verdict.of(reasons, answers)
