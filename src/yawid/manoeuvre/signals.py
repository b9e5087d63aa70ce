"""A manoeuvre's samples fitted: with the turn or without, with the aileron, with roll or without.

Roll has the poles of the yaw rate, whose residues it need not share, so it may be rounded, slow,
limited or late by a sample or two: its AR and its sigma say what that costs. Two samples changed
nothing; with four zeta was .006 off, with eight wn 1.8 % (RMS of 60 simulated aircraft in calm air
at 10 to 50 Hz). It is left out, with the reason in words, where it is missing or stays where it is.

An aileron that only holds the wings level is a part of the aircraft as flown. It is an input where
it moves by itself, that is, where rudder, yaw rate, roll and roll before do not explain it.
"""

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from yawid.blocks import SampleBlock
from yawid.config.run import BOTH
from yawid.manoeuvre.fit import WORTH_BIC, Fit, best_alone, first_of, fits_of
from yawid.manoeuvre.large import small_motion
from yawid.manoeuvre.responses import Record, inputs_and_rate
from yawid.results.excitation import LEAST_STROKE

MOST_STILL: Final = 0.95
"""The most samples, as a part, in which roll may stay where it was to the bit. With .91, from steps
of two standard deviations, the median error of wn was .15 % in calm air, without roll .61 %; it was
.18 % where roll was limited to half a standard deviation. On 60 simulated aircraft."""
MOST_REACTION: Final = 0.5
"""The most of an aileron's variance that the motion may explain. Chosen on 90 flights; its own part
must cover LEAST_STROKE in all, as a rudder's."""


class Fitted(NamedTuple):
    """The fits of a manoeuvre, their ``inputs``, and why roll is left out, "" where it is not."""

    fits: list[Fit]
    inputs: tuple[str, ...]
    roll_left_out: str


def fitted(
    samples: SampleBlock,
    inputs: tuple[str, ...] | None = None,
    *,
    measured: bool = False,
    turn_removed: bool = False,
) -> Fitted:
    """Return the fits of a manoeuvre's samples, with these ``inputs``, or with those they show.

    With the aileron as an input their poles are those of the bare airframe, else those of the
    aircraft as flown.
    """
    fault = roll_fault(samples)
    how = {"with_roll": not fault, "measured": measured, "turn_removed": turn_removed}
    may_have = aileron_moves(samples) if inputs is None else inputs == BOTH
    with_it = record_of(samples, BOTH, **how) if may_have else None
    without = None if inputs == BOTH else record_of(samples, ("rudder",), **how)
    both = [] if with_it is None else fits_of(with_it)
    q = both[0].blocks.q if both else None
    alone = [] if without is None else fits_of(without, q)
    best, with_aileron = (
        math.inf if (fit := best_alone(fits)) is None else fit.bic for fits in (alone, both)
    )
    has_both = inputs == BOTH or with_aileron < best - WORTH_BIC
    fits = both if has_both else alone
    return Fitted([*fits, *small_motion(fits)], BOTH if has_both else ("rudder",), fault)


def record_of(
    samples: SampleBlock,
    inputs: tuple[str, ...] = ("rudder",),
    *,
    with_roll: bool = True,
    measured: bool = False,
    turn_removed: bool = False,
) -> Record:
    """Return the record of a manoeuvre's samples; a sample that lacks one of its signals is a gap.

    The rudder is the first input, the aileron the second one, and roll the second output.
    """
    roll = [samples.roll] if with_roll else []
    how = {"measured": measured, "turn_removed": turn_removed}
    _, held, y = inputs_and_rate(samples, inputs, *roll, **how)
    return Record.of(samples.sample_time_s, held, y, *roll)


def is_turning(samples: SampleBlock, *, measured: bool = False) -> bool:
    """Return whether the yaw rate is fitted better without the turn that the bank makes.

    The BIC decides, over the samples that have both: first that of "2", which costs little, then
    the least of all structures. Where none of those that keep the turn comes near the "2" without
    it, the others without it need not be fitted.
    """
    y = np.where(np.isfinite(samples.turn_rate), samples.y, np.nan)
    same = replace(samples, y=y)
    kept, removed = (
        record_of(same, with_roll=False, measured=measured, turn_removed=each)
        for each in (False, True)
    )
    if (first := first_of(kept)) is None:
        return False
    q = first.blocks.q
    if (without := first_of(removed, q)) is None or without.bic > first.bic - WORTH_BIC:
        return False
    least = min(fit.bic for fit in fits_of(kept, q, first)) - WORTH_BIC
    return without.bic < least or min(fit.bic for fit in fits_of(removed, q, without)) < least


def roll_fault(samples: SampleBlock) -> str:
    """Return in words why roll is left out, "" where it is used."""
    roll = samples.roll[np.isfinite(samples.y)]
    if not np.isfinite(roll).all():
        return "roll is missing"
    is_still = len(roll) < 2 or np.mean(np.diff(roll) == 0.0) > MOST_STILL
    return "roll stays where it is" if is_still else ""


def aileron_moves(samples: SampleBlock) -> bool:
    """Return whether the aileron moves by itself, so that it may be an input."""
    before = np.concatenate([[np.nan], samples.roll[:-1]])
    causes = [samples.u[:, 0], samples.y, samples.roll, before, np.ones(len(before))]
    columns = np.column_stack(causes)
    known = np.isfinite(columns).all(axis=1) & np.isfinite(samples.aileron)
    aileron = samples.aileron[known]
    if not len(aileron) or float(np.ptp(aileron)) < LEAST_STROKE:
        return False
    own = aileron - columns[known] @ np.linalg.lstsq(columns[known], aileron, rcond=None)[0]
    is_own = float(own.var()) > (1.0 - MOST_REACTION) * float(aileron.var())
    return bool(is_own and float(np.ptp(own)) >= LEAST_STROKE)
