"""The gates that an airframe has to pass, each with what it means and what to do."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from yawid.answers.model_parts import MOST_TURN, DutchRoll
from yawid.answers.run_summary import Manoeuvre
from yawid.lateral.airframe import Airframe
from yawid.lateral.fit import ITERATIONS
from yawid.lateral.motion import Motion
from yawid.lateral.record import FOLLOWS, Record, explained
from yawid.quantities.vehicles import WITH_ROLL_LOOP

FED_BACK_BY_DAMPER = 0.1
"""The most of the rudder near the mode that may feed back the yaw rate: with .21 to .29 flights
of SITL in turbulence had zeta .46 to .57 for .63. Without a damper none is seen at all."""
MOST_APART = 1.5
"""The most by which the airframe may differ from the answer as flown, in sums of both sigmas: their
errors are of one record, so that they are not added in squares. Carried over from earlier gates."""
PARTS_APART, SURELY_APART = 2.2, 3.0
"""Sigmas by which parts of a record may differ, and from which on they surely do. Beyond the first
were 2 of 51 flights of the seed 701, none beyond the second; with 3 as the only limit 10 of 60
flights whose second half was flown at another airspeed had an airframe."""
NOT_DRIVEN = frozenset({"not_excited", "mode_not_driven"})
"""The reasons against an answer as flown that also stop the airframe: at the end of a go-around,
with the rudder moved by the autopilot to one side, wn was 9 % low with a sigma of 2.5 %."""
MOST_LOST = 0.33
"""The most of the fin's effect that may be lost at the largest sideslip: beyond it wn of drawn
aircraft was up to 44 % low, and below it 4 % off at most. Chosen on 74 flights of 24 of them."""
_COPY_DELAYS_S = (0.0, 0.05, 0.1, 0.15)


@dataclass(frozen=True, slots=True)
class Gate:
    """A gate: a sentence with ``{found}`` and ``{limit}``, what to do, and the limit.

    What is found may be the limit at most, or with ``at_least`` must be that or more.
    """

    sentence: str
    remedy: str
    limit: float = 0.0
    at_least: bool = False

    def said(self, found: float) -> str:
        """Return the sentence with what was found."""
        return self.sentence.format(found=found, limit=self.limit)


GATES = {
    "no_aileron": Gate(
        "no aileron was found", "name the aileron's output, or record all servo outputs"
    ),
    "commands_on_grid": Gate(
        "the commands are known on the grid of the samples only",
        "replay the log itself, whose servo messages have their own stamps",
    ),
    "aileron_at_rest": Gate(
        "the aileron never moves, although the autopilot holds the roll",
        "name the output that moves the aileron, or record all servo outputs",
    ),
    "rudder_copies_aileron": Gate(
        "the aileron explains {found:.3f} of the rudder's variance (limit {limit:g})",
        "move the rudder on its own",
        0.98,
    ),
    "rudder_feeds_back": Gate(
        "{found:.2f} of the rudder near the mode is feedback of the yaw rate (limit {limit:g})",
        "switch the yaw damper off for the manoeuvre",
        FED_BACK_BY_DAMPER,
    ),
    "changes": Gate(
        "the airframe changes within it: parts of the record are {found:.1f} sigma apart (limit "
        "{limit:g})",
        "keep flaps, power and airspeed as they are, or choose a part by --from and --to",
        PARTS_APART,
    ),
    "too_slow": Gate(
        "attitude and servo outputs come at {found:.2f} of the rate that the fastest mode needs",
        "send the attitude at a higher rate",
        1.0,
        at_least=True,
    ),
    "coloured": Gate(
        "the innovations predict {found:.2f} of those 40 ms later (limit {limit:g})",
        "send the attitude without smoothing, at a higher rate",
        0.35,
    ),
    "rudder_without_effect": Gate(
        "N_delta_r is {found:.1f} sigma from 0 ({limit:g} needed)",
        "move the rudder more",
        3.0,
        at_least=True,
    ),
    "several_minima": Gate(
        "from other starts the fit ends in another airframe ({found:g} of 3 agree, {limit:g} are "
        "needed)",
        "move the aileron on its own, or fly more manoeuvres at one speed",
        2,
        at_least=True,
    ),
    "only_feedback": Gate(
        "the aileron only follows the roll hold (roll and p explain {found:.2f} of it, limit "
        "{limit:g})",
        "move the aileron on its own, or give the servo's lag, if it is a sample's time or more "
        "(--servo-lag)",
        FOLLOWS,
    ),
    "aileron_uncertain": Gate(
        "the aileron's effect is not known: its sigma is {found:.2f} of it (limit {limit:g})",
        "move the aileron on its own, not by the roll hold alone",
        0.25,
    ),
    "lag_unknown": Gate(
        "the search for the servo's lag ended at a different value each time ({found:g} of them "
        "agree with the best one, {limit:g} are needed)",
        "give the servo's lag (--servo-lag), or pool several manoeuvres of one speed",
        2,
        at_least=True,
    ),
    "wn_uncertain": Gate(
        "sigma of wn is {found:.3f} of it (limit {limit:g})",
        "move the rudder more, and the aileron on its own",
        0.04,
    ),
    "differs_from_flown": Gate(
        "with the aileron moved as it was, the airframe differs from the answer as flown by "
        "{found:.1f} times the sum of both sigmas (limit {limit:g})",
        "check --servo-lag, and in gusts repeat the manoeuvre in calmer air",
        MOST_APART,
    ),
    "not_settled": Gate(
        "the fit did not settle within {limit:g} steps",
        "move the rudder more, and the aileron on its own",
        ITERATIONS,
    ),
    "not_proportional": Gate(
        "at the largest sideslip {found:.0%} of the fin's effect is lost (limit {limit:.0%})",
        "fly again with half the rudder",
        MOST_LOST,
    ),
    "no_dutch_roll": Gate("no mode of the airframe oscillates", "check the channels' signs"),
}
"""Every gate by its name, in the order in which they decide: what is wrong with the record comes
before what the fit makes of it."""


def failed_gates(airframe: Airframe, records: Sequence[Record], settled: bool) -> dict[str, float]:
    """Return what was found for the gates that stop the airframe of a fit, by name."""
    wn, rudder = airframe.wn_rad_s, airframe.derivatives["N_delta_r"]
    aileron = airframe.derivatives["L_delta_a"]
    found: dict[str, float] = {
        "not_settled": 0.0 if settled else math.inf,
        "coloured": airframe.rho1,
        "no_dutch_roll": not math.isfinite(wn.value),
    }
    if math.isfinite(wn.value):
        fastest = max(wn.value, abs(1.0 / airframe.roll_s.value))
        found["too_slow"] = MOST_TURN / (records[0].sample_time_s * fastest)
        found["wn_uncertain"] = wn.std / wn.value
        found["rudder_without_effect"] = abs(rudder.value) / rudder.std
        if any(each.aileron_moves for each in records):
            found["aileron_uncertain"] = aileron.std / abs(aileron.value)
    return stopped_by(found)


def facts_against(
    motion: Motion, flown: Manoeuvre, servo_lag_s: float | None
) -> list[tuple[str, str]]:
    """Return what stops a motion without any fit, each in words with what to do about it.

    ``flown`` is its answer as flown. The command of a hold has the noise of the same sample, which
    a servo's lag of a sample or more takes out of the aileron: without one zeta was up to .1, 4
    sigma, too high on the seed 701.
    """
    if why := motion.contradiction():
        return [(why, "check the channels' signs and units")]
    record = Record(motion)
    is_held = flown.loop == WITH_ROLL_LOOP and motion.aileron_known
    failed = stopped_by({
        "no_aileron": not motion.aileron_known,
        "commands_on_grid": not motion.commands_exact,
        "aileron_at_rest": is_held and not record.aileron_moves,
        "rudder_copies_aileron": copied_share(record),
        "only_feedback": record.fed_back if (servo_lag_s or 0.0) < motion.sample_time_s else 0.0,
    })  # fmt: skip
    said = [(GATES[name].said(x), GATES[name].remedy) for name, x in failed.items()]
    roll = flown.dutch_roll if flown.verdict.usable else None
    if roll is not None and (slow := too_slow(1.0 / motion.sample_time_s, roll)):
        said.append((slow, GATES["too_slow"].remedy))
    if text := not_driven(flown):
        said.append((text, "move the rudder there and back"))
    return said


def not_driven(flown: Manoeuvre) -> str:
    """Return in words that the rudder did not drive the yaw by an answer as flown; "" if it did."""
    against = [each.id for each in flown.verdict.fatal if each.id in NOT_DRIVEN]
    said = f"the rudder did not drive the yaw: the answer as flown is {' and '.join(against)}"
    return said if against else ""


def too_slow(rate_hz: float, roll: DutchRoll) -> str | None:
    """Return in words that attitudes at this rate are too few for a mode, None where they may do.

    The mode may be slower by three sigmas: another pole may be faster, which the fit shows.
    """
    if not roll.airframe_hz * (1.0 - 3.0 * (roll.wn_std or 0.0) / roll.wn_rad_s) > rate_hz:
        return None
    return (
        f"attitude and servo outputs come at {rate_hz:.3g} Hz, and a mode of {roll.wn_rad_s:.3g} "
        f"rad/s needs {roll.airframe_hz:.3g} Hz"
    )


def stopped_by(found: Mapping[str, float]) -> dict[str, float]:
    """Return what was found for the gates, by name, without those that let it pass."""
    rows = [(name, x, GATES[name]) for name, x in found.items()]
    return {name: x for name, x, of in rows
            if not (x >= of.limit if of.at_least else x <= of.limit)}  # fmt: skip


def copied_share(record: Record) -> float:
    """Return R squared of the rudder on the aileron of up to 0.15 s before; 0 of one at rest."""
    before = [record.commanded(0.0, delay_s)[:, 0] for delay_s in _COPY_DELAYS_S]
    share = explained(record.commanded(0.0, 0.0)[:, 1], np.stack(before, axis=1))
    return share if record.aileron_moves else 0.0
