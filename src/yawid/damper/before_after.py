"""Two flights with different gains of the yaw damper: what each predicts for the other.

The aircraft that both identify is the one without its damper, so the model of one, closed with the
gain of the other, predicts what the pilot felt in the other.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from yawid.answers.damper_report import Decay, FlownGain
from yawid.answers.run_summary import Manoeuvre, Value
from yawid.blocks import Floats
from yawid.damper.advice import closed_with
from yawid.damper.autopilots import Autopilot, Law
from yawid.damper.decay import damped_sine, decays_in, pilots_part
from yawid.damper.identified import Facts, identified
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
from yawid.models.draws import Aircraft

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


def before_after(a: Facts, b: Facts) -> BeforeAfter | None:
    """Return what the two flights predict for each other; None where no damper was flown.

    What cannot be known of one of them is left out, and a note says why.
    """
    sides = {"A": a, "B": b}
    try:
        autopilot, other = (autopilot_of(each.summary, None) for each in (a, b))
    except Refused:
        return None
    if autopilot is not other or not all(autopilot.gain in each.parameters for each in (a, b)):
        return None
    by_gain = {name: _by_gain(facts, autopilot.gain) for name, facts in sides.items()}
    if not any(gain for gains in by_gain.values() for gain in gains):
        return None
    notes: list[str] = []
    loops = [each.summary.flight and each.summary.flight.loop for each in (a, b)]
    if loops[0] != loops[1]:
        notes.append(
            f"A is of the loop {loops[0]}, B of {loops[1]}: the predictions leave that out"
        )
    models: dict[str, Aircraft] = {}
    for name, facts in sides.items():
        try:
            models[name] = _model(facts, autopilot)
        except Refused as refused:
            notes.append(f"the model of {name} predicts nothing: {refused.reason.text}")
    flown: list[FlownGain] = []
    for (name, facts), by in zip(sides.items(), ("B", "A"), strict=True):
        try:
            flown += _flown(name, facts, autopilot, by_gain[name], models.get(by))
        except Refused as refused:
            notes.append(f"the damper of {name} is not known: {refused.reason.text}")
    effect = {name: _effect(model) for name, model in models.items()}
    return BeforeAfter(autopilot.gain, flown, effect, notes)


def _by_gain(facts: Facts, name: str) -> dict[float, list[Manoeuvre]]:
    """Return a flight's manoeuvres by the value that a gain had in them, ascending.

    Of each value they are those that the answer uses, where it uses any.
    """
    by_gain: dict[float, list[Manoeuvre]] = {}
    for each in facts.summary.manoeuvres or ():
        gain = gain_flown(facts.summary, each, name, facts.parameters[name])
        if gain is not None and each.airspeed_m_s is not None:
            by_gain.setdefault(round(gain, 6), []).append(each)
    return {
        gain: [each for each in some if each in facts.used] or some
        for gain, some in sorted(by_gain.items())
    }


def _model(facts: Facts, autopilot: Autopilot) -> Aircraft:
    """Return the aircraft that a flight identified.

    Raises:
        Refused: the answer is not usable, or not good enough for a prediction.
    """
    flight = usable_flight(facts.summary)
    check_known(flight, MOST_WN_STD)
    check_input(facts.summary, facts.config)
    flown = facts.flown(facts.used)
    return identified(facts, flight, flown, autopilot, facts.parameters, MOST_GAIN_STD)


def _flown(
    name: str, facts: Facts, autopilot: Autopilot, by_gain: Mapping[float, list[Manoeuvre]],
    by: Aircraft | None,
) -> Iterator[FlownGain]:  # fmt: skip
    """Yield what each gain of a flight gives as the other's model predicts it, and as flown."""
    check_input(facts.summary, facts.config)
    check_loop(autopilot, facts.parameters)
    for gain, manoeuvres in by_gain.items():
        speed = float(np.mean([each.airspeed_m_s or 0.0 for each in manoeuvres]))
        (law,) = facts.laws(autopilot, facts.parameters, [speed])
        found: dict[str, Any] = {}
        if by is not None:
            gains = gain * np.linspace(0.0, 1.0, ROWS)
            closed = closed_with(by, [law], gains, [speed], facts.sample_time_s).at(0, -1)
            if "zeta" in closed:
                found = {n: x for n, x in closed.items() if n in FlownGain.__struct_fields__}
                decays = _decays(facts, autopilot, law, gain, manoeuvres, by, closed["wn_rad_s"])
                found |= decays | {"agrees": _agrees(closed["zeta_std"], decays)}
        yield FlownGain(flight=name, gain=gain, airspeed_m_s=speed, **found)


def _decays(
    facts: Facts, autopilot: Autopilot, law: Law, gain: float, manoeuvres: Sequence[Manoeuvre],
    by: Aircraft, wn: float,
) -> dict[str, Decay]:  # fmt: skip
    """Return the damped sine of the decays as flown and as predicted, nothing without a decay."""
    flown: list[Floats] = []
    predicted: list[Floats] = []
    step = facts.sample_time_s
    for then in facts.flown(manoeuvres):
        if facts.config.output == "yaw" or np.mean(then.known) < 0.5:
            continue
        turn = facts.turn_left(then.found, autopilot, facts.parameters)
        v, error = pilots_part(then, law, gain, turn)
        speed = then.found.airspeed_m_s or by.airspeed_m_s
        G = by.middle_at(speed)  # noqa: N806
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
    sigma = math.hypot(zeta_std, flown.zeta_std or 0.0, predicted.zeta_std or 0.0)
    most = max(ALIKE_ZETA, ALIKE_SHARE * abs(flown.zeta), SIGMAS * sigma)
    return abs(flown.zeta - predicted.zeta) <= most


def _effect(model: Aircraft) -> Value:
    """Return the rudder's effect over V^2, with the sigma of the draws."""
    effect = model.G.effect / model.airspeed_m_s**2
    middle = float(np.median(effect))
    return Value(value=middle, std=float(np.sqrt(np.mean((effect - middle) ** 2))))
