"""What the first sample of a process would wait for, done before the socket opens."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from yawid.blocks import SampleBlock
from yawid.estimation.bank import Bank
from yawid.physics.modes import modes
from yawid.run_config import RunConfig

_SAMPLES = 300  # more than the scale window: every branch of the kernel has been loaded then
_SAMPLE_TIME_S = 0.05


def warm_up(config: RunConfig) -> None:
    """Run made-up samples through estimators of this configuration and throw the result away."""
    rng = np.random.default_rng(0)
    inputs = len(config.inputs)
    columns: dict[str, Any] = {
        field.name: np.zeros(_SAMPLES, np.int64 if "Ints" in str(field.type) else np.float64)
        for field in fields(SampleBlock)
        if field.name not in ("sample_time_s", "u")
    }
    columns["y"] = rng.standard_normal(_SAMPLES)
    u = rng.standard_normal((_SAMPLES, inputs))
    samples = SampleBlock(sample_time_s=_SAMPLE_TIME_S, u=u, **columns)
    estimates = Bank(config, _SAMPLE_TIME_S).run(samples)
    modes(estimates[config.method], config.armax_orders(), _SAMPLE_TIME_S)
