"""Records of an aircraft whose yaw answers its rudder by eq. 23 and nothing else, in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

Floats = NDArray[np.float64]
HZ = 20
SAID: dict[str, Any] = {"rudder_unit": "half-travel", "rudder_is": "commanded", "units": "rad"}
"""What ``yawid.replay`` must be told of such a record."""


@dataclass(frozen=True)
class Leg:
    """Ten seconds of rest, a doublet of ``unit_s`` each way, and rest to the end of ``seconds``.

    The yaw rate is K (T s + 1) wn^2 / (s^2 + 2 zeta wn s + wn^2) of the rudder, held over samples.
    """

    zeta: float = 0.2
    wn: float = 6.0
    mode: str = "MANUAL"
    unit_s: float = 0.4
    seconds: float = 25.0
    noise: float = 0.001
    stroke: float = 0.3

    def rudder(self, hz: int = HZ) -> Floats:
        since_s = np.arange(round(hz * self.seconds)) / hz - 10.0
        edges = [since_s < 0.0, since_s < self.unit_s, since_s < 2.0 * self.unit_s]
        return self.stroke * np.select(edges, [0.0, 1.0, -1.0], 0.0)

    def yaw_rate(self, rudder: Floats, hz: int = HZ) -> Floats:
        square = self.wn**2
        plant = [0.3 * square * 0.9, 0.3 * square], [1.0, 2.0 * self.zeta * self.wn, square]
        b, a, _ = cont2discrete(plant, 1.0 / hz, method="zoh")
        return np.asarray(lfilter(b[0], a, rudder))


def record(legs: Sequence[Leg], *, hz: int = HZ, seed: int = 1, **columns: Any) -> dict[str, Any]:
    """Return the legs one after the other as the columns of a record, with more ``columns``."""
    rng = np.random.default_rng(seed)
    rudders = [leg.rudder(hz) for leg in legs]
    flown = [
        leg.yaw_rate(u, hz) + leg.noise * rng.standard_normal(len(u))
        for leg, u in zip(legs, rudders, strict=True)
    ]
    rudder = np.concatenate(rudders)
    found = {
        "t": np.arange(len(rudder)) / hz,
        "rudder": rudder,
        "r": np.concatenate(flown),
        "airspeed": np.full(len(rudder), 20.0),
        "mode": np.repeat([leg.mode for leg in legs], [len(u) for u in rudders]),
    }
    return found | columns
