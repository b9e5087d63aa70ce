"""The aircraft as far as it is known: transfer functions drawn from the answer's covariance.

Each draw is one of the flight's manoeuvres, fitted by its own structure or by the next richer one,
with theta drawn from its covariance. Moved to the flight's airspeed, the draws' Dutch rolls have
the flight's wn and zeta on average, and its total sigmas.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from yawid.answers.run_summary import Flight, Manoeuvre
from yawid.blocks import Bools, Floats
from yawid.config.run import RunConfig
from yawid.models.fitted import Model
from yawid.models.refit import Drawn, Rows
from yawid.physics.continuous import Transfer, transfer
from yawid.physics.modes import Complexes

DRAWS: Final = 160
SEED: Final = 20260101
ALIKE: Final = 0.15
"""A structure whose wn differs by more than this part of it has found another mode."""
OWN_SHARE: Final = 0.6
"""The share of the draws that have the answer's own structure."""
MOST_MANOEUVRES: Final = 6
"""The largest number of manoeuvres that are fitted again."""


@dataclass(frozen=True, slots=True)
class Aircraft:
    """Draws of the aircraft at ``airspeed_m_s``: n transfer functions.

    ``own`` (n,) says which have the answer's own structure. ``lag`` (n,) is the column of the real
    pole that stays where it is at another airspeed, -1 in half of the draws: whether it is the
    servo's or the aircraft's is not known. ``scatter`` is the sigma of the rudder's effect on the
    pair in the draws of the own structure as they were fitted, one manoeuvre each, over its median.
    """

    G: Transfer
    own: Bools
    lag: Floats
    airspeed_m_s: float
    scatter: float

    def at(self, airspeed_m_s: float) -> Transfer:
        """Return the transfer functions at another equivalent airspeed."""
        return self.G.faster(airspeed_m_s / self.airspeed_m_s, self.lag)

    def effect_std(self, manoeuvres: int) -> float:
        """Return the sigma of the rudder's effect on the pair, over its median in the own draws.

        What one manoeuvre scatters by falls with 1/sqrt(n) in the mean over ``manoeuvres``; what
        the structures and the sigmas of wn and zeta make of it is common to all.
        """
        effect, own = self.G.effect, self.scatter**2
        total = float(np.mean((effect / np.median(effect[self.own]) - 1.0) ** 2))
        return float(np.sqrt(max(total - own, 0.0) + own / manoeuvres))


def few(manoeuvres: Sequence[Manoeuvre]) -> list[Manoeuvre]:
    """Return as many of the manoeuvres as are fitted again, evenly spaced."""
    count = min(len(manoeuvres), MOST_MANOEUVRES)
    return [manoeuvres[i] for i in np.linspace(0, len(manoeuvres) - 1, count).round().astype(int)]


def fits(
    config: RunConfig, sample_time_s: float, rows: Sequence[Rows], orders: Sequence[int],
    turn: float = 0.0,
) -> list[tuple[Drawn, float]]:  # fmt: skip
    """Return manoeuvres fitted by these orders, each with its airspeed in m/s.

    The output is less ``turn`` times the turn rate.
    """
    drawn = [(each.drawn(config, sample_time_s, orders, turn), each.found.airspeed_m_s)
             for each in rows]  # fmt: skip
    return [(fit, speed) for fit, speed in drawn if fit is not None and speed is not None]


