"""What a run says of an ordinary flight's answer: what of it is given, and how it agrees.

It is compared with the manoeuvres' answer of nearly the same airspeed, to which wn is brought in
proportion: with the bare airframe, else with the flight's, as the aircraft was flown there.
"""

import math
from collections import defaultdict
from collections.abc import Iterator
from typing import Final

import numpy as np
from msgspec.structs import replace

from yawid.answers.ordinary import Agreement, OrdinaryAnswer
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Bare, DutchRoll, Flight, RunSummary
from yawid.blocks import AIRSPEED_SHARE, Floats, Noted, SampleBlock
from yawid.quantities.airspeed import GROUND_SPEED, true_of_equivalent
from yawid.quantities.vehicles import AIRFRAME, WITH_ROLL_LOOP

UNKNOWN: Final = "ordinary_unknown"
MOST_SIGMAS: Final = 3.0
"""The most by which both answers may differ. Without it two aircraft would stand next to each other
without a word; at 2 one of ten right pairs would have a warning, as wn and zeta are compared."""

SPEED_BIN: Final = math.log(1.03)


def given(found: OrdinaryAnswer) -> OrdinaryAnswer:
    """Return an answer without the numbers that its gates stop: the facts and the reasons."""
    if not found:
        return OrdinaryAnswer(
            airspeed_m_s=found.airspeed_m_s, seconds=found.seconds, seen_s=found.seen_s,
            turns=found.turns, windows=found.windows, share=found.share, verdict=found.verdict,
            airspeed_source=found.airspeed_source, altitude_m=found.altitude_m,
        )  # fmt: skip
    is_known = found.flown_verdict is not None and found.flown_verdict.usable
    return replace(found, flown=found.flown if is_known else None)


class Flown:
    """How high a run flew, and whose airspeed it had, by its true airspeed to 3 %."""

    def __init__(self) -> None:
        self._sums: defaultdict[int, Floats] = defaultdict(lambda: np.zeros(3))

    def feed(self, samples: SampleBlock) -> None:
        """Take samples in; those that are held do not count."""
        used = samples.select((samples.held == 0) & (samples.airspeed > 0.0))
        by_ground = (used.noted & Noted.GROUND_SPEED.value) != 0
        rows = np.column_stack([np.ones(len(used)), used.altitude, by_ground])
        speeds = np.log(true_of_equivalent(used.airspeed, used.altitude)) / SPEED_BIN
        for at in np.unique(bins := np.floor(speeds).astype(int)).tolist():
            self._sums[at] += rows[bins == at].sum(axis=0)

    def at(self, found: OrdinaryAnswer) -> OrdinaryAnswer:
        """Return an answer with the altitude and the source of its airspeed."""
        if not found.airspeed_m_s:
            return found
        middle = round(math.log(found.airspeed_m_s) / SPEED_BIN)
        count, height, by_ground = sum((self._sums[middle + i] for i in range(-2, 2)), np.zeros(3))
        source = GROUND_SPEED if 2.0 * by_ground > count else "airspeed"
        altitude_m = float(height / count) if count and math.isfinite(height) else None
        return replace(found, airspeed_source=source, altitude_m=altitude_m)


def why_unknown(found: OrdinaryAnswer | None) -> Iterator[Reason]:
    """Yield the reason of a run that ordinary flight alone should answer, if it does not."""
    if found is not None and not found:
        reasons = found.verdict.reasons
        yield Reason(UNKNOWN, "; ".join(each.text for each in reasons), reasons[0].remedy)


def compared(summary: RunSummary) -> RunSummary:
    """Return the summary with the agreement of ordinary flight and manoeuvres, if both are known.

    Where they disagree both have a warning.
    """
    found = summary.ordinary
    if not found or (pair := next(_pairs(summary, found), None)) is None:
        return summary
    other, own, by, theirs = pair
    wn, wn_std = by * own.wn_rad_s, by * (own.wn_std or 0.0)
    away = (
        abs(wn - theirs.wn_rad_s) / math.hypot(wn_std, theirs.wn_std or 0.0),
        abs(own.zeta - theirs.zeta) / math.hypot(own.zeta_std or 0.0, theirs.zeta_std or 0.0),
    )
    against = "bare" if isinstance(other, Bare) else "flight"
    agrees = Agreement(against=against, wn_sigmas=away[0], zeta_sigmas=away[1])
    summary = replace(summary, ordinary=replace(found, agrees=agrees))
    if max(away) <= MOST_SIGMAS:
        return summary
    text = (
        f"ordinary flight has wn {wn:.3g} rad/s and zeta {own.zeta:.2g}, the manoeuvres' {against} "
        f"{theirs.wn_rad_s:.3g} and {theirs.zeta:.2g}: {max(away):.1f} sigma apart"
    )
    return _warned(summary, other, Reason("ordinary_disagrees", text))


def _pairs(
    summary: RunSummary, found: OrdinaryAnswer
) -> Iterator[tuple[Bare | Flight, DutchRoll, float, DutchRoll]]:
    """Yield each answer of manoeuvres at nearly this airspeed, and the two modes to compare.

    Between them is the ratio of the airspeeds.
    """
    bare, own = summary.bare, found.dutch_roll
    others: list[tuple[Bare | Flight, DutchRoll | None, float]] = []
    if bare and bare.airspeed_m_s and found.airspeed_m_s:
        others.append((bare, own, bare.airspeed_m_s / found.airspeed_m_s))
    for flight in filter(None, summary.by_loop):
        mode = {AIRFRAME: own, WITH_ROLL_LOOP: found.flown}.get(flight.loop or "")
        ratio = (flight.airspeed_m_s or math.nan) / (found.equivalent_airspeed_m_s or math.nan)
        others.append((flight, mode, ratio))
    for other, mode, ratio in others:
        if mode and other.dutch_roll and abs(ratio - 1.0) <= AIRSPEED_SHARE:
            yield other, mode, ratio, other.dutch_roll


def _warned(summary: RunSummary, other: Bare | Flight, reason: Reason) -> RunSummary:
    """Return the summary with a warning in ordinary flight's verdict and in the other's."""
    assert summary.ordinary is not None  # it was compared
    both = [
        replace(each, verdict=each.verdict.with_reasons([reason]))
        for each in (summary.ordinary, other)
    ]
    summary = replace(summary, ordinary=both[0])
    if isinstance(other, Bare):
        return replace(summary, bare=both[1])
    flights = [both[1] if each is other else each for each in summary.by_loop]
    return replace(
        summary, verdict=flights[0].verdict, flight=flights[0],
        flights=flights if summary.flights else None,
    )  # fmt: skip
