"""Cross spectra of windows of flight, summed: all that is kept of an ordinary flight.

A window of the signals z = [p, r, roll, da, f, g], where

    f = cos(pitch) sin(roll) + V / g tan(alpha) p     g / V times it is what bank and p do to beta
    g = tan(pitch) (q sin(roll) + r cos(roll))        what pitch rate and yaw rate do to the roll
    tan(alpha) = tan(pitch) / cos(roll)               in flight without climb

A turn has a larger alpha than straight flight, and rolls into it: with one alpha for all of a calm
flight an OV-10's wn was 10 % high. The signals are tapered by Hann's h, and Z_b = sum of
Z(w) Z(w)^H over the frequencies of bin b, with

    Z(w) = sqrt(Ts / sum h^2) sum over k of h(k) (z(k) - mean) exp(-j w k Ts)

so that Z_b / n_b estimates the density of z in 1/(rad/s) times 2 pi, on both sides. The sums of
windows add up, and f and g become what a bank adds to linear motion by a linear map, at any pitch.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats
from yawid.lateral.motion import Motion
from yawid.ordinary.law import LAGS_S, law_sums
from yawid.quantities.airspeed import GRAVITY

Complex = NDArray[np.complex128]
P, R, ROLL, AILERON, FORCE, TURN = range(6)
EDGES = 0.1 * 1.025 ** np.arange(248)
"""Edges of the bins in rad/s, from .1 to 45 rad/s: above 3.5 times a wn of 12 rad/s."""
INDEPENDENT = 0.485
"""The part of the frequencies of windows that overlap by half, tapered by Hann's, that counts:
neighbours are correlated by 2/3 and 1/6, windows by 1/6. Without it every sigma is 30 % small."""


@dataclass(frozen=True, slots=True)
class Sums:
    """The sums over windows of nearly one airspeed; ``a + b`` are those of both.

    ``w`` (b,) sums the frequencies of each bin, ``n`` (b,) counts them, ``Z`` (b, 6, 6) sums
    z z^H. ``law`` (l, 5, 5) is what the roll law's regression needs: see :func:`law_sums`.
    ``seconds`` is the time that is new with these windows; ``speed`` and ``pitch`` are
    their integrals over it. ``step_s`` is the largest sample time, ``turns`` counts turns.
    """

    w: Floats
    n: Floats
    Z: Complex
    law: Floats
    seconds: float = 0.0
    speed: float = 0.0
    pitch: float = 0.0
    step_s: float = 0.0
    turns: int = 0
    windows: int = 0

    @classmethod
    def none(cls) -> Self:
        """Return the sums of no window."""
        bins = len(EDGES) - 1
        zero = np.zeros((bins, 6, 6), np.complex128)
        return cls(np.zeros(bins), np.zeros(bins), zero, np.zeros((len(LAGS_S), 5, 5)))

    def __add__(self, other: "Sums") -> "Sums":
        values = {name: getattr(self, name) + getattr(other, name) for name in self.__slots__}
        return Sums(**{**values, "step_s": max(self.step_s, other.step_s)})

    def __mul__(self, weight: float) -> "Sums":
        """Return the sums weighted, as forgetting does, the counts too."""
        names = ("w", "n", "Z", "law", "seconds", "speed", "pitch")
        return replace(self, **{name: weight * getattr(self, name) for name in names})


@dataclass(frozen=True, slots=True)
class Band:
    """The spectra in a band: w (b,) in rad/s, counts n (b,), Z (b, 6, 6) with f and g as f1 and f2.

    f1 = f - cos(pitch0) roll - V / g tan(pitch0) p and f2 = g - tan(pitch0) r are what a bank adds
    to linear motion.
    """

    w: Floats
    n: Floats
    Z: Complex


def spectra_of(motion: Motion, aileron: Floats) -> tuple[Floats, Floats, Complex]:
    """Return w, n and Z of one window, whose samples are all known; aileron (n,) is on its grid."""
    p, r, roll, pitch, q = motion.p, motion.r, motion.roll, motion.pitch, motion.q
    turn = np.tan(pitch) * (q * np.sin(roll) + r * np.cos(roll))
    force = np.cos(pitch) * np.sin(roll)
    force += motion.airspeed_m_s / GRAVITY * np.tan(pitch) / np.cos(roll) * p
    z = np.stack([p, r, roll, aileron, force, turn])
    n, Ts, bins = z.shape[1], motion.sample_time_s, len(EDGES) - 1
    taper = 0.5 - 0.5 * np.cos(math.tau * (np.arange(n) + 0.5) / n)
    tapered = (z - (z @ taper)[:, None] / taper.sum()) * taper
    F = np.fft.rfft(tapered, axis=1) * math.sqrt(Ts / (taper @ taper))
    w = np.arange(F.shape[1]) * math.tau / (n * Ts)
    at = np.searchsorted(EDGES, w) - 1
    inside = (at >= 0) & (at < bins) & (w < math.pi / Ts)
    at, w, F = at[inside], w[inside], F[:, inside]
    Z = np.zeros((bins, 6, 6), complex)
    np.add.at(Z, at, np.einsum("ik,jk->kij", F, F.conj()))
    count = np.bincount(at, minlength=bins).astype(np.float64)
    return np.asarray(np.bincount(at, w, bins), np.float64), count, Z


def window_sums(motion: Motion, aileron: Floats, new_s: float, turns: int) -> Sums:
    """Return the sums of one window, of which ``new_s`` have not been in one before."""
    w, n, Z = spectra_of(motion, aileron)
    law = law_sums(aileron, motion.roll, motion.p, motion.sample_time_s)
    speed, pitch = new_s * motion.airspeed_m_s, new_s * float(motion.pitch.mean())
    return Sums(w, n, Z, law, new_s, speed, pitch, motion.sample_time_s, turns, 1)


def band(sums: Sums, low: float, high: float, joined: int = 1) -> Band:
    """Return the spectra from ``low`` to ``high`` rad/s, ``joined`` bins as one."""
    pitch = sums.pitch / max(sums.seconds, 1e-9)
    T = np.eye(6)
    speed_m_s = sums.speed / max(sums.seconds, 1e-9)
    T[FORCE, P] = -speed_m_s / GRAVITY * math.tan(pitch)
    T[FORCE, ROLL], T[TURN, R] = -math.cos(pitch), -math.tan(pitch)
    rows = (EDGES[:-1] >= low) & (EDGES[1:] <= high) & (sums.n > 0.0)
    starts = np.arange(0, np.count_nonzero(rows), joined)
    if not len(starts):
        return Band(np.zeros(0), np.zeros(0), np.zeros((0, 6, 6), complex))
    w, n, Z = (np.add.reduceat(x[rows], starts, axis=0) for x in (sums.w, sums.n, sums.Z))
    return Band(w / n, INDEPENDENT * n, np.asarray(INDEPENDENT * (T @ Z @ T.T), complex))
