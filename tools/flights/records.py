"""Records in memory of linear aircraft, exact for a rudder that is held from sample to sample.

A ``Leg`` is eq. 23 and nothing else. A release is the classic flight test, a doublet of the rudder
with hands off after it, of an aircraft that is drawn by a seed: eq. 22, or all four lateral states,

    beta' = Y_beta beta - r + g/V roll           p' = L_beta beta + L_p p + L_r r + L_delta_r u
    roll' = p                                    r' = N_beta beta + N_p p + N_r r + N_delta_r u
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.signal import lsim

Floats = NDArray[np.float64]
HZ = 20
SAID: dict[str, Any] = {"rudder_unit": "half-travel", "rudder_is": "commanded", "units": "rad"}
"""What ``yawid.replay`` must be given with such a record."""
REST_S, GRAVITY = 10.0, 9.80665


def states(A: Floats, B: Floats, rudder: Floats, hz: float) -> Floats:
    """Return the states (n, order) of x' = A x + B u from 0 for a rudder (n,) that is held."""
    plant = A, B[:, None], np.eye(len(A)), np.zeros((len(A), 1))
    return np.asarray(lsim(plant, rudder, np.arange(len(rudder)) / hz, interp=False)[2])


@dataclass(frozen=True)
class Leg:
    """Ten seconds of rest, a doublet of ``unit_s`` each way, and rest to the end of ``seconds``.

    The yaw rate is K (T s + 1) wn^2 / (s^2 + 2 zeta wn s + wn^2) of the rudder, K .3 and T .9.
    """

    zeta: float = 0.2
    wn: float = 6.0
    mode: str = "MANUAL"
    unit_s: float = 0.4
    seconds: float = 25.0
    noise: float = 0.001
    stroke: float = 0.3

    def rudder(self, hz: int = HZ) -> Floats:
        """Return the rudder (n,) in half travels."""
        since_s = np.arange(round(hz * self.seconds)) / hz - REST_S
        edges = [since_s < 0.0, since_s < self.unit_s, since_s < 2.0 * self.unit_s]
        return self.stroke * np.select(edges, [0.0, 1.0, -1.0], 0.0)

    def yaw_rate(self, rudder: Floats, hz: int = HZ) -> Floats:
        """Return the yaw rate (n,) in rad/s, without noise."""
        K, T, wn = 0.3, 0.9, self.wn
        transfer = [K * wn**2 * T, K * wn**2], [1.0, 2.0 * self.zeta * wn, wn**2]
        return np.asarray(lsim(transfer, rudder, np.arange(len(rudder)) / hz, interp=False)[1])


def record(legs: Sequence[Leg], *, hz: int = HZ, seed: int = 1, **columns: Any) -> dict[str, Any]:
    """Return the legs one after the other as the columns of a record, with more ``columns``."""
    rng = np.random.default_rng(seed)
    rudders = [leg.rudder(hz) for leg in legs]
    flown = [
        leg.yaw_rate(u, hz) + leg.noise * rng.standard_normal(len(u))
        for leg, u in zip(legs, rudders, strict=True)
    ]
    rudder = np.concatenate(rudders)
    return {
        "t": np.arange(len(rudder)) / hz,
        "rudder": rudder,
        "r": np.concatenate(flown),
        "airspeed": np.full(len(rudder), 20.0),
        "mode": np.repeat([leg.mode for leg in legs], [len(u) for u in rudders]),
    } | columns


def release(seed: int, number: int, hz: int, *, rolls: bool) -> tuple[dict[str, Any], Leg]:
    """Return the record of release ``number`` at a rate, and its leg, which has wn and zeta.

    With ``rolls`` it has the columns p and roll, too; else the aircraft is eq. 22 alone. But for
    its noise, a share of a channel's peak, a number is the same flight at each rate. Hands are off
    for 5 to 20 s, and for a period and a half at least: with the doublet's one period a release of
    any wn has two and a half.
    """
    rng = np.random.default_rng([seed, number])
    wn, zeta = float(np.exp(rng.uniform(*np.log((0.5, 6.0))))), float(rng.uniform(0.02, 0.15))
    period_s = 2.0 * np.pi / wn
    decay_s = rng.uniform(max(5.0, 1.5 * period_s), 20.0)
    leg = Leg(zeta, wn, unit_s=period_s / 2.0, seconds=REST_S + period_s + decay_s,
              noise=rng.uniform(0.003, 0.03), stroke=rng.uniform(0.1, 0.3))  # fmt: skip
    airspeed_m_s = 60.0 * wn**-0.6
    A, B = drawn_airframe(rng, wn, zeta, GRAVITY / airspeed_m_s, rolls=rolls)
    rudder = leg.rudder(hz)
    flown = states(A, B, rudder, hz)
    flown += leg.noise * np.abs(flown).max(axis=0) * rng.standard_normal(flown.shape)
    seen = dict(zip(("p", "r", "roll"), flown.T[1:], strict=True)) if rolls else {"r": flown[:, 2]}
    return {
        "t": np.arange(len(rudder)) / hz, "rudder": rudder, "mode": ["MANUAL"] * len(rudder),
        "airspeed": np.full(len(rudder), airspeed_m_s),
    } | seen, leg  # fmt: skip


def drawn_airframe(
    rng: np.random.Generator, wn: float, zeta: float, sink: float, *, rolls: bool
) -> tuple[Floats, Floats]:
    """Return A (4, 4) and B (4,) of beta, p, r, roll with a Dutch roll of this wn and zeta.

    N_beta and N_r are those that make it one: the other rows give the shape of its motion.
    ``sink`` is g/V in 1/s. Without ``rolls`` nothing moves p.
    """
    s = wn * complex(-zeta, np.sqrt(1.0 - zeta**2))
    while True:
        side, roll = -wn * rng.uniform(0.01, 0.1), -wn * rng.uniform(0.8, 3.0)
        A = np.array([
            [side, 0.0, -1.0, sink],
            [-(wn**2) * rng.uniform(0.3, 2.5) * rolls, roll, wn * rng.uniform(0.1, 0.8) * rolls, 0],
            [0.0, wn * rng.uniform(-0.15, 0.03) * rolls, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
        ])  # fmt: skip
        yaw = wn**2 * rng.uniform(0.08, 0.25)
        B = np.array([0.0, -yaw * rng.uniform(-0.1, 0.4) * rolls, yaw, 0.0])
        shape = null_space(np.delete(s * np.eye(4) - A, 2, axis=0))[:, 0]
        moment = s * shape[2] - A[2] @ shape  # which N_beta and N_r have to make
        by = shape[[0, 2]]
        A[2, [0, 2]] = np.linalg.solve([by.real, by.imag], [moment.real, moment.imag])
        slow = np.sort(np.linalg.eigvals(A).real)[-1]
        if A[2, 0] > 0.0 and A[2, 2] < 0.0 and slow < 0.02 * wn:
            return A, B
