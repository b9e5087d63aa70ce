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

from bench.peers import FORGETTING, PEERS
from bench.table import head, line, options_of
from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax
from yawid.blocks import Floats

SAMPLES = 4_000
CHUNK = 50


def ours(u: Floats, y: Floats, order: int) -> dict[str, tuple[Callable[[], object], int]]:
    """Return what to run of yawid by name: a call, and how many updates it makes."""
    runs: dict[str, tuple[Callable[[], object], int]] = {}
    u2, ul, yl = u.reshape(-1, 1), u.tolist(), y.tolist()
    for method in ("els", "rml"):
        for name, forgetting, lags in (
            ("no floor", 1.0, 0),
            ("floor", FORGETTING, 0),
            ("floor and diagnostics", FORGETTING, 20),
        ):
            armax = RecursiveArmax(_config(method, order, forgetting, lags))
            armax.run(u, y)
            runs[f"{method} bulk, {name}"] = partial(armax.run, u2, y, keep="last"), SAMPLES
        armax = RecursiveArmax(_config(method, order, FORGETTING, 0))
        armax.run(u, y)
        runs[f"{method} chunks of {CHUNK}, floor"] = partial(_chunks, armax, u2, y), 1_000
        runs[f"{method} update, floor"] = partial(_updates, armax, ul, yl), 500
    return runs


def peers(u: Floats, y: Floats, order: int) -> dict[str, tuple[Callable[[], object], int]]:
    """Return what to run of other estimators by name: a call, and how many updates it makes."""
    return {
        name: (partial(call, u, y, order, samples), samples)
        for name, (call, samples) in PEERS.items()
    }


def _config(method: str, order: int, forgetting: float, lags: int) -> EstimatorConfig:
    return EstimatorConfig(
        orders=ArmaxOrders(order, order, order, 1), sample_time_s=0.05, method=method, bias=False,
        forgetting_factor=forgetting, residual_lags=lags,
    )  # fmt: skip


def _chunks(armax: RecursiveArmax, u: Floats, y: Floats) -> None:
    for k in range(0, 1_000, CHUNK):
        armax.run(u[k : k + CHUNK], y[k : k + CHUNK], keep="last")


def _updates(armax: RecursiveArmax, u: list[float], y: list[float]) -> None:
    for k in range(500):
        armax.update(u[k], y[k])


def measure(runs: dict[str, tuple[Callable[[], object], int]], rounds: int) -> dict[str, float]:
    """Return the best ns per update of each call by name; the calls take turns."""
    best = dict.fromkeys(runs, np.inf)
    for _ in range(rounds):
        for name, (call, updates) in runs.items():
            start = time.perf_counter()
            call()
            best[name] = min(best[name], (time.perf_counter() - start) / updates * 1e9)
    return best


def row(name: str, of: list[str], best: list[dict[str, float]]) -> str:
    """Return the row of the calls ``of``: ns per update and x NumPy, for each entry of ``best``."""
    cells = []
    for each in best:
        ns = [each[part] for part in of if part in each]
        times = [each["plain NumPy loop"] / value for value in ns]
        cells.append(" / ".join(f"{value:.0f}" for value in ns))
        cells.append(" / ".join(f"{value:.3g}" for value in times))
    return line(name, *cells)


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table for 6 and for 9 parameters."""
    rounds = options_of("estimator", __doc__, arguments, rounds=60).rounds
    u, e = np.random.default_rng(0).standard_normal((2, SAMPLES))
    a = (1.0, -1.5, 0.7)
    y = lfilter((0.0, 1.0, 0.5), a, u) + lfilter((1.0, -1.0, 0.2), a, e)
    best = [measure(ours(u, y, order) | peers(u, y, order), rounds) for order in (2, 3)]
    yield from head("", ("ns per update, 6 parameters", "x NumPy", "9 parameters", "x NumPy"))
    paths = [name.removeprefix("els ") for name in best[0] if name.startswith("els ")]
    for path in paths:
        yield row(f"els / rml {path}", [f"els {path}", f"rml {path}"], best)
    yield row(" / ".join(PEERS), list(PEERS), best)
