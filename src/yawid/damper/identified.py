"""The aircraft that a run identified: the draws of its manoeuvres' answers."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from yawid.answers.more_manoeuvres import of_mean
from yawid.answers.run_summary import Flight, Manoeuvre
from yawid.damper.autopilots import Autopilot, Law
from yawid.damper.refusals import MOST_GAIN_STD, Refused, check_sigma, check_turn
from yawid.errors import NotIdentifiable
from yawid.models.answered import Answered
from yawid.models.draws import Aircraft, drawn_aircraft
from yawid.models.flown import Flown
from yawid.models.identify import Recorded


class Facts(Recorded):
    """A run as the study of its damper needs it."""

    def laws(
        self, autopilot: Autopilot, known: Mapping[str, float], airspeeds_m_s: Sequence[float]
    ) -> list[Law]:
        """Return the damper at each airspeed, for the unit that this run's rudder has."""
        laws = [autopilot.law(known, known[autopilot.loop_rate], v) for v in airspeeds_m_s]
        return [replace(law, scaling=law.scaling * self.config.half_travel) for law in laws]

    def turn_left(
        self, found: Manoeuvre, autopilot: Autopilot, known: Mapping[str, float]
    ) -> float:
        """Return the part of the turn rate that the damper takes off a manoeuvre's yaw rate.

        It is the parameter of the wanted turn, where the damper has such a term, less what the fit
        has taken off.
        """
        if autopilot.turn is None or self.config.turn == "remove":
            return 0.0
        return known.get(autopilot.turn, 1.0) - float(found.turn_removed)


def identified(
    facts: Facts, flight: Flight, flown: Sequence[Flown], autopilot: Autopilot,
    known: Mapping[str, float], most_gain_std: float = MOST_GAIN_STD,
) -> Aircraft:  # fmt: skip
    """Return the aircraft without its damper, from the rudder to the yaw rate less the wanted turn.

    It is that of a usable flight, from the answers of the manoeuvres ``flown``. Closed on the yaw
    rate less that turn, the loop has the damper's term of it exactly.

    Raises:
        Refused: the manoeuvres have no models or no samples, the gain at wn is not known well
            enough, or the wanted turn is too large a part of the yaw rate.
    """
    assert flight.dutch_roll is not None  # usable_flight() has seen to it
    try:
        models = [Answered.of(each.found) for each in flown]
    except NotIdentifiable as error:
        raise Refused("not_fitted", str(error), "replay the log with this version") from error
    left = [facts.turn_left(each.found, autopilot, known) for each in flown]
    factor = known.get(autopilot.turn, 1.0) if autopilot.turn is not None else 0.0
    if factor and flown and facts.config.turn == "keep":
        check_turn(flown, flight.dutch_roll.wn_rad_s, factor)
    models = [_turned(*each) for each in zip(models, flown, left, strict=True)]
    n, aircraft = len(flight.used), drawn_aircraft(of_mean(flight), models)
    if aircraft is None:
        raise Refused("not_fitted", "its samples are not in the file", "replay the log again")
    std = aircraft.effect_std(n)

    def after(more: int) -> float | None:
        """Return sigma of the rudder's effect on the pair, after more manoeuvres.

        The gain itself is that over zeta wn, and its sigma mostly zeta's, which the predictions
        have already. Draws are few: they may say more of later than of now, and sigma does not
        grow.
        """
        later = drawn_aircraft(of_mean(flight, more), models) if more else aircraft
        return None if later is None else min(std, later.effect_std(n + more))

    check_sigma("gain_uncertain", "the rudder's effect at wn", after, most_gain_std)
    return aircraft


def _turned(model: Answered, flown: Flown, left: float) -> Answered:
    """Return the model of the yaw rate less ``left`` times the turn rate: its poles are the same.

    By linearity its residues are those of the yaw rate and of the turn rate.
    """
    if left == 0.0:
        return model
    turn = flown.explained_by_rudder(model.upper, flown.turn_rate)
    x = model.x.copy()
    x[model.order : 2 * model.order] -= left * turn
    return replace(model, x=x)
