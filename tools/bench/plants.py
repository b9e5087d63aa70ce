"""The four plants of the benches, S1 to S4, and their Cramer-Rao bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from yawid import ArmaxOrders

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Plant:
    """A plant A y = B u + C e with B starting at q^-1; u is white or AR(1) of unit variance."""

    name: str
    a: tuple[float, ...]
    b: tuple[float, ...]
    c: tuple[float, ...]
    noise_std: float = 1.0
    input_pole: float = 0.0

    @property
    def theta(self) -> Floats:
        """The true parameters (n,)."""
        return np.array(self.a + self.b + self.c)

    @property
    def orders(self) -> ArmaxOrders:
        """The true orders, with nk = 1."""
        return ArmaxOrders(len(self.a), len(self.b), len(self.c), 1)

    def simulate(self, samples: int, seed: int) -> tuple[Floats, Floats]:
        """Return u and y (samples,) of a simulation that starts at rest."""
        rng = np.random.default_rng(seed)
        white = rng.standard_normal((2, samples))
        u = lfilter([np.sqrt(1.0 - self.input_pole**2)], [1.0, -self.input_pole], white[0])
        a = (1.0, *self.a)
        noise = self.noise_std * lfilter((1.0, *self.c), a, white[1])
        return u, lfilter((0.0, *self.b), a, u) + noise

    def information(self) -> Floats:
        """Return E[psi psi'] / noise variance (n, n): the bound of N samples is its inverse over N.

        It is the integral of the spectrum of psi, the regressors filtered by 1/C (Ljung 1999,
        eq. 9.17).
        """
        z = np.exp(-2j * np.pi * np.arange(2**17) / 2**17)
        a, c = (np.polyval([*p[::-1], 1.0], z) for p in (self.a, self.c))
        b = np.polyval([*self.b[::-1], 0.0], z)
        lags = [z ** (i + 1) for i in range(max(len(self.a), len(self.b), len(self.c)))]
        from_u = [-lag * b / (a * c) for lag in lags[: len(self.a)]]
        from_u += [lag / c for lag in lags[: len(self.b)]] + [0.0 * z] * len(self.c)
        from_e = [-lag / a for lag in lags[: len(self.a)]] + [0.0 * z] * len(self.b)
        from_e += [lag / c for lag in lags[: len(self.c)]]
        spectrum = (1.0 - self.input_pole**2) / np.abs(1.0 - self.input_pole * z) ** 2
        gu, ge = np.array(from_u), np.array(from_e)
        total = (gu * spectrum) @ gu.conj().T / self.noise_std**2 + ge @ ge.conj().T
        return np.asarray(np.real(total) / len(z), np.float64)


def _dutch_roll() -> Plant:
    """Return S4: eq. 23 for r with K = 1, T = 0.8 s, wn = 2.5 rad/s, zeta = 0.2, at 50 Hz."""
    from scipy.signal import cont2discrete

    wn, zeta, t = 2.5, 0.2, 0.8
    numerator, denominator, _ = cont2discrete(
        ([t * wn**2, wn**2], [1.0, 2.0 * zeta * wn, wn**2]), 0.02
    )
    b = tuple(np.ravel(numerator)[1:])
    return Plant("S4", tuple(denominator[1:]), b, (-1.3, 0.42), 0.02, 0.95)


PLANTS = (
    Plant("S1", (-1.5, 0.7), (1.0, 0.5), (-1.0, 0.2)),
    Plant("S2", (0.9, 0.95), (1.0,), (1.5, 0.75)),
    Plant("S3", (-0.8, 0.15), (1.0, 0.5), (0.5, 0.1)),
    _dutch_roll(),
)
