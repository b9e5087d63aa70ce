"""Plants and configurations that several estimator tests share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from yawid import ArmaxOrders, EstimatorConfig

Floats = NDArray[np.float64]

S1 = ((-1.5, 0.7), (1.0, 0.5), (-1.0, 0.2))
S2 = ((0.9, 0.95), (1.0,), (1.5, 0.75))
S3 = ((-0.8, 0.15), (1.0, 0.5), (0.5, 0.1))
Plant = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


def truth(plant: Plant) -> Floats:
    return np.concatenate([np.array(part) for part in plant])


def simulate(plant: Plant, n: int, seed: int, noise: float = 1.0) -> tuple[Floats, Floats]:
    """u and y (n,): A y = B u + C e with B from q^-1, u and e white of unit variance."""
    a, b, c = plant
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    poles = (1.0, *a)
    return u, lfilter((0.0, *b), poles, u) + noise * lfilter((1.0, *c), poles, e)


def config(orders: ArmaxOrders | None = None, **options: Any) -> EstimatorConfig:
    return EstimatorConfig(orders=orders or ArmaxOrders(2, 2, 2, 1), sample_time_s=0.05, **options)
