"""The continuous transfer function from rudder to yaw rate, as poles and residues.

    G(s) = (sum of R_i / (s - p_i) + D) exp(-s delay)

with p_i in rad/s and R_i in rad/s^2 per unit of rudder; D is 0 for every identified model. This
form can be evaluated anywhere in the s plane, for many models at once. A zero-order hold is undone
exactly (:func:`yawid.physics.modes.residues_of`), the mean of a rudder that moved between the
samples, and a pole that alternates, as far as :mod:`yawid.physics.moving_rudder` says.
"""

from dataclasses import dataclass, replace

import numpy as np

from yawid.blocks import Bools, Floats
from yawid.config.estimator import ArmaxOrders
from yawid.physics.modes import Complexes, dutch_roll_index, poles_of, residues_of
from yawid.physics.moving_rudder import followed, frequencies, of_pair, response

FAR = 1e9
"""Size in rad/s of a pole that has no effect."""


@dataclass(frozen=True, slots=True)
class Transfer:
    """Transfer functions of n models: poles and residues (n, m), direct terms (n,), a delay in s.

    ``pair`` (n,) is the column of the Dutch roll's pole in the upper half plane, -1 without one.
    """

    poles: Complexes
    residues: Complexes
    direct: Floats
    delay_s: float
    pair: Floats

    def __len__(self) -> int:
        return len(self.poles)

    @property
    def dutch_roll(self) -> Complexes:
        """The Dutch roll's pole (n,) in the upper half plane in rad/s, NaN where there is none."""
        found = self.poles[np.arange(len(self)), self.pair.astype(int)]
        return np.where(self.pair >= 0, found, np.nan)

    @property
    def effect(self) -> Floats:
        """The size of the Dutch roll's residue (n,): at wn, G is about that over zeta wn."""
        residues = self.residues[np.arange(len(self)), self.pair.astype(int)]
        return np.asarray(np.abs(residues))

    def at(self, s: Complexes) -> Complexes:
        """Return G(s) (n, k) at points ``s`` (k,) of all models, or (n, k) of each."""
        s = np.broadcast_to(s, (len(self), np.shape(s)[-1]))
        terms = self.residues[:, None, :] / (s[:, :, None] - self.poles[:, None, :])
        found: Complexes = terms.sum(axis=2) + self.direct[:, None]
        return found * np.exp(-s * self.delay_s)

    def select(self, rows: slice | Bools) -> "Transfer":
        """Return the transfer functions of these rows."""
        return replace(self, poles=self.poles[rows], residues=self.residues[rows],
                       direct=self.direct[rows], pair=self.pair[rows])  # fmt: skip

    def faster(self, factor: float, lag: Floats | None = None) -> "Transfer":
        """Return them at an airspeed higher by ``factor``, as the derivatives of eq. 22 scale.

        a_z and a_my_omega_y go as V, a_my_beta and a_my_delta_h as V^2, so that G becomes
        factor G(s / factor). ``lag`` (n,) is the column of a lag that does not scale, such as the
        servo's, -1 without one.
        """
        if factor == 1.0:
            return self
        rows = np.arange(len(self))
        has = np.zeros(len(self), bool) if lag is None else lag >= 0
        column = np.where(has, 0 if lag is None else lag, 0).astype(int)
        pole = np.where(has, self.poles[rows, column], -1.0)
        # Without its lag: (s - pole) / -pole times G; the lag's own residue vanishes.
        inside = self.residues * (self.poles - pole[:, None]) / -pole[:, None]
        inside = np.where(has[:, None], inside, self.residues)
        total = self.residues.sum(axis=1).real
        direct = np.where(has, total / -pole.real, self.direct)
        scaled = replace(self, poles=self.poles * factor, residues=inside * factor**2,
                         direct=direct * factor)  # fmt: skip
        # The lag again: G -pole / (s - pole), whose residue at the lag is that of a new pole.
        at_lag = np.where(np.arange(self.poles.shape[1]) == column[:, None], 0.0, scaled.residues)
        apart = pole[:, None] - scaled.poles
        value = (at_lag / np.where(apart == 0.0, 1.0, apart)).sum(axis=1) + scaled.direct
        again = at_lag * -pole[:, None] / np.where(apart == 0.0, 1.0, -apart)
        again[rows, column] = -pole * value
        poles = scaled.poles.copy()
        poles[rows, column] = pole
        return replace(
            self,
            poles=np.where(has[:, None], poles, scaled.poles),
            residues=np.where(has[:, None], again, scaled.residues),
            direct=np.where(has, 0.0, scaled.direct),
        )

    def with_pair(self, pole: Complexes) -> "Transfer":
        """Return them with the Dutch roll's pole (n,) moved; zeros and the high end stay."""
        rows, column = np.arange(len(self)), self.pair.astype(int)
        old = self.dutch_roll
        twin = np.argmin(np.abs(self.poles - np.conj(old)[:, None]), axis=1)

        def without(s: Complexes) -> Complexes:
            """Return G (s - p) (s - conj p) at s (n,)."""
            near, far = s - old, s - np.conj(old)
            found = self.residues[rows, column] * far + self.residues[rows, twin] * near
            rest = s[:, None] - self.poles
            rest[rows, column] = rest[rows, twin] = 1.0
            others = self.residues / rest
            others[rows, column] = others[rows, twin] = 0.0
            return np.asarray(found + near * far * (others.sum(axis=1) + self.direct))

        shift = (self.poles - old[:, None]) * (self.poles - np.conj(old)[:, None])
        rest = (self.poles - pole[:, None]) * (self.poles - np.conj(pole)[:, None])
        rest[rows, column] = rest[rows, twin] = 1.0  # these residues come below
        residues, poles = self.residues * shift / rest, self.poles.copy()
        poles[rows, column], poles[rows, twin] = pole, np.conj(pole)
        residues[rows, column] = without(pole) / (pole - np.conj(pole))
        residues[rows, twin] = np.conj(residues[rows, column])
        return replace(self, poles=poles, residues=residues)


