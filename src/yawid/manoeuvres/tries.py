"""The tries to answer a manoeuvre: the first one, and further ones where it is refused.

A further try changes only what the first one's reasons point to, and never what the user gave. Each
try is judged by the same rules. Since the first usable try answers, a false answer has as many
chances as there are tries; so the k-th try may have only 1/k of the probability of error that the
first one has (Bonferroni): in the test of B = 0, in the coherence at the mode, and in the limits of
sigma. From the second try on the rudder must also explain the yaw rate better than the same rudder
shifted in time. The tries follow from the manoeuvre's samples alone: live, a replay, and every cut
of the stream make the same.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from msgspec import structs

from yawid.answers.run_summary import Manoeuvre, Try
from yawid.blocks import SampleBlock
from yawid.config.run import BOTH, RunConfig
from yawid.estimation.grids import Narrow
from yawid.estimation.methods import OF_STRUCTURES
from yawid.estimation.record_fit import held_back_pct
from yawid.manoeuvres.answer import (
    Answered,
    Fits,
    ManoeuvreSetting,
    Way,
    answer_by,
    first_way,
    fitted_samples,
    may_have_aileron,
    may_remove_turn,
)
from yawid.quantities.vehicles import WITH_ROLL_LOOP
from yawid.results.coherence import BAND_MARGIN, HIGHEST, RATE_OF_BAND
from yawid.results.structures import AFTER_NEXT, NEXT, SIMPLE, WEIGHT_PCT

MOST_TRIES = 4
"""The most tries at one manoeuvre: each takes as long as the first one."""
CURABLE = frozenset({"poor_fit", "not_converged", "diverged", "mode_not_driven"})
"""Reasons that another fit of the same samples may remove; with any other one there is no try."""
LEAST_TURN = 0.2
"""The least scatter of the turn rate, as a part of the yaw rate's, for a try without the turn."""


def answer(samples: SampleBlock, n: int, setting: ManoeuvreSetting) -> Answered:
    """Return the answer of the ``n``-th manoeuvre from its samples.

    It is that of the first try that is usable, or of the first try at all.
    """
    way = first_way(samples, setting)
    first = answer_by(samples, n, setting, way)
    tried = [(way, first)]
    if not first.verdict.usable:
        for other in islice(_others(samples, setting, way, first), MOST_TRIES - 1):
            tried.append((other, answer_by(samples, n, setting, other, len(tried) + 1)))
            if tried[-1][1].verdict.usable:
                break
    if len(tried) == 1:
        return first
    best = next((each for _, each in tried if each.verdict.usable), first)
    tries = [_as_try(way, each.found, answers=each is best) for way, each in tried]
    return replace(best, found=structs.replace(best.found, tries=tries))


def _as_try(way: Way, found: Manoeuvre, *, answers: bool) -> Try:
    """Return what was tried and what speaks against it."""
    return Try(
        turn="remove" if found.turn_removed else "keep",
        band_hz=None if way.narrow is None else list(way.narrow.band_hz),
        inputs=found.inputs,
        orders=found.orders,
        reasons=[reason.id for reason in found.verdict.fatal],
        answers=answers,
    )


def _others(
    samples: SampleBlock, setting: ManoeuvreSetting, way: Way, first: Answered
) -> Iterator[Way]:
    """Yield the further ways to fit a refused manoeuvre that its reasons suggest, the best first.

    A rudder that does not drive the mode is tried again only in a band, below the mode found.
    """
    fatal = {reason.id for reason in first.verdict.reasons if reason.exit_code}
    config, narrow = way.config, _below(setting, first)
    # The rate may be too low only for a mode that is a vibration.
    if narrow is not None and fatal <= CURABLE | {"rate_too_low"}:
        yield Way(_with_orders(samples, setting, config, narrow), narrow)
    if not fatal <= CURABLE - {"mode_not_driven"}:
        return
    if "poor_fit" in fatal and config.turn == "keep" and may_remove_turn(config):
        known = np.isfinite(samples.y + samples.turn_rate)
        turn, yaw = samples.turn_rate[known], samples.y[known]
        if len(turn) and turn.std() > LEAST_TURN * yaw.std():
            yield Way(replace(config, turn="remove"))
    may_try = first.found.loop != WITH_ROLL_LOOP and first.found.inputs != list(BOTH)
    if may_try and may_have_aileron(Fits(setting, config, samples)):
        yield Way(replace(config, inputs=BOTH))
    if first.found.dutch_roll is None and not config.binds("orders"):
        yield Way(replace(config, orders=(*SIMPLE, config.four_orders[3])))


def _below(setting: ManoeuvreSetting, first: Answered) -> Narrow | None:
    """Return the band in which the rudder moves the yaw, below a mode that it does not drive.

    The mode may be a vibration. It then lies above half the rate, too, which is five times the band
    at most: a model has no pole for it there.
    """
    config, roll = setting.config, first.found.dutch_roll
    if config.band is not None or config.rate is not None or config.output == "yaw":
        return None
    driven = (r.remedy for r in first.verdict.reasons if r.id == "mode_not_driven")
    band = next((remedy["band"] for remedy in driven if "band" in remedy), None)
    if roll is None or not isinstance(band, tuple):
        return None
    low_hz, high_hz = band
    mode_hz, rate_hz = roll.wn_rad_s / (2.0 * math.pi), 1.0 / setting.sample_time_s
    if not high_hz < mode_hz:
        return None
    every = math.ceil(max(rate_hz / (RATE_OF_BAND * high_hz), 0.5 * rate_hz / mode_hz))
    # The filter's lower corner costs the more sigma, the nearer it is to the mode.
    return Narrow((low_hz / BAND_MARGIN, min(high_hz, 0.5 * HIGHEST * rate_hz / every)), every)


def _with_orders(
    samples: SampleBlock, setting: ManoeuvreSetting, config: RunConfig, narrow: Narrow
) -> RunConfig:
    """Return the configuration with the orders that held-back data favour in the band.

    Of those that are no more than 3 points below the best they are the fewest.
    """
    if config.binds("orders"):
        return config
    nk = config.four_orders[3]
    ways = [replace(config, orders=(*each, nk)) for each in (SIMPLE, (3, 3, 2), NEXT, AFTER_NEXT)]
    pct = []
    for each in ways:
        sample_time_s, _, u, y = fitted_samples(setting, each, samples, narrow)
        whole = replace(each, memory=None, forgetting=1.0)
        fit = whole.estimator(OF_STRUCTURES, sample_time_s)
        pct.append(held_back_pct(fit, u, y))
    best = max((each for each in pct if math.isfinite(each)), default=math.inf)
    near = (way for way, each in zip(ways, pct, strict=True) if each >= best - WEIGHT_PCT)
    return next(near, config)
