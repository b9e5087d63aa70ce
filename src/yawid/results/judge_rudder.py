"""The check whether the rudder explains the yaw rate: a free decay alone can give a good fit.

A yaw rate that decays freely has the right frequency, whatever the rudder did. If the rudder is not
the one that moved the aircraft, but one of another flight or on another clock, such a fit looks
right although its gain and zeros are wrong.
"""

import math
from collections.abc import Iterator

from yawid.blocks import WINDOW_S
from yawid.config.run import RunConfig
from yawid.estimation.free_run import RudderEffect
from yawid.results.excitation import Movement
from yawid.results.reasons import Reason

BY_CHANCE = 0.001
"""The largest probability that noise alone makes so large a B."""
LEAST_POINTS = 10.0
"""Points of the free-run fit that the rudder must add to the free decay alone."""
LEAST_RATIO = 1.4
"""Squared residuals with the rudder shifted in time, over those with it as measured. It was 1.47
or more, mostly above 4, in right answers, and below 1.35 with another flight's rudder."""
LEAST_EXCESS = 3.0
"""... and only where the free run leaves so many times the variance of the innovations: where it
leaves no more than noise, a shift changes little. It was 4 or more with another flight's rudder."""
PERIODS = (0.125, 1.5)
"""The least and the largest shift that is tried, in periods of the mode."""


def stroke_reasons(found: Movement, config: RunConfig) -> Iterator[Reason]:
    """Judge the rudder's strokes in deg where its travel is unknown.

    There a part of the record's own largest stroke is no measure: a rudder that hardly moves has a
    largest stroke too.
    """
    own_deg = math.degrees(found.most_own * config.half_travel)
    if own_deg < config.stroke_floor_deg:
        yield Reason(
            "not_excited",
            f"the rudder's largest movement of its own within {WINDOW_S:g} s is {own_deg:.2g} deg: "
            f"at least {config.stroke_floor_deg:g} deg is needed where its travel is unknown "
            "(--least-stroke-deg)",
        )


def rudder_shifts(wn_rad_s: float, sample_time_s: float, nb: int) -> tuple[int, int] | None:
    """Return the least and the largest shift in samples; None without a mode.

    A shift of ``nb`` samples or less is one that B itself can make.
    """
    if not wn_rad_s > 0.0:
        return None
    period = 2.0 * math.pi / (wn_rad_s * sample_time_s)
    least = max(nb + 1, math.ceil(PERIODS[0] * period))
    return least, max(least, round(PERIODS[1] * period))


def rudder_reasons(found: RudderEffect, tries: int = 1) -> Iterator[Reason]:
    """Judge what the rudder adds to the model; what is unknown is not judged.

    ``tries`` is the number of fits of these samples: chance may pass one of them with the
    probability that a single fit has.
    """
    by_chance = BY_CHANCE / tries
    if found.ratio < LEAST_RATIO and found.excess > LEAST_EXCESS:
        when = "later" if found.shifted_s > 0.0 else "earlier"
        yield Reason(
            "mode_not_driven",
            f"a rudder that moves {abs(found.shifted_s):.2g} s {when} explains the yaw rate nearly "
            f"as well or better (squared residuals {found.ratio:.2f} times those of the measured "
            f"one; at least {LEAST_RATIO:g} times is needed): this rudder, or its clock, does not "
            "belong to this yaw rate",
        )
    elif found.chance > by_chance:
        yield Reason(
            "mode_not_driven",
            "the rudder has no significant effect on the yaw rate: noise alone makes the model's B "
            f"as large with a probability of {100.0 * found.chance:.2g} %, and "
            f"{100.0 * by_chance:.2g} % is allowed",
        )
    elif found.fit_pct - found.without_pct < LEAST_POINTS:
        yield Reason(
            "mode_not_driven",
            f"the rudder explains hardly any of the yaw rate: the model reaches a fit of "
            f"{found.fit_pct:.0f} % (free run), and its free decay alone reaches "
            f"{found.without_pct:.0f} %; the rudder must add at least {LEAST_POINTS:g} points",
        )
