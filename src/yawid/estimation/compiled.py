"""The compiled code of the estimators: whether it was left behind, and how to have it made."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.kernel.entry_points import read, run
from yawid.estimation.kernel.linear_algebra import add_products, over_a, settings
from yawid.estimation.record_fit import fit_record

_ENTRIES: tuple[Any, ...] = (run, read, over_a, add_products)
_SAMPLES = 300  # more than the scale window


@dataclass(frozen=True, slots=True)
class Compiled:
    """How many functions were found compiled and how many were compiled; no folder: not kept."""

    found: int
    made: int
    folder: Path | None


def is_switched_off() -> bool:
    """Tell whether NUMBA_DISABLE_JIT has the estimators run as plain Python."""
    return bool(settings.DISABLE_JIT)


def compiled_before() -> bool:
    """Tell whether an earlier process has left compiled code: without, the first estimate waits."""
    if is_switched_off():
        return True
    folder = run.stats.cache_path
    # numba writes a function's index when its code is there, under its name, line and Python.
    mine = f"entry_points.run-*.py{sys.version_info.major}{sys.version_info.minor}.nbi"
    return folder is not None and any(Path(folder).glob(mine))


def compile_all() -> Compiled:
    """Run made-up samples through all that is compiled, and say what had to be compiled for it."""
    u, y = np.random.default_rng(0).standard_normal((2, _SAMPLES))
    config = EstimatorConfig(orders=ArmaxOrders(2, (2,), 2, (1,)), sample_time_s=0.05, method="rml")
    RecursiveArmax(config).run(u, y)
    fit_record(config, u[:, None], y)
    if is_switched_off():
        return Compiled(0, 0, None)
    stats = [function.stats for function in _ENTRIES]
    found = sum(bool(each.cache_hits) for each in stats)
    made = sum(bool(each.cache_misses) for each in stats)
    folder = stats[0].cache_path
    return Compiled(found, made, None if folder is None else Path(folder))
