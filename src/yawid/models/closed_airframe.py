"""The bare airframe from rudder to yaw rate, closed with the roll law that it flew under.

It has the poles that a model of the yaw rate alone lacks: those of roll and spiral, of which a roll
hold often makes a second pair, and the servos' lag. Its numbers are drawn from their covariance,
and their closed pairs scatter by what a linear model of an aircraft is worth, too, as the sigmas of
the answer's Dutch roll do.
"""

from dataclasses import astuple, dataclass

import numpy as np

from yawid.blocks import Floats, Ints, SampleBlock
from yawid.lateral.fit_airframe import floor
from yawid.lateral.model import ROLL, Law, R, theta_of
from yawid.lateral.motion_store import MotionStore
from yawid.lateral.record import Record
from yawid.lateral.roll_law import LEAST_LAG_S, closed, modal, roll_law
from yawid.manoeuvre.bare_answer import LAWS
from yawid.models.draws import DRAWS, SEED
from yawid.models.flown import samples_of
from yawid.models.identify import Recorded, numbers_of
from yawid.physics.continuous import Transfer
from yawid.physics.modes import Complexes
from yawid.quantities.airspeed import GRAVITY, true_of_equivalent
from yawid.quantities.vehicles import AIRFRAME


@dataclass(frozen=True, slots=True)
class ClosedAirframe:
    """The airframe at the equivalent ``airspeed_m_s``, closed with ``law``: itself, and n draws.

    ``values`` (1 + n, m) are its numbers by their ``names``, first those of the answer, and
    ``moves`` (1 + n,) what the closed pair is multiplied by. The output is the yaw rate less
    ``turn`` times the rate (g/V) roll of a turn.
    """

    names: tuple[str, ...]
    values: Floats
    moves: Complexes
    law: Law
    turn: float
    airspeed_m_s: float
    true_m_s: float

    @property
    def words(self) -> str:
        """What it is, in words."""
        held = ", closed with the roll hold found in its aileron,"
        return "the bare airframe" + held * (self.law != Law())

    @property
    def lag(self) -> Ints:
        """The column (1 + n,) of the rudder servo's pole: the states of airframe, servo and law.

        The last state of the law, an integral, is not used; without a law the airframe is left.
        """
        return np.full(len(self.values), 4 if self.law == Law() else 6)

    @property
    def effect_std(self) -> float:
        """The sigma of the rudder's effect on the pair, over its median."""
        effect = self.at(self.airspeed_m_s).effect
        return float(np.std(effect) / np.median(effect))

    def at(self, airspeed_m_s: float) -> Transfer:
        """Return it at another equivalent airspeed.

        An autopilot scales its law by 1 / V^2, so that what the aileron does in the loop stays.
        """
        by, n = airspeed_m_s / self.airspeed_m_s, int(self.lag[0])
        powers = [0 if name.endswith("delta_a") else LAWS[name] for name in self.names]
        values, speed = self.values * by ** np.array(powers), by * self.true_m_s
        A, B = closed(theta_of(self.names, values), speed, self.law)
        seen = np.eye(n)[R] - self.turn * GRAVITY / speed * np.eye(n)[ROLL]
        G = Transfer(*(x.astype(complex) for x in modal(A[:, :n, :n], B[:, :n], seen)))
        move = np.where(G.dutch_roll.imag > 0.0, self.moves, 1.0)[:, None]
        G = G.with_poles(G.poles * np.hstack([move, move.conj(), np.ones((len(G), n - 2))]))
        a = 1.0 / np.maximum(values[:, [self.names.index("servo_lag_s")]], LEAST_LAG_S)
        residues = np.hstack([G.residues * a / (G.poles + a), a * G.at(-a.astype(complex))])
        return Transfer(np.hstack([G.poles, -a]), residues)

    def middle_at(self, airspeed_m_s: float) -> Transfer:
        """Return the answer itself at another equivalent airspeed."""
        every = self.at(airspeed_m_s)
        return Transfer(every.poles[:1], every.residues[:1])


def closed_airframe(run: Recorded, turn: float) -> ClosedAirframe | None:
    """Return the airframe with the roll law of the flight's answer, None where one is not known."""
    bare, flight = run.summary.bare, run.summary.flight
    if not bare or bare.dutch_roll is None or flight is None:
        return None
    if (law := _law_flown(run)) is None:
        return None
    names, value, covariance, true_m_s = numbers_of(bare)
    rng, zeta = np.random.default_rng(SEED), bare.dutch_roll.zeta
    drawn = rng.multivariate_normal(value, covariance, DRAWS, check_valid="ignore", method="eigh")
    ln_wn, more = rng.normal(0.0, [floor("wn_rad_s", 1.0), floor("zeta", zeta)], (DRAWS, 2)).T
    moves = np.exp(ln_wn + 1j * more / np.sqrt(1.0 - zeta**2))
    # None is NaN: the altitude is not known.
    denser = true_of_equivalent(np.array(1.0), np.array(flight.altitude_m, float))
    return ClosedAirframe(
        names, np.vstack([value, drawn]), np.append(1.0, moves), law, turn,
        true_m_s / float(denser), true_m_s,
    )  # fmt: skip


def _law_flown(run: Recorded) -> Law | None:
    """Return the mean roll law of the manoeuvres that the flight's answer uses, None without one.

    It has no gains where only the sticks moved the surfaces.
    """
    if run.summary.flight is not None and run.summary.flight.loop == AIRFRAME:
        return Law()
    store, samples = MotionStore(0.0), SampleBlock.joined([*run.samples])
    if run.motion is not None:
        store.feed(run.motion)
    cut = [store.cut(own) for each in run.used if len(own := samples_of(each, samples))]
    laws = (roll_law(Record(each)) for each in cut if not isinstance(each, str))
    gains = [astuple(law) for law in laws if law is not None]
    return Law(*np.mean(gains, axis=0).tolist()) if gains else None
