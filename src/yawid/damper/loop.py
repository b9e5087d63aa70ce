"""The damper's loop in continuous time: its margins, its Dutch roll, its response to a rudder.

With G from rudder to yaw rate (without the damper: see the manual) and the damper K, the open loop
is L(s) = K(s) G(s), and margins come from L(jw), with the exact delay. The closed poles are the
eigenvalues of G's and K's states, K's delay being Pade's of order 2: with G as poles p and residues
R, K as (A, B, C, D), and u = -K r,

    x' = diag(p) x - 1 (D R x + C k),    k' = A k + B R x.

The Dutch roll is followed from gain 0, as the eigenvalue nearest to where it was going.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from yawid.blocks import Bools, Floats
from yawid.damper.autopilots import Law
from yawid.physics.continuous import Transfer, settling_of
from yawid.physics.modes import Complexes

REAL: Final = 1e-3
"""A pair whose imaginary part is less than this share of |s| has become two real poles."""
LOWEST, HIGHEST_OF_WN, HIGHEST_OF_RATE = 0.1, 3.0, 0.2
"""Where G is known: from this part of wn to this multiple of wn, and to this part of the rate."""
POINTS: Final = 300
NEAR: Final = 1e-4
"""The step of a slope, as a part of |s|."""
FINER: Final = 8
"""The steps of a sample in a response: the rudder is held over each sample."""


def closed_dutch_roll(G: Transfer, law: Law, gains: Floats) -> Complexes:  # noqa: N803  as in text
    """Return the closed loop's Dutch roll (m, n) in rad/s for gains (m,), ascending from 0 on.

    It is the pole that begins at the open Dutch roll; NaN from where it becomes two real poles.
    """
    s: Complexes = G.dutch_roll
    found = np.full((len(gains), len(G)), np.nan, complex)
    move, lost, each = np.zeros(len(G), complex), ~np.isfinite(s), np.arange(len(G))
    for row, gain in enumerate(gains.tolist()):
        poles = _closed_poles(G, law, gain)
        nearest = np.argmin(np.abs(poles - (s + move)[:, None]), axis=1)
        before, s = s, poles[each, nearest]
        move = s - before
        lost |= ~(s.imag > REAL * np.abs(s))
        found[row] = np.where(lost, np.nan, s)
    return found


def _closed_poles(G: Transfer, law: Law, gain: float) -> Complexes:  # noqa: N803
    """Return all poles (n, k) of the closed loop."""
    A, B, C, D = law.states(gain)  # noqa: N806
    m, q = G.poles.shape[1], len(A)
    closed = np.zeros((len(G), m + q, m + q), complex)
    closed[:, :m, :m] = np.eye(m) * G.poles[:, None] - D * G.residues[:, None]
    closed[:, :m, m:] = -C
    closed[:, m:, :m] = B[:, None] * G.residues[:, None]
    closed[:, m:, m:] = A
    return np.asarray(np.linalg.eigvals(closed), np.complex128)


def settling_times(G: Transfer, law: Law, gains: Floats, poles: Complexes) -> Floats:  # noqa: N803
    """Return when (m, n) the damped swing after a step of the pilot's rudder has settled, in s.

    ``poles`` (m, n) are the closed Dutch rolls of gains (m,); the residue of G / (1 + K G) at such
    a pole is one over the slope of 1 / G + K.
    """
    near = poles[:, :, None] * np.array([1.0 - NEAR, 1.0 + NEAR])
    with np.errstate(invalid="ignore"):  # NaN where there is no pair
        inverse = [1.0 / G.at(x) + law.at(x, gain) for x, gain in zip(near, gains, strict=True)]
        return settling_of(poles, 2.0 * NEAR * poles / np.diff(np.stack(inverse))[:, :, 0])


def known_frequencies(wn_rad_s: float, sample_time_s: float) -> Floats:
    """Return the frequencies (k,) in rad/s over which G is known."""
    highest = min(HIGHEST_OF_WN * wn_rad_s, HIGHEST_OF_RATE * 2.0 * np.pi / sample_time_s)
    return np.geomspace(LOWEST * wn_rad_s, max(highest, 1.2 * wn_rad_s), POINTS)


def margins(
    G: Transfer,  # noqa: N803
    law: Law,
    gains: Floats,
    w: Floats,
) -> tuple[Floats, Floats, Bools]:
    """Return the phase margin in degrees, the gain margin in dB, and where both are unknown.

    Each is (m, n) for gains (m,) and n models, infinite where nothing crosses at the frequencies w
    (k,) in rad/s. The phase margin is the least over all at which |L| = 1, on both sides of the
    mode; the gain margin the least over those at which L is negative. Both are unknown where |L| is
    still above 1 at the highest frequency where G is known.

    The angle of L is continuous, and nearest to 0 at the mode: where |L| is 1 the loop is stable as
    long as it lies between -180 and 180 degrees. At the lowest frequency it is not known: the sign
    of the gain there is that of a zero near 0, which no doublet shows.
    """
    s: Complexes = (1j * w).astype(np.complex128)
    aircraft = G.at(s)
    shape, each = (len(gains), len(G)), np.arange(len(G))
    mode = np.argmin(np.abs(w - np.abs(G.dutch_roll)[:, None]), axis=1)
    phase, gain_db, beyond = np.full(shape, np.inf), np.full(shape, np.inf), np.zeros(shape, bool)
    for row, gain in enumerate(gains.tolist()):
        L = law.at(s, gain) * aircraft  # noqa: N806
        if not (L != 0.0).any():
            continue
        over, angle = np.log(np.abs(L)), np.unwrap(np.angle(L), axis=1)
        angle -= 2.0 * np.pi * np.round(angle[each, mode] / (2.0 * np.pi))[:, None]
        left = 180.0 - np.abs(np.degrees(_where(over, angle)))
        phase[row] = np.fmin.reduce(left, axis=1, initial=np.inf)
        is_negative = _where(np.sin(angle), np.cos(angle)) < 0.0
        largest = np.where(is_negative, _where(np.sin(angle), over), -np.inf).max(axis=1)
        gain_db[row], beyond[row] = -20.0 / np.log(10.0) * largest, over[:, -1] > 0.0
    return phase, gain_db, beyond


def _where(level: Floats, other: Floats) -> Floats:
    """Return ``other`` (n, k) where ``level`` (n, k) passes 0, between k points; NaN elsewhere."""
    before, after = level[:, :-1], level[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        found = other[:, :-1] + before / (before - after) * np.diff(other, axis=1)
    return np.where((before > 0.0) != (after > 0.0), found, np.nan)


def through(x: Floats, step_s: float, response: Callable[[Complexes], Complexes]) -> Floats:
    """Return x (n,) after a linear system, from rest; by its response, whose delays are exact."""
    n = 1 << int(np.ceil(np.log2(4 * len(x))))
    s = (2j * np.pi * np.fft.rfftfreq(n, step_s)).astype(np.complex128)
    s[0] = 1e-6j
    return np.asarray(np.fft.irfft(np.fft.rfft(x, n) * response(s), n)[: len(x)])


def closed_response(
    G: Transfer,  # noqa: N803
    law: Law,
    gain: float | None,
    u: Floats,
    sample_time_s: float,
) -> Floats:
    """Return the yaw rate (n,) in rad/s of G / (1 + K G) for the rudder u (n,), from rest.

    Without a ``gain`` it is that of G alone. It is valid only where the loop is stable.
    """
    step = sample_time_s / FINER

    def response(s: Complexes) -> Complexes:
        aircraft = G.at(s)[0]
        loop = 0.0 if gain is None else law.at(s, gain) * aircraft
        held = -np.expm1(-s * step) / (s * step)
        return np.asarray(held * aircraft / (1.0 + loop))

    return through(np.repeat(u, FINER), step, response)[::FINER]


def pilots_rudder(law: Law, gain: float, u: Floats, error: Floats, sample_time_s: float) -> Floats:
    """Return the rudder (n,) that the pilot moved, less its rest, from the servo's output u (n,).

    The output holds the damper's part, so the pilot's is what is left of it, u + K e: ``error``
    (n,) is what the damper feeds back, in rad/s. u is the mean over the sample that follows, and so
    is the damper's part.
    """

    def fed_back(s: Complexes) -> Complexes:
        mean = np.expm1(s * sample_time_s) / (s * sample_time_s)
        return np.asarray(law.at(s, gain) * mean)

    v = u + through(error - np.median(error), sample_time_s, fed_back)
    return v - np.median(v)
