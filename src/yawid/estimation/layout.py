"""Build the packed state of a configuration; the slots and parts are named in ``state.py``."""

from __future__ import annotations

import numpy as np

from yawid.blocks import Floats
from yawid.config import EstimatorConfig
from yawid.estimation import state as slots

WARM_UPDATES_PER_PARAMETER = 10
D_CAP = 1e6
"""D of P = U D U' grows by forgetting no further than this, or P0 where that is larger."""


def lag_depth(config: EstimatorConfig) -> int:
    """Return the number of earlier samples of y and u that phi(k) needs."""
    orders = config.orders
    inputs = [nb + nk - 1 for nb, nk in zip(orders.nb, orders.nk, strict=True) if nb > 0]
    return max([0, orders.na, *inputs])


def registers(config: EstimatorConfig) -> tuple[Floats, list[int]]:
    """Return offset and length of each signal's register (M + 3, 2), and each phi entry's place.

    The signals are y, the inputs, the residual and the bias's 1; the newest entry comes first. When
    phi(k) is formed that is y(k-1), u(k), eps(k-1).
    """
    orders = config.orders
    rows = [(0, orders.na)]
    rows += [(nk, nb) for nb, nk in zip(orders.nb, orders.nk, strict=True)]
    rows += [(0, orders.nc), (0, int(config.bias))]
    table, taps, offset = np.zeros((len(rows), 2)), list[int](), 0
    for row, (first, count) in zip(table, rows, strict=True):
        length = max(first + count, orders.nc) if count else 0  # 1/C needs nc lags of each
        row[:] = offset, length
        taps += range(offset + first, offset + first + count)
        offset += length
    return table, taps


def new_state(config: EstimatorConfig) -> Floats:
    """Return the packed state of an estimator that has seen nothing."""
    orders, n, lags = config.orders, config.n_theta, config.residual_lags
    window = max(config.scale_window, config.start_buffer)
    table, taps = registers(config)
    size = int(table[:, 1].sum())
    covariance = n * n + n + 2 * lags + 1 if lags else 0
    length = slots.HEADER + 8 * n + n * (n - 1) // 2 + n + 2 * size + covariance
    length += table.size + len(table) + n + 2 * orders.n_inputs + 1 + (orders.n_inputs + 2) * window
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
    parts[slots.SIGNALS][:] = table.ravel()
    parts[slots.TAPS][:] = taps
    parts[slots.FACTORS][:] = 1.0
    parts[slots.UNITS][:] = 1.0
    parts[slots.LEAST][:] = config.P0
    parts[slots.DRIFT][:] = np.multiply(config.drift, config.sample_time_s)
    return state
