"""The damper's loop in continuous time: margins of the open loop, and the closed Dutch roll.

With G from rudder to yaw rate (without the damper: see the manual) and the damper K, the open loop
is L(s) = K(s) G(s), and margins come from L(jw), with the exact delay. The closed poles are the
eigenvalues of G's and K's states, K's delay being Pade's of order 2: with G as poles p and residues
R, K as (A, B, C, D), and u = -K r,

    x' = diag(p) x - 1 (D R x + C k),    k' = A k + B R x.

The Dutch roll is followed from gain 0, as the eigenvalue nearest to where it was going.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from yawid.blocks import Bools, Floats
from yawid.damper.autopilots import Law
from yawid.physics.continuous import Transfer
from yawid.physics.modes import Complexes

STEPS: Final = 2
"""The steps of the gain from one row to the next, in which the pole is followed."""
REAL: Final = 1e-3
"""A pair whose imaginary part is less than this share of |s| has become two real poles."""
LOWEST, HIGHEST_OF_WN, HIGHEST_OF_RATE = 0.1, 3.0, 0.2
"""Where G is known: from this part of wn to this multiple of wn, and to this part of the rate."""
POINTS: Final = 300


def closed_dutch_roll(G: Transfer, law: Law, gains: Floats) -> Complexes:  # noqa: N803  as in text
    """Return the closed loop's Dutch roll (m, n) in rad/s for gains (m,), ascending from 0 on.

    It is the pole that begins at the open Dutch roll; NaN from where it becomes two real poles.
    """
    s: Complexes = G.dutch_roll
    found = np.full((len(gains), len(G)), np.nan, complex)
    move, last, lost = np.zeros(len(G), complex), 0.0, ~np.isfinite(s)
    each = np.arange(len(G))
    for row, gain in enumerate(gains.tolist()):
        for part in np.arange(1, STEPS + 1) / STEPS:
            # Before the first gain there is no damper at all, without its fixed integrator.
            here = law if row else replace(law, scaling=law.scaling * part)
            poles = _closed_poles(G, here, last + part * (gain - last) if row else gain)
            nearest = np.argmin(np.abs(poles - (s + move)[:, None]), axis=1)
            before, s = s, poles[each, nearest]
            move = s - before
            lost |= ~(s.imag > REAL * np.abs(s))
        last, found[row] = gain, np.where(lost, np.nan, s)
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


@dataclass(frozen=True, slots=True)
class Margins:
    """The open loop's margins (m, n) for m gains and n models, infinite where nothing crosses.

    ``phase_deg`` is the least over all frequencies at which |L| = 1, on both sides of the mode;
    ``gain_db`` the least over those at which L is negative. ``beyond`` (m, n) says that |L| is
    still above 1 at the highest frequency where G is known: then both are unknown.
    """

    phase_deg: Floats
    gain_db: Floats
    beyond: Bools


def known_frequencies(wn_rad_s: float, sample_time_s: float) -> Floats:
    """Return the frequencies (k,) in rad/s over which G is known."""
    highest = min(HIGHEST_OF_WN * wn_rad_s, HIGHEST_OF_RATE * 2.0 * np.pi / sample_time_s)
    return np.geomspace(LOWEST * wn_rad_s, max(highest, 1.2 * wn_rad_s), POINTS)


def margins(G: Transfer, law: Law, gains: Floats, w: Floats) -> Margins:  # noqa: N803
    """Return the margins for gains (m,) over the frequencies w (k,) in rad/s."""
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
        phase[row], gain_db[row] = _phase_margin(over, angle), _gain_margin(over, angle)
        beyond[row] = over[:, -1] > 0.0
    return Margins(phase, gain_db, beyond)


def _phase_margin(over: Floats, angle: Floats) -> Floats:
    """Return the least phase margin (n,) in degrees; ``over`` is ln |L|, both (n, k).

    ``angle`` is continuous, and nearest to 0 at the mode: where |L| is 1 the loop is stable as long
    as it lies between -180 and 180 degrees. At the lowest frequency it is not known: the sign of
    the gain there is that of a zero near 0, which no doublet shows.
    """
    crosses = (over[:, :-1] > 0.0) != (over[:, 1:] > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(crosses, over[:, :-1] / (over[:, :-1] - over[:, 1:]), 0.0)
    at = angle[:, :-1] + part * np.diff(angle, axis=1)
    margin = 180.0 - np.abs(np.degrees(at))
    return np.asarray(np.min(np.where(crosses, margin, np.inf), axis=1))


def _gain_margin(over: Floats, angle: Floats) -> Floats:
    """Return the least gain margin (n,) in dB, at the frequencies where L is negative."""
    turns = np.floor((angle - np.pi) / (2.0 * np.pi))
    crosses = turns[:, :-1] != turns[:, 1:]
    goal = (np.maximum(turns[:, :-1], turns[:, 1:]) * 2.0 + 1.0) * np.pi
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(crosses, (goal - angle[:, :-1]) / np.diff(angle, axis=1), 0.0)
    at = over[:, :-1] + part * np.diff(over, axis=1)
    return np.asarray(-20.0 / np.log(10.0) * np.max(np.where(crosses, at, -np.inf), axis=1))