def transfer(
    theta: Floats, orders: ArmaxOrders, sample_time_s: float,
    *, held: bool, mean_output: bool = False, lags: Complexes | None = None,
) -> Transfer:  # fmt: skip
    """Return the transfer functions from the first input of models ``theta`` (n, p).

    ``held``: the rudder was held from sample to sample; else it moved at any time. A dead time
    beyond one sample (nk > 1) is the delay. Poles that alternate from sample to sample have no
    continuous counterpart: the others have the response. ``mean_output`` is that of
    :func:`residues_of`. ``lags`` (n, na) are the poles of a model with the same A that this one
    must have as well.

    Raises:
        ValueError: the model has no B, or more coefficients of B than of A.
    """
    if not orders.nb or not 1 <= orders.nb[0] <= orders.na:
        raise ValueError(f"nb must be 1 to na = {orders.na} for a continuous model: {orders.nb}")
    prompt = ArmaxOrders(na=orders.na, nb=orders.nb, nc=orders.nc, nk=(1,) * len(orders.nk))
    poles = poles_of(theta[:, : orders.na], prompt, sample_time_s)
    residues = residues_of(theta, poles, prompt, sample_time_s, mean_output=mean_output)
    alternating = np.isnan(poles.s) & np.isfinite(poles.z)
    p, residues = (np.where(alternating, x, y) for x, y in ((-FAR, poles.s), (0.0, residues)))
    pair = dutch_roll_index(p, residues, sample_time_s)
    again = np.isfinite(p).all(axis=1) & (alternating.any(axis=1) if held else True)
    if again.any():
        w = frequencies(p[again], pair[again], sample_time_s)
        G = response(theta[again], prompt, sample_time_s, w, held=held, mean_output=mean_output)
        some = (p if lags is None else lags)[again]
        stays = of_pair(some, pair[again]) if lags is None else ~alternating[again]
        p[again], residues[again] = followed(some, stays, ~alternating[again], w, G)
    delay_s = (orders.nk[0] - 1) * sample_time_s
    return Transfer(p, residues, np.zeros(len(p)), delay_s, pair.astype(float))
