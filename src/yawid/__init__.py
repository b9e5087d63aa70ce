"""Yawid identifies how an aircraft's yaw answers its rudder, sample by sample.

``replay`` makes a run of a log or of a table in memory, ``load`` reads that of an MCAP, and
``diff`` compares two. A :class:`Run` has the answer (``usable``, ``flight``), its tables and its
models. :class:`RecursiveArmax` is the estimator by itself. Errors are :class:`YawidError`.
"""

import importlib
from typing import TYPE_CHECKING, Any

from yawid.version import __version__ as __version__

if TYPE_CHECKING:  # without ArmaxOrders and EstimatorConfig, which accept more than their types
    from yawid.blocks import EstimateBlock as EstimateBlock
    from yawid.blocks import Status as Status
    from yawid.config.estimator import forgetting_factor as forgetting_factor
    from yawid.errors import ConfigError as ConfigError
    from yawid.errors import YawidError as YawidError
    from yawid.estimation.armax import Estimate as Estimate
    from yawid.estimation.armax import RecursiveArmax as RecursiveArmax
    from yawid.estimation.polynomials import parameter_names as parameter_names
    from yawid.estimation.reference import make_estimator as make_estimator
    from yawid.tables.replay import replay as replay
    from yawid.tables.run import Run as Run
    from yawid.tables.run import load as load
    from yawid.tables.table import Table as Table
    from yawid.trend.in_python import diff as diff

_HOMES = {
    "ArmaxOrders": "yawid.config.estimator",
    "EstimatorConfig": "yawid.config.estimator",
    "forgetting_factor": "yawid.config.estimator",
    "RecursiveArmax": "yawid.estimation.armax",
    "Estimate": "yawid.estimation.armax",
    "parameter_names": "yawid.estimation.polynomials",
    "make_estimator": "yawid.estimation.reference",
    "EstimateBlock": "yawid.blocks",
    "Status": "yawid.blocks",
    "YawidError": "yawid.errors",
    "ConfigError": "yawid.errors",
    "Run": "yawid.tables.run",
    "Table": "yawid.tables.table",
    "diff": "yawid.trend.in_python",
    "load": "yawid.tables.run",
    "replay": "yawid.tables.replay",
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    """Import a public name at its first use, so that ``import yawid`` itself stays fast."""
    if name not in _HOMES:
        raise AttributeError(f"module 'yawid' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
