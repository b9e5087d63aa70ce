"""Build the packed state of a configuration; the slots and parts are named in ``state.py``."""

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.kernel import state as slots
from yawid.estimation.methods import METHODS
from yawid.estimation.polynomials import lag_depth

WARM_UPDATES_PER_PARAMETER = 10
D_CAP = 1e6
"""D of P = U D U' grows by forgetting no further than this, or P0 where that is larger."""


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
    header: dict[str, float | None] = {  # the config has filled its None
        "n": n, "na": orders.na, "nc": orders.nc, "m": orders.n_inputs,
        "r": heads[-1] + max(1, orders.nc),  # a spare for signals without a register
        "lags": lags, "window": window, "depth": lag_depth(config.orders),
        "bias": config.bias, "filters": METHODS[config.method].filters,
        "scaled": config.scale_window > 0, "start_fit": config.start_buffer > 0,
        "minimum": config.scale_minimum,
        "P0": config.P0, "d_max": max(D_CAP, config.P0),
        "warm": WARM_UPDATES_PER_PARAMETER * n,
        "lam_start": config.forgetting_start, "lam_end": config.forgetting_factor,
        "lam_rate": config.forgetting_rate, "floor": config.information_floor,
        "lam": config.forgetting_start,
        "phase": slots.GATHERING if window else slots.RUNNING, "broken": 1.0,
    }  # fmt: skip
    blank = np.zeros(1, slots.HEADER)
    for name, value in header.items():
        blank[name] = value
    samples = (orders.n_inputs + 2) * window
    rest = np.zeros(sum(slots.lengths(blank[0])) + samples)
    state: Floats = np.concatenate([blank.view(np.float64), rest])
    at = slots.cut(state)
    for part in (at.d, at.least, at.best):
        part[:] = config.P0
    at.covariance[:: n + 1] = config.P0
    at.heads[:], at.taps[:] = heads, taps
    at.factors[:] = 1.0
    at.units[:] = 1.0
    return state
