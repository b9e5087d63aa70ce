"""Two flights with different gains of the yaw damper: what each predicts for the other.

The aircraft that both identify is the one without its damper, so the model of one, closed with the
gain of the other, predicts what the pilot felt in the other.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from msgspec.structs import replace

from yawid.answers.damper_report import Decay, FlownGain
from yawid.answers.run_summary import Manoeuvre, Value
from yawid.blocks import Floats, finite
from yawid.damper.advice import closed_with
from yawid.damper.autopilots import Autopilot, Law
from yawid.damper.decay import damped_sine, decays_in, pilots_part
from yawid.damper.identified import Facts, Identified, identified
from yawid.damper.loop import closed_response
from yawid.damper.refusals import (
    Refused,
    autopilot_of,
    check_input,
    check_known,
    check_loop,
    gain_flown,
    usable_flight,
)
from yawid.models.flown import flown_in

ROWS: Final = 17
"""The gains, from 0 to the flown one, over which the closed pole is followed."""
MOST_WN_STD, MOST_GAIN_STD = 0.1, 0.4
"""Twice the sigmas that an advice may have: here each prediction stands next to what was flown."""
ALIKE_ZETA, ALIKE_SHARE, SIGMAS = 0.05, 0.15, 2.0
"""Two decays agree within the larger of .05 and 15 % of zeta, or within 2 sigma."""


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """What two flights say of their dampers.

    ``effect`` has, by flight (A, B), the size of the rudder's effect on the Dutch roll over V^2,
    in rad/s^2 per unit of rudder; ``notes`` say what could not be compared.
    """

    parameter: str
    flown: list[FlownGain]
    effect: Mapping[str, Value]
    notes: list[str]


@dataclass(frozen=True, slots=True)
class _Side:
    """One flight, and its manoeuvres by the gain flown."""

    name: str
    facts: Facts
    autopilot: Autopilot
    by_gain: Mapping[float, Sequence[Manoeuvre]]

    def model(self) -> Identified:
        """Return the aircraft identified.

        Raises:
            Refused: the answer is not usable, or not good enough for a prediction.
        """
        facts, flight = self.facts, usable_flight(self.facts.summary)
        check_known(flight, MOST_WN_STD)
        check_input(facts.summary, facts.config)
        factor = self.autopilot.turn_factor(facts.parameters)
        return identified(facts, flight, facts.rows(facts.used), factor, MOST_GAIN_STD)


def before_after(a: Facts, b: Facts) -> BeforeAfter | None:
    """Return what the two flights predict for each other; None where no damper was flown.

    What cannot be known of one of them is left out, and a note says why.
    """
    sides = [_side(name, facts) for name, facts in (("A", a), ("B", b))]
    one, other = sides
    if one is None or other is None or one.autopilot is not other.autopilot:
        return None
    if not any(gain for side in (one, other) for gain in side.by_gain):
        return None
    notes: list[str] = []
    loops = [side.facts.summary.flight and side.facts.summary.flight.loop for side in (one, other)]
    if loops[0] != loops[1]:
        notes.append(
            f"A is of the loop {loops[0]}, B of {loops[1]}: the predictions leave that out"
        )
    models: dict[str, Identified] = {}
    for side in (one, other):
        try:
            models[side.name] = side.model()
        except Refused as refused:
            notes.append(f"the model of {side.name} predicts nothing: {refused.reason.text}")
    flown: list[FlownGain] = []
    for side, by in ((one, other), (other, one)):
        try:
            flown += _flown(side, models.get(by.name))
        except Refused as refused:
            notes.append(f"the damper of {side.name} is not known: {refused.reason.text}")
    effect = {name: _effect(model) for name, model in models.items()}
    return BeforeAfter(one.autopilot.gain, flown, effect, notes)


def _side(name: str, facts: Facts) -> _Side | None:
    try:
        autopilot = autopilot_of(facts.summary, None)
    except Refused:
        return None
    last = facts.parameters.get(autopilot.gain)
    if last is None:
        return None
    by_gain: dict[float, list[Manoeuvre]] = {}
    for each in facts.summary.manoeuvres or ():
        gain = gain_flown(facts.summary, each, autopilot.gain, last)
        if gain is not None and each.airspeed_m_s is not None:
            by_gain.setdefault(round(gain, 6), []).append(each)
    # Of each gain those that the answer uses, where it uses any.
    kept = {
        gain: [each for each in some if each in facts.used] or some
        for gain, some in sorted(by_gain.items())
    }
    return _Side(name, facts, autopilot, kept)


def _flown(side: _Side, by: Identified | None) -> Iterator[FlownGain]:
    """Yield what each gain of a flight gives as the other's model predicts it, and as flown."""
    facts, known = side.facts, side.facts.parameters
    check_input(facts.summary, facts.config)
    loop_hz = known.get(side.autopilot.loop_rate, 0.0)
    check_loop(side.autopilot, known, loop_hz)
    for gain, manoeuvres in side.by_gain.items():
        speed = float(np.mean([each.airspeed_m_s or 0.0 for each in manoeuvres]))
        (law,) = facts.laws(side.autopilot, known, loop_hz, [speed])
        row = FlownGain(flight=side.name, gain=gain, airspeed_m_s=speed)
        if by is not None:
            gains = gain * np.linspace(0.0, 1.0, ROWS)
            closed = closed_with(by.aircraft, [law], gains, [speed], facts.sample_time_s)
            names = ("wn_rad_s", "wn_std", "zeta", "zeta_std")
            pair = finite({name: float(getattr(closed, name)[0, -1]) for name in names})
            if "zeta" in pair:
                found = _decays(side, law, gain, manoeuvres, by, pair["wn_rad_s"])
                agrees = _agrees(pair["zeta_std"], found)
                row = replace(row, **pair, **found, agrees=agrees)
        yield row


