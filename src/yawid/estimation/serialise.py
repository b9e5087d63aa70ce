"""An estimator as bytes: a line of JSON with version and configuration, then the packed state."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.errors import ConfigError
from yawid.estimation.kernel.new_state import new_state

VERSION = "yawid-armax-2"
"""Changes whenever the meaning or place of anything in the state does."""


def pack(config: EstimatorConfig, state: Floats) -> bytes:
    """Return version, configuration and packed state (slots,) as bytes."""
    head = json.dumps({"version": VERSION, "config": asdict(config)})
    return head.encode() + b"\n" + state.astype("<f8").tobytes()


def unpack(saved: bytes) -> tuple[EstimatorConfig, Floats]:
    """Return the configuration and the state (slots,) that :func:`pack` saved.

    Raises:
        ConfigError: not a whole save, or one of another version.
    """
    head, _, body = bytes(saved).partition(b"\n")
    try:
        record: dict[str, Any] = json.loads(head)
        version, values = record["version"], record["config"]
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError("these bytes are no saved estimator") from error
    if version != VERSION:
        raise ConfigError(f"saved as {version!r}, this is {VERSION!r}: it cannot be resumed")
    orders: dict[str, Any] = values["orders"]
    drift = values["drift"]
    values |= {
        "orders": ArmaxOrders(**orders),
        "drift": tuple(drift) if isinstance(drift, list) else drift,
    }
    config = EstimatorConfig(**values)
    length = 8 * len(new_state(config))
    if len(body) != length:
        raise ConfigError(f"the saved state has {len(body)} bytes, {length} are expected")
    return config, np.frombuffer(body, "<f8").astype(np.float64)