def drawn_aircraft(
    flight: Flight,
    own: Sequence[tuple[Model, float]],
    richer: Sequence[tuple[Model, float]],
    *,
    held: bool,
    mean_output: bool = False,
) -> Aircraft | None:
    """Return the flight's aircraft from models, each with its airspeed in m/s; None without one.

    ``own`` are the manoeuvres' models by the flight's own structure, ``richer`` by another.
    ``held`` and ``mean_output`` are those of :func:`transfer`.
    """
    roll, speed = flight.dutch_roll, flight.airspeed_m_s
    if roll is None or speed is None or not own:
        return None
    rng = np.random.default_rng(SEED)
    wn = roll.wn_rad_s
    parts: list[tuple[Transfer, bool]] = []
    first = round(DRAWS * (OWN_SHARE if richer else 1.0))
    for models, count, is_own in ((own, first, True), (richer, DRAWS - first, False)):
        for i, (model, at) in enumerate(models):
            share = count // len(models) + (i < count % len(models))
            if share:
                theta = _drawn(model, share, rng)
                kept = transfer(
                    theta, model.orders, model.sample_time_s, held=held, mean_output=mean_output
                ).faster(speed / at)
                near = np.abs(np.abs(kept.dutch_roll) / wn - 1.0) < ALIKE
                parts.append((kept.select(near), is_own))
    width = max(each.poles.shape[1] for each, _ in parts)
    wide = [_widened(each, width) for each, _ in parts]
    G = Transfer(
        poles=np.concatenate([each.poles for each in wide]),
        residues=np.concatenate([each.residues for each in wide]),
        direct=np.concatenate([each.direct for each in wide]),
        delay_s=wide[0].delay_s,
        pair=np.concatenate([each.pair for each in wide]),
    )
    own_rows = np.concatenate([np.full(len(each), is_own) for each, is_own in parts])
    if np.count_nonzero(own_rows) < DRAWS // 4:
        return None
    fitted = G.effect[own_rows]
    G = G.with_pair(_as_answered(flight, G.dutch_roll, own_rows, rng))
    lag = np.where(np.arange(len(G)) % 2 == 0, _fastest_real(G), -1)
    scatter = float(np.std(fitted) / np.median(fitted))
    return Aircraft(G, own_rows, lag, speed, scatter)


def central(aircraft: Aircraft, flight: Flight) -> Transfer:
    """Return one transfer function with exactly the flight's wn and zeta, at its airspeed."""
    assert flight.dutch_roll is not None
    wn, zeta = flight.dutch_roll.wn_rad_s, flight.dutch_roll.zeta
    poles = aircraft.G.dutch_roll
    off = np.abs(np.log(np.abs(poles) / wn)) + np.abs(-poles.real / np.abs(poles) - zeta)
    nearest = int(np.argmin(np.where(aircraft.own, off, np.inf)))
    return aircraft.G.select(slice(nearest, nearest + 1)).with_pair(pole_of(wn, np.array([zeta])))


def _drawn(model: Model, count: int, rng: np.random.Generator) -> Floats:
    """Return ``count`` draws of a model's theta."""
    root = np.linalg.eigh(0.5 * (model.covariance + model.covariance.T))
    spread = root.eigenvectors * np.sqrt(np.maximum(root.eigenvalues, 0.0))
    found: Floats = model.theta + rng.normal(size=(count, len(model.theta))) @ spread.T
    return found


def _as_answered(
    flight: Flight, poles: Complexes, own: Bools, rng: np.random.Generator
) -> Complexes:
    """Return the Dutch rolls (n,) with the flight's mean and total sigma of wn and zeta."""
    assert flight.dutch_roll is not None
    roll = flight.dutch_roll
    ln_wn, zeta = np.log(np.abs(poles)), -poles.real / np.abs(poles)
    wanted = ((ln_wn, np.log(roll.wn_rad_s), (roll.wn_std or 0.0) / roll.wn_rad_s),
              (zeta, roll.zeta, roll.zeta_std or 0.0))  # fmt: skip
    drawn = []
    for values, mean, std in wanted:
        apart = values - np.mean(values[own])
        have = float(np.sqrt(np.mean(apart**2)))
        more = np.sqrt(max(std**2 - have**2, 0.0))
        apart = apart * min(1.0, std / have if have > 0.0 else 1.0)
        drawn.append(mean + apart + more * rng.normal(size=len(values)))
    return pole_of(np.exp(drawn[0]), np.clip(drawn[1], -0.9, 0.95))


def pole_of(wn: Floats | float, zeta: Floats) -> Complexes:
    """Return the pole (n,) in the upper half plane of wn in rad/s and zeta (n,)."""
    return np.asarray(wn * (-zeta + 1j * np.sqrt(1.0 - zeta**2)), complex)


def _widened(G: Transfer, width: int) -> Transfer:
    """Return it with further poles far away that have no effect, ``width`` in all."""
    more = ((0, 0), (0, width - G.poles.shape[1]))
    poles = np.pad(G.poles, more, constant_values=-1e9)
    return replace(G, poles=poles, residues=np.pad(G.residues, more))


def _fastest_real(G: Transfer) -> Floats:
    """Return the column (n,) of the fastest stable real pole with an effect, -1 without one."""
    real = (np.abs(G.poles.imag) < 1e-9) & (G.poles.real < 0.0) & (np.abs(G.residues) > 0.0)
    speed = np.where(real, -G.poles.real, -np.inf)
    fastest = np.argmax(speed, axis=1)
    return np.where(real.any(axis=1), fastest, -1).astype(float)