def _decays(
    side: _Side, law: Law, gain: float, manoeuvres: Sequence[Manoeuvre], by: Identified, wn: float
) -> dict[str, Decay]:
    """Return the damped sine of the decays as flown and as predicted, nothing without a decay."""
    flown: list[Floats] = []
    predicted: list[Floats] = []
    facts, step = side.facts, side.facts.sample_time_s
    factor = side.autopilot.turn_factor(facts.parameters)
    for then in flown_in(facts.rows(manoeuvres), facts.config):
        if facts.config.output == "yaw" or np.mean(then.known) < 0.5:
            continue
        v, error = pilots_part(then, law, gain, facts.turn_left(then.found, factor))
        speed = then.found.airspeed_m_s or by.aircraft.airspeed_m_s
        G = by.aircraft.central.faster(speed / by.aircraft.airspeed_m_s)  # noqa: N806
        decays = [rows for rows in decays_in(v, step, wn) if then.known[rows].all()]
        # What a wrong gain leaves of v in a decay would make the response that flown.
        for rows in decays:
            v[rows.start - 1 : rows.stop] = 0.0
        response = closed_response(G, law, gain, v, step)
        flown += [error[rows] for rows in decays]
        predicted += [response[rows] for rows in decays]
    sines = damped_sine(flown, step, wn), damped_sine(predicted, step, wn)
    if sines[0] is None or sines[1] is None:
        return {}
    return {"decay": sines[0], "decay_predicted": sines[1]}


def _agrees(zeta_std: float, found: Mapping[str, Decay]) -> bool | None:
    """Return whether both decays agree, None without them; ``zeta_std`` is that of the pair."""
    if not found:
        return None
    flown, predicted = found["decay"], found["decay_predicted"]
    sigmas = zeta_std, flown.zeta_std or 0.0, predicted.zeta_std or 0.0
    sigma = float(np.linalg.norm(sigmas))
    most = max(ALIKE_ZETA, ALIKE_SHARE * abs(flown.zeta), SIGMAS * sigma)
    return abs(flown.zeta - predicted.zeta) <= most


def _effect(model: Identified) -> Value:
    """Return the rudder's effect over V^2, with the sigma of the draws."""
    effect = model.aircraft.G.effect / model.aircraft.airspeed_m_s**2
    middle = float(np.median(effect))
    return Value(value=middle, std=float(np.sqrt(np.mean((effect - middle) ** 2))))
