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
from base64 import b64decode, b64encode
from dataclasses import dataclass
from io import BytesIO
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats
from yawid.lateral.motion import Motion
from yawid.ordinary.law import law_sums
from yawid.quantities.airspeed import GRAVITY

Complex = NDArray[np.complex128]
P, R, ROLL, AILERON, FORCE, TURN = range(6)
EDGES = 0.1 * 1.025 ** np.arange(248)
"""Edges of the bins in rad/s, from .1 to 45 rad/s: above 3.5 times a wn of 12 rad/s."""
INDEPENDENT = 0.485
"""The part of the frequencies of windows that overlap by half, tapered by Hann's, that counts:
neighbours are correlated by 2/3 and 1/6, windows by 1/6. Without it every sigma is 30 % small."""
USABLE = 0.8
"""The part of the Nyquist frequency below which spectra are used."""
_HALF = np.triu_indices(6)


@dataclass(frozen=True, slots=True)
class Sums:
    """The sums over windows of nearly one airspeed; ``a + b`` are those of both.

    ``w`` (b,) sums the frequencies of each bin, ``n`` (b,) counts them, ``Z`` (b, 6, 6) sums
    z z^H. ``law`` (4, 4) is what the roll law's regression needs: see :func:`law_sums`.
    ``seconds`` is the time that is new with these windows; ``speed`` and ``pitch`` are
    their integrals over it. ``turns`` counts turns.
    """

    w: Floats
    n: Floats
    Z: Complex
    law: Floats
    seconds: float
    speed: float
    pitch: float
    turns: int
    windows: int

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(*(getattr(self, name) + getattr(other, name) for name in self.__slots__))

    def packed(self) -> str:
        """Return the sums as text of 30 kB, to seven digits: half of Z says all of it."""
        parts = {name: getattr(self, name) for name in self.__slots__}
        parts["Z"] = self.Z[:, *_HALF].astype(np.complex64)
        np.savez_compressed(packed := BytesIO(), **parts)
        return b64encode(packed.getvalue()).decode()

    @classmethod
    def unpacked(cls, text: str) -> Self:
        """Return the sums that :meth:`packed` made a text of."""
        with np.load(BytesIO(b64decode(text)), allow_pickle=False) as file:
            parts = {name: file[name] for name in file}
        Z = np.zeros((BINS, 6, 6), complex)
        Z[:, *_HALF[::-1]] = parts["Z"].conj()
        Z[:, *_HALF] = parts["Z"]
        return cls(**{name: x if x.ndim else x.item() for name, x in (parts | {"Z": Z}).items()})


BINS = len(EDGES) - 1
NONE = Sums(
    np.zeros(BINS), np.zeros(BINS), np.zeros((BINS, 6, 6), complex), np.zeros((4, 4)),
    0.0, 0.0, 0.0, 0, 0,
)  # fmt: skip
"""The sums of no window."""


def window_sums(motion: Motion, aileron: Floats, new_s: float, turns: int) -> Sums:
    """Return the sums of one window, of which ``new_s`` have not been in one before.

    Its samples are all known; aileron (n,) is on its grid.
    """
    p, r, roll, pitch, q = motion.p, motion.r, motion.roll, motion.pitch, motion.q
    turn = np.tan(pitch) * (q * np.sin(roll) + r * np.cos(roll))
    force = np.cos(pitch) * np.sin(roll)
    force += motion.airspeed_m_s / GRAVITY * np.tan(pitch) / np.cos(roll) * p
    z = np.stack([p, r, roll, aileron, force, turn])
    n, Ts = z.shape[1], motion.sample_time_s
    taper = 0.5 - 0.5 * np.cos(math.tau * (np.arange(n) + 0.5) / n)
    tapered = (z - (z @ taper)[:, None] / taper.sum()) * taper
    F = np.fft.rfft(tapered, axis=1) * math.sqrt(Ts / (taper @ taper))
    w = np.arange(F.shape[1]) * math.tau / (n * Ts)
    at = np.searchsorted(EDGES, w) - 1
    inside = (at >= 0) & (at < BINS) & (w < USABLE * math.pi / Ts)
    at, w, F = at[inside], w[inside], F[:, inside]
    Z = np.zeros((BINS, 6, 6), complex)
    np.add.at(Z, at, np.einsum("ik,jk->kij", F, F.conj()))
    return Sums(
        np.bincount(at, w, BINS).astype(np.float64),
        np.bincount(at, minlength=BINS).astype(np.float64), Z,
        law_sums(aileron, roll, p, Ts), new_s, new_s * motion.airspeed_m_s,
        new_s * float(pitch.mean()), turns, 1,
    )  # fmt: skip


def spectra(sums: Sums, low: float, high: float, joined: int = 1) -> tuple[Floats, Floats, Complex]:
    """Return frequencies w (b,), counts n (b,) and Z (b, 6, 6) from ``low`` to ``high`` rad/s.

    ``joined`` bins are one. Z is of [p, r, roll, da, f1, f2], where f1 = f - cos(pitch0) roll -
    V / g tan(pitch0) p and f2 = g - tan(pitch0) r are what a bank adds to linear motion.
    """
    pitch, T = sums.pitch / sums.seconds, np.eye(6)
    T[FORCE, P] = -sums.speed / sums.seconds / GRAVITY * math.tan(pitch)
    T[FORCE, ROLL], T[TURN, R] = -math.cos(pitch), -math.tan(pitch)
    rows = np.flatnonzero((EDGES[:-1] >= low) & (EDGES[1:] <= high) & (sums.n > 0.0))
    if not len(rows):
        return np.zeros(0), np.zeros(0), np.zeros((0, 6, 6), complex)
    starts = np.arange(0, len(rows), joined)
    w, n, Z = (np.add.reduceat(x[rows], starts, axis=0) for x in (sums.w, sums.n, sums.Z))
    return w / n, INDEPENDENT * n, np.asarray(INDEPENDENT * (T @ Z @ T.T), complex)
