"""Build the packed state of a configuration; the slots and parts are named in ``state.py``."""

from __future__ import annotations

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.kernel import state as slots

WARM_UPDATES_PER_PARAMETER = 10
D_CAP = 1e6
"""D of P = U D U' grows by forgetting no further than this, or P0 where that is larger."""


def lag_depth(config: EstimatorConfig) -> int:
    """Return the number of earlier samples of y and u that phi(k) needs."""
    orders = config.orders
    inputs = [nb + nk - 1 for nb, nk in zip(orders.nb, orders.nk, strict=True) if nb > 0]
    return max([0, orders.na, *inputs])


def registers(config: EstimatorConfig) -> tuple[list[int], list[int]]:
    """Return where each signal's register begins, and the end (M + 4), and each phi entry's place.

    The signals are y, the inputs, the residual and the bias's 1; the newest entry comes first. When
    phi(k) is formed that is y(k-1), u(k), eps(k-1).
    """
    orders = config.orders
    rows = [(0, orders.na)]
    rows += [(nk, nb) for nb, nk in zip(orders.nb, orders.nk, strict=True)]
    rows += [(0, orders.nc), (0, int(config.bias))]
    heads, taps = [0], list[int]()
    for first, count in rows:
        taps += range(heads[-1] + first, heads[-1] + first + count)
        # 1/C needs nc lags of each.
        heads.append(heads[-1] + (max(first + count, orders.nc) if count else 0))
    return heads, taps


def new_state(config: EstimatorConfig) -> Floats:
    """Return the packed state of an estimator that has seen nothing."""
    orders, n, lags = config.orders, config.n_theta, config.residual_lags
    window = max(config.scale_window, config.start_buffer)
    heads, taps = registers(config)
    size = heads[-1] + max(1, orders.nc)  # a spare for signals without a register
    covariance = n * n + n + 2 * lags + 1 if lags else 0
    length = slots.HEADER + 9 * n + n * (n - 1) // 2 + 2 * size + covariance
    length += max(n, orders.n_inputs + 3) + len(heads) + len(heads) - 1 + n
    length += orders.nc + 2 * orders.n_inputs + 1 + (orders.n_inputs + 2) * window
    state = np.zeros(length)
    header = {
        slots.N: n, slots.NA: orders.na, slots.NC: orders.nc, slots.M: orders.n_inputs,
        slots.R: size, slots.LAGS: lags, slots.WINDOW: window, slots.DEPTH: lag_depth(config),
        slots.BIAS: config.bias, slots.RML: config.method == "rml",
        slots.SCALED: config.scale_window > 0, slots.START_FIT: config.start_buffer > 0,
        slots.MINIMUM: config.scale_minimum, slots.DRIFTS: config.drift != 0.0,
        slots.P0: config.P0, slots.D_MAX: max(D_CAP, config.P0),
        slots.WARM: WARM_UPDATES_PER_PARAMETER * n,
        slots.LAMBDA_START: config.forgetting_start, slots.LAMBDA_END: config.forgetting_factor,
        slots.LAMBDA_RATE: config.forgetting_rate, slots.FLOOR: config.information_floor,
        slots.LAMBDA: config.forgetting_start,
        slots.PHASE: slots.GATHERING if window else slots.RUNNING, slots.BROKEN: 1.0,
    }  # fmt: skip
    for slot, value in header.items():
        state[slot] = float(value)  # type: ignore[arg-type]  # the config has filled its None
    parts = slots.views(state)
    parts[slots.D][:] = config.P0
    if lags:
        parts[slots.COVARIANCE][:: n + 1] = config.P0
    parts[slots.HEADS].view(np.uint64)[:] = heads
    parts[slots.TAPS].view(np.uint64)[:] = taps
    parts[slots.FACTORS][:] = 1.0
    parts[slots.UNITS][:] = 1.0
    parts[slots.LEAST][:] = config.P0
    parts[slots.BEST][:] = config.P0
    parts[slots.DRIFT][:] = np.multiply(config.drift, config.sample_time_s)
    return state
