"""The aircraft as far as it is known: transfer functions drawn from the answers' covariance.

Each draw is the model of one of the flight's manoeuvres, its numbers drawn from their covariance.
Moved to the flight's airspeed, the draws' Dutch rolls have the flight's wn and zeta on average, and
its total sigmas.

Models of different structures have one form where they hold: that of a pair and one real pole, the
median of theirs, whose numerator is solved by least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from yawid.answers.run_summary import DutchRoll, Flight
from yawid.blocks import Ints
from yawid.models.answered import LEAST_ZETA, MOST_ZETA, Answered, band_of
from yawid.physics.continuous import Transfer, pole_of
from yawid.physics.modes import Complexes

DRAWS: Final = 160
SEED: Final = 20260101


@dataclass(frozen=True, slots=True)
class Aircraft:
    """Draws of the aircraft at ``airspeed_m_s``: n transfer functions.

    ``lag`` (n,) is the column of the real pole that stays where it is at another airspeed, -1 in
    half of the draws: whether it is the servo's or the aircraft's is not known. ``central`` is one
    with exactly the flight's wn and zeta, and the mean of its manoeuvres' responses, ``alike`` has
    the draws in its form. ``falls`` is the variance of the rudder's effect on the pair, over its
    median, that noise and the scatter between manoeuvres cause: it falls with their number.
    """

    words: ClassVar = "the aircraft"

    G: Transfer
    central: Transfer
    alike: Transfer
    lag: Ints
    airspeed_m_s: float
    falls: float

    def at(self, airspeed_m_s: float) -> Transfer:
        """Return the transfer functions at another equivalent airspeed."""
        return self.G.faster(airspeed_m_s / self.airspeed_m_s, self.lag)

    def middle_at(self, airspeed_m_s: float) -> Transfer:
        """Return the central one at another equivalent airspeed."""
        return self.central.faster(airspeed_m_s / self.airspeed_m_s)

    def effect_std(self, manoeuvres: int) -> float:
        """Return the sigma of the rudder's effect on the pair, over its median, of their mean.

        What the structures and the sigmas of wn and zeta make of it is common to all.
        """
        effect = self.G.effect
        total = float(np.mean((effect / np.median(effect) - 1.0) ** 2))
        return float(np.sqrt(max(total - self.falls, 0.0) + self.falls / manoeuvres))


def drawn_aircraft(flight: Flight, models: Sequence[Answered]) -> Aircraft | None:
    """Return the flight's aircraft from the models of its manoeuvres; None where there is none."""
    roll, speed = flight.dutch_roll, flight.airspeed_m_s
    flown = [each.found.airspeed_m_s for each in models]
    at = [(each, speed / own) for each, own in zip(models, flown, strict=True) if speed and own]
    if roll is None or speed is None or not at:
        return None
    rng, count = np.random.default_rng(SEED), max(1, round(DRAWS / len(at)))
    parts = [each.transfers(each.drawn(count, rng))[0].faster(factor) for each, factor in at]
    drawn = Transfer.joined(parts)
    of_mean = Transfer.joined([each.transfers()[0].faster(factor) for each, factor in at])
    pair, wn = pole_of(roll.wn_rad_s, np.array(roll.zeta)), roll.wn_rad_s
    mean = alike(of_mean.with_pair(np.full(len(at), pair)), wn, _median_real(drawn))
    central = Transfer(mean.poles[:1], mean.residues.mean(axis=0)[None])
    middle = float(np.median(drawn.effect))
    common = [
        (1.0 - _share_of_noise(each)) * np.var(part.effect / middle)
        for (each, _), part in zip(at, parts, strict=True)
    ]
    falls = max(float(np.var(drawn.effect / middle) - np.mean(common)), 0.0)
    G = drawn.with_pair(_as_answered(roll, drawn.dutch_roll, rng))
    lag = np.where(np.arange(len(G)) % 2 == 0, _fastest_real(G), -1)
    return Aircraft(G, central, alike(G, wn, central.poles[0, 2:]), lag, speed, falls)


def alike(G: Transfer, wn_rad_s: float, reals: Complexes) -> Transfer:
    """Return models with their own pairs and these real poles (m,), with nearly their responses.

    Their numerators have the least relative error where a model with a pair at ``wn_rad_s`` holds.
    """
    s, pair, powers = band_of(wn_rad_s), G.dutch_roll, np.arange(2 + len(reals))
    poles = np.column_stack([pair, np.conj(pair), np.tile(reals, (len(G), 1))])
    den = (s[:, None] - poles[:, None, :]).prod(axis=2)
    X = s[:, None] ** powers / (den * G.at(s))[:, :, None]
    num = np.linalg.pinv(np.concatenate([X.real, X.imag], axis=1)) @ np.repeat([1.0, 0.0], len(s))
    return Transfer.of(poles, (poles[:, :, None] ** powers @ num[:, :, None])[:, :, 0])


def _median_real(G: Transfer) -> Complexes:
    """Return the median of the draws' first real pole (1,), nothing where none has any."""
    every = np.sort(G.poles[:, 2:3][G.residues[:, 2:3] != 0.0].real)
    return every[len(every) // 2 : len(every) // 2 + 1].astype(complex)


def _share_of_noise(model: Answered) -> float:
    """Return the part of a manoeuvre's variance that noise explains, as wn has it."""
    roll = model.found.dutch_roll
    noise, std = (roll.wn_std_noise, roll.wn_std) if roll else (None, None)
    return min(1.0, ((noise or 0.0) / (std or np.inf)) ** 2)


def _as_answered(roll: DutchRoll, poles: Complexes, rng: np.random.Generator) -> Complexes:
    """Return the Dutch rolls (n,) with the flight's mean and total sigma of wn and zeta."""
    values = np.stack([np.log(np.abs(poles)), -poles.real / np.abs(poles)])
    mean = np.array([[np.log(roll.wn_rad_s)], [roll.zeta]])
    std = np.array([[(roll.wn_std or 0.0) / roll.wn_rad_s], [roll.zeta_std or 0.0]])
    apart = values - values.mean(axis=1, keepdims=True)
    have = np.maximum(apart.std(axis=1, keepdims=True), np.finfo(float).tiny)
    more = np.sqrt(np.maximum(std**2 - have**2, 0.0)) * rng.normal(size=values.shape)
    ln_wn, zeta = mean + apart * np.minimum(1.0, std / have) + more
    return pole_of(np.exp(ln_wn), np.clip(zeta, LEAST_ZETA, MOST_ZETA))


def _fastest_real(G: Transfer) -> Ints:
    """Return the column (n,) of the fastest stable real pole with an effect, -1 without one."""
    real = (np.abs(G.poles.imag) < 1e-9) & (G.poles.real < 0.0) & (np.abs(G.residues) > 0.0)
    speed = np.where(real, -G.poles.real, -np.inf)
    return np.where(real.any(axis=1), np.argmax(speed, axis=1), -1)
