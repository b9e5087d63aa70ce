"""Yawid identifies how an aircraft's yaw answers its rudder, sample by sample."""

import importlib
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "ArmaxOrders": "yawid.config.estimator",
    "EstimatorConfig": "yawid.config.estimator",
    "forgetting_factor": "yawid.config.estimator",
    "RecursiveArmax": "yawid.estimation.armax",
    "Estimate": "yawid.estimation.armax",
    "parameter_names": "yawid.estimation.polynomials",
    "make_estimator": "yawid.estimation.reference.estimator",
    "EstimateBlock": "yawid.blocks",
    "Status": "yawid.blocks",
    "YawidError": "yawid.errors",
    "ConfigError": "yawid.errors",
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: ``import yawid`` itself stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'yawid' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
