"""The aircraft that a run identified: the draws of its manoeuvres' answers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians

from yawid.answers.more_manoeuvres import of_mean
from yawid.answers.run_summary import Flight, Manoeuvre
from yawid.damper.autopilots import Autopilot, Law
from yawid.damper.refusals import MOST_GAIN_STD, Refused, check_turn, gain_uncertain
from yawid.errors import NotIdentifiable
from yawid.models.answered import Answered
from yawid.models.draws import Aircraft, drawn_aircraft
from yawid.models.flown import Flown, Rows, flown_in
from yawid.models.identify import Recorded


class Facts(Recorded):
    """A run as the study of its damper needs it."""

    def laws(
        self, autopilot: Autopilot, known: Mapping[str, float], loop_hz: float,
        airspeeds_m_s: Sequence[float],
    ) -> list[Law]:  # fmt: skip
        """Return the damper at each airspeed, for the unit that this run's rudder has."""
        laws = [autopilot.law(known, loop_hz, speed) for speed in airspeeds_m_s]
        return [replace(law, scaling=law.scaling * self.half_travel) for law in laws]

    @property
    def used(self) -> list[Manoeuvre]:
        """The manoeuvres that the flight's answer uses."""
        of = self.summary.flight.used if self.summary.flight is not None else ()
        return [each for each in self.summary.manoeuvres or () if each.n in of]

    @property
    def half_travel(self) -> float:
        """Half the rudder's travel, in the unit of its channel."""
        return radians(self.config.rudder_max_deg) if self.config.rudder_max_deg else 1.0

    def turn_left(self, found: Manoeuvre, factor: float | None) -> float:
        """Return the part of the turn rate that the damper takes off a manoeuvre's yaw rate.

        ``factor`` is the damper's parameter of the wanted turn, None where it has no such term.
        """
        if factor is None or self.config.turn == "remove":
            return 0.0
        return factor - float(found.turn_removed)


@dataclass(frozen=True, slots=True)
class Identified:
    """The aircraft without its damper, from the rudder to the yaw rate less the wanted turn.

    ``manoeuvre`` is the first of the flight's, and ``turn`` the part of the turn rate that is still
    to be taken off its yaw rate.
    """

    aircraft: Aircraft
    manoeuvre: Flown
    turn: float


def identified(
    facts: Facts, flight: Flight, rows: Sequence[Rows], turn_factor: float | None,
    most_gain_std: float = MOST_GAIN_STD,
) -> Identified:  # fmt: skip
    """Return the aircraft of a usable flight from the answers of its manoeuvres.

    ``turn_factor`` is the damper's parameter of the wanted turn, None where it has no such term.
    Closed on the yaw rate less that turn, the loop has the term exactly.

    Raises:
        Refused: the manoeuvres have no models or no samples, the gain at wn is not known well
            enough, or the wanted turn is too large a part of the yaw rate.
    """
    assert flight.dutch_roll is not None  # usable_flight() has seen to it
    flown = flown_in(rows, facts.config)
    try:
        models = [Answered.of(each.found) for each in flown]
    except NotIdentifiable as error:
        raise Refused("not_fitted", str(error), "replay the log with this version") from error
    left = [facts.turn_left(each.found, turn_factor) for each in flown]
    if turn_factor and flown and facts.config.turn == "keep":
        check_turn(flown, flight.dutch_roll.wn_rad_s, turn_factor)
    models = [_turned(*each) for each in zip(models, flown, left, strict=True)]

    def drawn(more: int) -> Aircraft | None:
        """Return the draws, with the sigmas of the mean after more manoeuvres."""
        return drawn_aircraft(of_mean(flight, more), models)

    aircraft = drawn(0)
    if aircraft is None:
        raise Refused("not_fitted", "its samples are not in the file", "replay the log again")
    n = len(flight.used)
    if (std := aircraft.effect_std(n)) > most_gain_std:

        def after(more: int) -> float | None:
            later = drawn(more)
            # Draws are few: what they say of later may be more than now, and sigma does not grow.
            return None if later is None else min(std, later.effect_std(n + more))

        raise gain_uncertain(std, after, most_gain_std)
    return Identified(aircraft, flown[0], left[0])


def _turned(model: Answered, flown: Flown, left: float) -> Answered:
    """Return the model of the yaw rate less ``left`` times the turn rate: its poles are the same.

    By linearity its residues are those of the yaw rate and of the turn rate.
    """
    if left == 0.0:
        return model
    poles, residues = model.halves()
    return model.with_rudder(residues[0] - left * flown.explained_by_rudder(poles, flown.turn_rate))
