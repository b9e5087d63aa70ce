"""From a run to the advice on its yaw damper: checks, predictions, sentences."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from yawid.answers.damper_report import DamperGain, DamperReport, Recommended
from yawid.answers.more_manoeuvres import of_mean
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Flight, Manoeuvre
from yawid.damper.advice import (
    FINE,
    Closed,
    Predicted,
    closed_with,
    largest_gain,
    nice,
    recommended,
    spread,
    table,
)
from yawid.damper.autopilots import AUTOPILOTS, Autopilot
from yawid.damper.decay import pilots_part
from yawid.damper.identified import Facts, identified
from yawid.damper.mix import mix_of
from yawid.damper.refusals import (
    EXIT_CODES,
    MOST_GAIN_STD,
    Refused,
    autopilot_of,
    check_input,
    check_known,
    check_loop,
    gain_flown,
    usable_flight,
)
from yawid.damper.sentences import (
    Without,
    leave_out,
    sentences,
    warnings,
    without_damper,
)
from yawid.errors import ConfigError
from yawid.models.closed_airframe import ClosedAirframe, closed_airframe
from yawid.models.draws import Aircraft
from yawid.models.flown import Flown

DIGITS: Final = 6
"""Decimal places of a gain."""
FURTHEST: Final = 1.5
"""The largest factor between an airspeed asked for and those flown."""
SAME_SPEED: Final = 0.03
"""Airspeeds that differ by at most this part of them are one."""
LEAST_SHOWN: Final = 4.0
"""At least this number of gains is printed."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What the user gives: a zeta to aim at, what the log does not say, and airspeeds in m/s.

    Raises:
        ConfigError: a value is outside its limits.
    """

    aim: float | None = None
    autopilot: str | None = None
    airspeed: tuple[float, float] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    gains: Sequence[float] = ()

    def __post_init__(self) -> None:
        aim, gains = self.aim or 0.3, self.gains
        low, high = self.airspeed or (1.0, 1.0)
        known = self.autopilot in (None, *AUTOPILOTS)
        checks: tuple[tuple[str, object, bool, str], ...] = (
            ("--aim", aim, 0.05 <= aim <= 0.9, "0.05 to 0.9"),
            ("--autopilot", self.autopilot, known, f"one of {', '.join(AUTOPILOTS)}"),
            ("--airspeed", [low, high], 0.0 < low <= high < 1e3, "LO,HI in m/s, 0 < LO <= HI"),
            ("gains", gains, all(0.0 <= gain < 1e3 for gain in gains), "0 to 1000"),
        )
        for name, value, good, needed in checks:
            if not good:
                got = ",".join(f"{v:g}" for v in value) if isinstance(value, list) else repr(value)
                raise ConfigError(f"{name} must be {needed}, got {got}")


@dataclass(frozen=True, slots=True)
class Study:
    """The report, and the predictions behind it; None where it was refused."""

    report: DamperReport
    predicted: Predicted | None = None

    @property
    def exit_code(self) -> int:
        """0 where there are predictions, else the code of the first fatal reason."""
        fatal = self.report.verdict.fatal
        return EXIT_CODES[fatal[0].id] if fatal else 0


def study(facts: Facts, asked: Asked) -> Study:
    """Return which gain of the yaw damper gives which damping, for a run and what the user asked.

    A run for which that cannot be known gives a report whose verdict says why.
    """
    known: dict[str, float] = {**facts.parameters, **asked.parameters}
    said: dict[str, Any] = {"log": facts.summary.log}
    without = Without()
    try:
        flight = usable_flight(facts.summary)
        check_input(facts.summary, facts.config)
        roll = of_mean(flight).dutch_roll
        assert roll is not None  # usable_flight() has seen to it
        without = without_damper(roll.zeta, roll.zeta_std, asked.aim)
        check_known(flight)
        autopilot = autopilot_of(facts.summary, asked.autopilot)
        said |= {
            "autopilot": autopilot.words,
            "parameter": autopilot.gain,
            "mix": mix_of(
                facts.summary, autopilot, known.get(autopilot.mix), facts.config.half_travel
            ),
        }
        check_loop(autopilot, known)
        flown, seen = known[autopilot.gain], list[float | None]()
        if autopilot.gain not in asked.parameters:
            seen = [gain_flown(facts.summary, each, autopilot.gain, flown) for each in facts.used]
            flown = next((each for each in reversed(seen) if each is not None), flown)
        # A parameter is a float32, whose 0.2 is 3e-9 more than ours: one gain is one row.
        known[autopilot.gain] = flown = round(flown, DIGITS)
        said |= {"flown": flown, "loop_rate_hz": known[autopilot.loop_rate]}
        predicted, differs = _predicted(facts, flight, autopilot, known, asked)
    except Refused as refused:
        return Study(DamperReport(**said, **_refused(refused, without, said)))
    closed, is_airframe = predicted.closed, isinstance(predicted.aircraft, ClosedAirframe)
    said["aircraft"] = "airframe" if is_airframe else "as_flown"
    if is_airframe:
        without = without_damper(float(closed.zeta[0, 0]), float(closed.zeta_std[0, 0]), asked.aim)
    found = recommended(closed, flown, asked.aim)
    says = list(sentences(predicted, autopilot.gain, flown, found, asked.aim, without))
    reasons = [*differs, *warnings(predicted, autopilot.gain, flown, seen)]
    verdict = Verdict(method=flight.method, usable=True, reasons=reasons)
    gains = _shown(closed, found, flown, asked.gains)
    report = DamperReport(**said, gains=gains, recommended=found, says=says, verdict=verdict)
    return Study(report, predicted)


def _refused(refused: Refused, without: Without, said: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sentences and the verdict where no gain can be predicted.

    An aircraft that needs no damper needs no gain: then the reason is only a warning.
    """
    says, reason = list[str](), refused.reason
    if without.suffices:
        says = [without.text]
        reason = Reason(reason.id, f"no gain was predicted: {reason.text}", weight="warning")
        if "flown" in said:
            says.append(leave_out(said["parameter"], said["flown"]))
    to_do = None if without.suffices else refused.to_do
    verdict = Verdict(usable=without.suffices, reasons=[reason], next=to_do)
    return {"gains": [], "says": says, "verdict": verdict}


