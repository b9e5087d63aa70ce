"""The continuous transfer function from rudder to yaw rate, as poles and residues.

    G(s) = sum of R_i / (s - p_i)

with p_i in rad/s and R_i in rad/s^2 per unit of rudder. This form can be evaluated anywhere in the
s plane, for many models at once. The first pole is the Dutch roll's in the upper half plane, and
the second one its conjugate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.physics.modes import Complexes, without_each

FAR = 1e9
"""Size in rad/s of a pole that has no effect."""
SETTLED: Final = 0.05
"""The paper's criterion of 5 % (eq. 6): a swing within this share of its largest has settled."""


def pole_of(wn_rad_s: Floats | float, zeta: Floats) -> Complexes:
    """Return the poles in the upper half plane of wn in rad/s and zeta below 1, of any shape."""
    return np.asarray(wn_rad_s * (-zeta + 1j * np.sqrt(1.0 - zeta**2)), complex)


def overshoot_of(zeta: Floats) -> Floats:
    """Return by what share of it a swing of a pair goes on past its end: eq. 12 of the paper."""
    return np.asarray(np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2)))


def settling_of(poles: Complexes, residues: Complexes) -> Floats:
    """Return when the swing of a pair after a step has settled, in s; NaN where it grows.

    The swing is what the pair adds to the distance from the end, Re(R / p e^(p t)); all arrays have
    one shape. Its largest values lie half a turn apart, and between the last one above 5 % and the
    zero that follows it passes the 5 % once.
    """
    phase, decay = np.angle(residues / poles), np.where(poles.real < 0.0, -poles.real, np.nan)
    decay = decay / poles.imag
    lean = np.arctan(decay)

    def log_size(turned: Floats) -> Floats:
        return np.asarray(np.log(np.abs(np.cos(turned + phase))) - decay * turned)

    first = np.mod(-phase - lean, np.pi)
    level = np.log(SETTLED) + np.maximum(log_size(np.zeros_like(first)), log_size(first))
    above = np.floor((log_size(first) - level) / (np.pi * decay))
    low = first + np.pi * np.maximum(above, -1.0)  # -1: before the step
    high = low + 0.5 * np.pi + lean
    for _ in range(40):  # to 1e-12 of a turn
        middle = 0.5 * (low + high)
        is_above = log_size(middle) > level
        low, high = np.where(is_above, middle, low), np.where(is_above, high, middle)
    return np.asarray(high / poles.imag)


@dataclass(frozen=True, slots=True)
class Transfer:
    """The transfer functions of n models: their poles and residues (n, m)."""

    poles: Complexes
    residues: Complexes

    def __len__(self) -> int:
        return len(self.poles)

    @classmethod
    def joined(cls, parts: Sequence["Transfer"]) -> "Transfer":
        """Return the models of all parts; those with fewer poles get some without an effect."""
        width = max(each.poles.shape[1] for each in parts)

        def widened(x: Complexes, value: float) -> Complexes:
            return np.pad(x, ((0, 0), (0, width - x.shape[1])), constant_values=value)

        return cls(
            np.concatenate([widened(each.poles, -FAR) for each in parts]),
            np.concatenate([widened(each.residues, 0.0) for each in parts]),
        )

    @property
    def dutch_roll(self) -> Complexes:
        """The Dutch roll's pole (n,) in the upper half plane in rad/s."""
        return self.poles[:, 0]

    @property
    def effect(self) -> Floats:
        """The size of the Dutch roll's residue (n,): at wn, G is about that over zeta wn."""
        return np.asarray(np.abs(self.residues[:, 0]))

    def at(self, s: Complexes) -> Complexes:
        """Return G(s) (n, k) at points ``s`` (k,) of all models, or (n, k) of each."""
        s = np.broadcast_to(s, (len(self), np.shape(s)[-1]))
        terms = self.residues[:, None, :] / (s[:, :, None] - self.poles[:, None, :])
        found: Complexes = terms.sum(axis=2)
        return found

    @classmethod
    def of(cls, poles: Complexes, numerator: Complexes) -> "Transfer":
        """Return N(s) over the product of all (s - p_i); ``numerator`` (n, m) has N at each p_i."""
        return cls(poles, numerator / without_each(poles[:, :, None] - poles[:, None, :]))

    def with_poles(self, poles: Complexes) -> "Transfer":
        """Return them with other poles (n, m); zeros and the high end stay, and so does N."""
        parts = without_each(poles[:, :, None, None] - self.poles[:, None, None, :])
        return Transfer.of(poles, (parts * self.residues[:, None, :]).sum(axis=2))

    def with_pair(self, pole: Complexes) -> "Transfer":
        """Return them with the Dutch roll's pole (n,) moved; zeros and the high end stay."""
        return self.with_poles(np.column_stack([pole, np.conj(pole), self.poles[:, 2:]]))

    def faster(self, factor: float, lag: Ints | None = None) -> "Transfer":
        """Return them at an airspeed higher by ``factor``, as the derivatives of eq. 22 scale.

        a_z and a_my_omega_y go as V, a_my_beta and a_my_delta_h as V^2, so that G becomes
        factor G(s / factor). ``lag`` (n,) is the column of a lag a / (s + a) that does not scale,
        such as the servo's, -1 without one: its pole stays, and its gain at rest.
        """
        G = Transfer(self.poles * factor, self.residues * factor**2)
        if lag is None:
            return G
        stays = lag[:, None] == np.arange(self.poles.shape[1])
        G = G.with_poles(np.where(stays, self.poles, G.poles))
        return Transfer(G.poles, G.residues / np.where(stays.any(axis=1), factor, 1.0)[:, None])
