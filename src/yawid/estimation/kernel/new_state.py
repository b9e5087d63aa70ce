"""Build the packed state of a configuration; ``state.py`` names its numbers and parts."""

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.kernel import state as slots
from yawid.estimation.methods import METHODS
from yawid.estimation.polynomials import lag_depth

WARM_UPDATES_PER_PARAMETER = 10
"""The status is WARMING_UP for this many updates times the number of parameters."""
D_CAP = 1e6
"""Upper limit of the entries of D in P = U D U', on scaled signals; P0 where that is larger."""


def registers(config: EstimatorConfig) -> tuple[list[int], list[int]]:
    """Return ``heads`` (m + 4), where each register begins and the last ends, and ``taps`` (n).

    There is a register for -y, each of the m inputs, the residual and the constant 1 of the bias,
    the newest value first: -y(k-1), u(k), eps(k-1) when phi(k) is formed. ``taps`` are the places
    of the entries of phi in the registers.
    """
    orders = config.orders
    rows = [(0, orders.na)]
    rows += [(nk, nb) for nb, nk in zip(orders.nb, orders.nk, strict=True)]
    rows += [(0, orders.nc), (0, int(config.bias))]
    heads, taps = [0], list[int]()
    for first, count in rows:
        taps += range(heads[-1] + first, heads[-1] + first + count)
        # The filter 1/C(q) needs nc lags of each signal.
        heads.append(heads[-1] + (max(first + count, orders.nc) if count else 0))
    return heads, taps


def new_state(config: EstimatorConfig) -> Floats:
    """Return the packed state of an estimator that has seen no sample."""
    orders, n, lags = config.orders, config.n_theta, config.residual_lags
    window = max(config.scale_window, config.start_buffer)
    heads, taps = registers(config)
    header: dict[str, float | None] = {  # the configuration has replaced its None
        "n": n, "na": orders.na, "nc": orders.nc, "m": orders.n_inputs,
        "r": heads[-1] + max(1, orders.nc),  # a spare place for signals without a register
        "lags": lags, "window": window, "depth": lag_depth(config.orders),
        "bias": config.bias, "filters": METHODS[config.method].filters,
        "scaled": config.scale_window > 0, "minimum": config.scale_minimum,
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
