"""The aircraft that a run identified: its manoeuvres fitted again, and the draws made of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import radians
from typing import Final

from yawid.answers.more_manoeuvres import MORE, of_mean
from yawid.answers.run_summary import Flight
from yawid.damper.autopilots import Autopilot, Law, law_at
from yawid.damper.refusals import MOST_GAIN_STD, Refused, gain_uncertain, turn_share
from yawid.models.draws import Aircraft, central, drawn_aircraft, fits
from yawid.models.identify import Recorded
from yawid.models.refit import Drawn, Rows
from yawid.physics.continuous import Transfer

LEAST_TURN: Final = 0.05
"""From this share of the yaw rate near wn on the wanted turn is in the model. Without it zeta was
.03 to .04 low with a damper that adds .2."""
RICHER: Final = ((3, 3, 2), (4, 4, 3))
"""Structures: the draws have the flight's own and the other one of these."""


class Facts(Recorded):
    """A run as the study of its damper needs it."""

    def laws(
        self, autopilot: Autopilot, known: Mapping[str, float], loop_hz: float,
        airspeeds_m_s: Sequence[float],
    ) -> list[Law]:  # fmt: skip
        """Return the damper at each airspeed, for the unit that this run's rudder has."""
        laws = [law_at(autopilot, known, loop_hz, speed) for speed in airspeeds_m_s]
        return [replace(law, scaling=law.scaling * self.half_travel) for law in laws]

    @property
    def half_travel(self) -> float:
        """Half the rudder's travel, in the unit of its channel."""
        return radians(self.config.rudder_max_deg) if self.config.rudder_max_deg else 1.0


@dataclass(frozen=True, slots=True)
class Identified:
    """The aircraft without its damper: in draws, and as one with exactly the flight's answer.

    ``manoeuvre`` is the first of those that were fitted again. The output is the yaw rate, less
    the wanted turn where that matters; ``turn`` is the part of it still to be taken off.
    """

    aircraft: Aircraft
    central: Transfer
    manoeuvre: Drawn
    turn: float


def identified(
    facts: Facts, flight: Flight, rows: Sequence[Rows], turn_factor: float | None,
    most_gain_std: float = MOST_GAIN_STD,
) -> Identified:  # fmt: skip
    """Return the aircraft of a usable flight from the samples of some of its manoeuvres.

    ``turn_factor`` is the damper's parameter of the wanted turn, None where it has no such term.
    Closed on the yaw rate less that turn, the loop has the term exactly.

    Raises:
        Refused: they do not give the flight's answer, the gain at wn is not known well enough, or
            the wanted turn is too large a part of the yaw rate.
    """
    assert flight.orders is not None  # check_known refuses others
    assert flight.dutch_roll is not None
    na, nb, nc, nk = (getattr(flight.orders, name) for name in ("na", "nb", "nc", "nk"))
    other = RICHER[1] if (na, nb, nc) != RICHER[1] else RICHER[0]
    structures, turn = ((na, nb, nc, nk), (*other, nk)), 0.0
    of = partial(fits, facts.config, facts.sample_time_s, rows)
    own = of(structures[0])
    if turn_factor and own:
        share = turn_share([each for each, _ in own], flight.dutch_roll.wn_rad_s, turn_factor)
        if share > LEAST_TURN and facts.config.turn == "keep":
            turn = turn_factor
            own = of(structures[0], turn)
    richer = of(structures[1], turn)
    models = [[(each.model, speed) for each, speed in some] for some in (own, richer)]
    held = facts.config.rudder_is == "commanded"

    def drawn(more: int) -> Aircraft | None:
        """Return the draws, with the sigmas of the mean after more manoeuvres."""
        mean, output = of_mean(flight, more), facts.config.output
        return drawn_aircraft(mean, *models, held=held, mean_output=output == "yaw")

    aircraft = drawn(0)
    if aircraft is None:
        text = "the manoeuvres, fitted again, do not give the flight's answer"
        raise Refused("not_fitted", text, "replay the log with this version")
    n = len(flight.used)
    if (std := aircraft.effect_std(n)) > most_gain_std:
        later = {more: drawn(more) for more in MORE}
        # Draws are few: what they say of later may be more than now, and sigma does not grow.
        falls = {
            more: None if each is None else min(std, each.effect_std(n + more))
            for more, each in later.items()
        }
        raise gain_uncertain(std, falls, most_gain_std)
    left = 0.0 if facts.config.turn == "remove" else (turn_factor or 0.0) - turn
    return Identified(aircraft, central(aircraft, flight), own[0][0], left)
