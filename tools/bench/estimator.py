"""Compares the speed of estimators: ns per update, and how many times faster than plain NumPy.

Every figure is the best of many short measurements, taken in turns. On a shared machine the best
shows the cost of the code, while the mean depends on what other programs do.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.signal import lfilter

from bench.frame import head, line, options_of
from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax
from yawid.blocks import Floats

FORGETTING, SAMPLES, CHUNK = 0.998, 4_000, 50
SETTINGS = {
    "no floor": (1.0, 0),
    "floor": (FORGETTING, 0),
    "floor and diagnostics": (FORGETTING, 20),
}
"""Forgetting factor and lags of the residuals, by name."""
PLAIN = "plain NumPy loop"
Runs = dict[str, tuple[Callable[[], object], int]]
"""A call, and how many updates it makes, by name."""


def runs(u: Floats, y: Floats, order: int) -> Runs:
    """Return what to run."""
    found: Runs = {PLAIN: (partial(numpy_els, u, y, order, 300), 300)}
    for method in ("els", "rml"):
        for name, (forgetting, lags) in SETTINGS.items():
            config = EstimatorConfig(
                orders=ArmaxOrders(order, order, order, 1), sample_time_s=0.05, method=method,
                bias=False, forgetting_factor=forgetting, residual_lags=lags,
            )  # fmt: skip
            armax = RecursiveArmax(config)
            armax.run(u, y)
            found[f"{method} bulk, {name}"] = partial(armax.run, u, y, keep="last"), SAMPLES
        found[f"{method} chunks of {CHUNK}"] = partial(_chunks, armax, u, y), 1_000
        found[f"{method} update"] = partial(_updates, armax, u.tolist(), y.tolist()), 500
    return found


def _chunks(armax: RecursiveArmax, u: Floats, y: Floats) -> None:
    for k in range(0, 1_000, CHUNK):
        armax.run(u[k : k + CHUNK], y[k : k + CHUNK], keep="last")


def _updates(armax: RecursiveArmax, u: list[float], y: list[float]) -> None:
    for k in range(500):
        armax.update(u[k], y[k])


def numpy_els(u: Floats, y: Floats, order: int, samples: int) -> None:
    """Run ELS as one would first write it: with the a posteriori residual, P as a full matrix."""
    n = 3 * order
    theta, P, phi = np.zeros(n), 100.0 * np.eye(n), np.zeros(n)
    for k in range(samples):
        e = y[k] - phi @ theta
        P_phi = P @ phi
        gain = P_phi / (FORGETTING + phi @ P_phi)
        theta = theta + gain * e
        P = (P - np.outer(gain, P_phi)) / FORGETTING
        newest = -y[k], u[k], y[k] - phi @ theta
        phi = np.roll(phi, 1)
        phi[::order] = newest


def measure(calls: Runs, rounds: int) -> dict[str, float]:
    """Return the best ns per update of each call by name; the calls take turns."""
    best = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, (call, updates) in calls.items():
            start = time.perf_counter()
            call()
            best[name] = min(best[name], (time.perf_counter() - start) / updates * 1e9)
    return best


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table for 6 and for 9 parameters."""
    rounds = options_of("estimator", __doc__, arguments, rounds=60).rounds
    u, e = np.random.default_rng(0).standard_normal((2, SAMPLES))
    a = (1.0, -1.5, 0.7)
    y = lfilter((0.0, 1.0, 0.5), a, u) + lfilter((1.0, -1.0, 0.2), a, e)
    best = [measure(runs(u, y, order), rounds) for order in (2, 3)]
    yield from head("", ("ns per update, 6 parameters", "x NumPy", "9 parameters", "x NumPy"))
    for name in best[0]:
        cells = ((f"{of[name]:.0f}", f"{of[PLAIN] / of[name]:.3g}") for of in best)
        yield line(name, *(cell for pair in cells for cell in pair))
