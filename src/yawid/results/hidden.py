"""The causes that hide a rudder's effect and can be seen in the samples themselves.

A low fit has many causes. One that is seen is named, and only what is not seen is said with "may".
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from yawid.blocks import Bools, Floats, shifted
from yawid.config.run import RunConfig
from yawid.estimation.bank import SampleHistory
from yawid.results.excitation import ROWS_PER_LAG
from yawid.results.judge_samples import response_lags, variance_left

MOST = 6000
"""The greatest number of samples in which causes are looked for."""
LAGS = 3
"""The lags of yaw rate and rudder in the regressions that are compared here."""
LATEST_S, LEAST_LATE_S = 1.0, 0.15
"""The largest time in s by which a clock may be off, and the least that is said."""
CLOCK_SHARE, CLOCK_LIKELIHOOD = 0.95, 20.0
"""Where clocks differ, a rudder shifted in time leaves at most this part of the squared residuals,
and the logarithm of the likelihood ratio, times two, is larger than this."""
STEPS_DEG = (2.0, 1.0, 0.5, 0.25, 0.2, 0.1)
"""Roundings of a rudder in deg that are looked for, the coarsest first."""
COARSE, LEVELS, STANDING = 0.05, 5, 0.3
"""A rounding is coarse from this part of the rudder's range on. It shows where the rudder stands
still on so many levels, for this part of the samples at least: a doublet has three levels."""
TURN_SHARE, ROUNDING = 0.1, 1e-12
"""The part of the yaw rate that the rudder must explain in addition without the turn; a variance
that is only rounding."""
UNSEEN = "turns or gusts may hide the rudder's effect, or it is too small"
"""What is said where no cause is seen."""


@dataclass(frozen=True, slots=True)
class Cause:
    """A cause in words, and the settings that may cure it."""

    text: str
    remedy: Mapping[str, object] = field(default_factory=dict)


def what_hides(
    history: SampleHistory, config: RunConfig, sample_time_s: float, *, is_copy: bool = False
) -> Cause:
    """Return why the rudder explains little of the yaw rate, the first cause that is seen.

    With ``is_copy`` the rudder is a copy of the aileron: to remove the turn, which the aileron
    makes, is no cure then.
    """
    history = _newest(history)
    u, y = history.u[:, 0], history.y
    late_s = clock_difference_s(u, y, sample_time_s)
    if late_s:
        when, other = "later", "the rudder acts with a delay"
        if late_s < 0.0:
            when, other = "earlier", "the rudder reacts to the yaw"
        return Cause(
            f"the yaw rate answers a rudder that moves {abs(late_s):.2g} s {when}: the clocks of "
            f"the two channels differ, or {other}"
        )
    if config.unit_of_rudder == "rad" and (step_deg := rounding_deg(u)):
        share = math.radians(step_deg) / float(np.nanmax(u) - np.nanmin(u))
        return Cause(
            f"the rudder is rounded to {step_deg:g} deg, which is {100.0 * share:.0f} % of its "
            "range: record it in finer steps"
        )
    keeps = config.turn == "keep" and not is_copy
    parts = turn_hides(history, sample_time_s) if keeps else None
    if parts is not None:
        return Cause(
            f"a turn hides the rudder's effect: the rudder explains {100.0 * parts[0]:.0f} % of "
            f"the yaw rate, and {100.0 * parts[1]:.0f} % without the turn; try --turn remove",
            {"turn": "remove"},
        )
    return Cause(UNSEEN)


def clock_difference_s(u: Floats, y: Floats, sample_time_s: float) -> float:
    """Return by how many s u (n,) must come later to explain y (n,) best, 0 if that is no more.

    The yaw rate's own past is part of each regression, so that the slow response of an aircraft
    counts as such and only the time at which the rudder acts is compared.
    """
    most, least = round(LATEST_S / sample_time_s), math.ceil(LEAST_LATE_S / sample_time_s)
    past = [shifted(y, i) for i in range(1, LAGS + 1)]
    shifts = range(-most, most + 1)
    moved = {shift: [shifted(u, shift + i) for i in range(1, LAGS + 1)] for shift in shifts}
    rows = np.isfinite(y + sum(past))
    rows &= np.isfinite(shifted(u, -most) + shifted(u, most + LAGS))
    for columns in moved.values():
        rows &= np.isfinite(sum(columns))
    if np.count_nonzero(rows) < ROWS_PER_LAG * 2 * LAGS:
        return 0.0
    left = {shift: _left(y, [*past, *columns], rows) for shift, columns in moved.items()}
    best = min(left, key=lambda shift: left[shift])
    if abs(best) < max(least, 2) or left[best] > CLOCK_SHARE * left[0]:
        return 0.0
    likelihood = np.count_nonzero(rows) * math.log(left[0] / max(left[best], ROUNDING))
    return best * sample_time_s if likelihood > CLOCK_LIKELIHOOD else 0.0


def rounding_deg(u: Floats) -> float:
    """Return the steps in deg to which a rudder u (n,) in rad is coarsely rounded, 0 if it is not.

    Samples that do not differ from the one before them stand on a level.
    """
    known = np.rad2deg(u[np.isfinite(u)])
    levels = known[1:][np.abs(np.diff(known)) < 1e-6]
    if len(levels) < STANDING * len(known):
        return 0.0
    for step in STEPS_DEG:
        at = levels / step
        if np.abs(at - np.round(at)).max() < 0.02 and len(np.unique(np.round(at))) >= LEVELS:
            return step if step >= COARSE * float(np.ptp(known)) else 0.0
    return 0.0


def turn_hides(history: SampleHistory, sample_time_s: float) -> tuple[float, float] | None:
    """Return the parts explained with and without the turn, None where they hardly differ."""
    u, turn = history.u[:, 0], history.turn_rate
    lags = [shifted(u, i) for i in response_lags(sample_time_s)]
    rows = np.isfinite(history.y + turn + sum(lags))
    if np.count_nonzero(rows) < ROWS_PER_LAG * len(lags):
        return None
    as_it_is, without = (
        1.0 - _left(y, lags, rows) / max(float(np.var(y[rows])), ROUNDING)
        for y in (history.y, history.y - turn)
    )
    return (as_it_is, without) if without > as_it_is + TURN_SHARE else None


def _newest(history: SampleHistory) -> SampleHistory:
    """Return the newest samples: a long flight need not be searched as a whole."""
    u, y, turn = (x[-MOST:] for x in (history.u, history.y, history.turn_rate))
    return replace(history, u=u, y=y, turn_rate=turn)


def _left(target: Floats, columns: list[Floats], rows: Bools) -> float:
    """Return the variance of the target's rows that a regression on the columns leaves."""
    return variance_left(target[rows], np.column_stack(columns)[rows])