def _predicted(
    facts: Facts, flight: Flight, autopilot: Autopilot, known: Mapping[str, float], asked: Asked
) -> tuple[Predicted, list[Reason]]:  # fmt: skip
    """Return the damped aircraft, and what speaks against the airframe where it is not taken."""
    flown = facts.flown(facts.used)
    aircraft, differs = _aircraft(facts, flight, flown, autopilot, known)
    speeds = _airspeeds(aircraft.airspeed_m_s, facts.used, asked)
    laws = facts.laws(autopilot, known, speeds)
    # The gains that are tried: finely spaced from 0, with the one flown and those asked for.
    most = max(largest_gain(aircraft, laws, speeds), known[autopilot.gain])
    step = nice(most / FINE)
    fine = np.arange(0.0, most + 0.5 * step, step)
    gains = np.unique(np.round([*fine, known[autopilot.gain], *asked.gains], DIGITS))
    closed = closed_with(aircraft, laws, gains, speeds, facts.sample_time_s)
    near = int(np.argmin(np.abs(np.array(speeds) - aircraft.airspeed_m_s)))
    turn = facts.turn_left(flown[0].found, autopilot, known)
    pilot, _ = pilots_part(flown[0], laws[near], known[autopilot.gain], turn)
    return Predicted(aircraft, tuple(laws), closed, flown[0], pilot), differs


def _aircraft(
    facts: Facts, flight: Flight, flown: Sequence[Flown], autopilot: Autopilot,
    known: Mapping[str, float],
) -> tuple[Aircraft | ClosedAirframe, list[Reason]]:  # fmt: skip
    """Return the airframe where it is known, else the answer as flown, and what speaks against it.

    Where their zeta without a damper differs by more than the sum of both sigmas, it is the answer
    as flown: no damper acted where an airframe is known.

    Raises:
        Refused: the airframe is not known, and :func:`identified` refuses the answer as flown.
    """
    airframe = closed_airframe(facts, known.get(autopilot.turn, 1.0) if autopilot.turn else 0.0)
    if airframe is None or not flown or not airframe.effect_std <= MOST_GAIN_STD:
        return identified(facts, flight, flown, autopilot, known), []
    with suppress(Refused):  # then the airframe is known alone
        as_flown = identified(facts, flight, flown, autopilot, known)
        pairs = [each.at(as_flown.airspeed_m_s).dutch_roll[None] for each in (as_flown, airframe)]
        (own, std), (its, its_std) = (spread(-pair.real / np.abs(pair)) for pair in pairs)
        if abs(own - its) > std + its_std:
            text = (
                f"the bare airframe with its loops has zeta {its[0]:.2f} ± {its_std[0]:.2f} without"
                f" a damper, and the answer as flown, which is taken, {own[0]:.2f} ± {std[0]:.2f}"
            )
            return as_flown, [Reason("airframe_differs", text, weight="warning")]
    return airframe, []


def _airspeeds(middle: float, used: Sequence[Manoeuvre], asked: Asked) -> list[float]:
    """Return the airspeeds in m/s of the predictions, ascending; ``middle`` is the flight's."""
    flown = [each.airspeed_m_s for each in used if each.airspeed_m_s is not None]
    low, high = asked.airspeed or (min(flown), max(flown))
    if low < min(flown) / FURTHEST or high > max(flown) * FURTHEST:
        text = (
            f"{low:g} to {high:g} m/s is asked for and {min(flown):.1f} to {max(flown):.1f} m/s "
            f"was flown: at most a factor of {FURTHEST:g} can be bridged"
        )
        to_do = "fly manoeuvres at those airspeeds, or ask for less by --airspeed LO,HI"
        raise Refused("too_far", text, to_do)
    if high - low <= SAME_SPEED * middle and asked.airspeed is None:
        return [middle]
    between = [middle] if low * (1 + SAME_SPEED) < middle < high / (1 + SAME_SPEED) else []
    return sorted({low, *between, high})


def _shown(
    closed: Closed, found: Recommended | None, flown: float, asked: Sequence[float]
) -> list[DamperGain]:
    """Return the gains that are printed: some at equal distances, and those that have a name."""
    gains, rows = closed.gains, table(closed)
    named = [0.0, flown, *asked]
    if found is not None:
        named += [found.low, found.high, found.next]
    if not asked:
        named += np.arange(0.0, 1.0001 * gains[-1], nice(float(gains[-1]) / LEAST_SHOWN)).tolist()
    return [rows[i] for i in sorted({int(np.argmin(np.abs(gains - each))) for each in named})]
