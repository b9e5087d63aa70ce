"""Monte-Carlo efficiency on S1-S4: q = d' CRB^-1 d / n, 1 is the Cramer-Rao bound."""

from __future__ import annotations

import argparse

import numpy as np
from bench_plants import PLANTS, Floats, Plant

from yawid import EstimatorConfig, RecursiveArmax

LENGTHS = (2_000, 10_000)
FAIL = 100.0
VARIANTS = (("els", 0), ("rml", 0), ("rml", 500))


def ratios(plant: Plant, method: str, start_buffer: int, runs: int) -> Floats:
    """Return q (runs, lengths)."""
    config = EstimatorConfig(
        orders=plant.orders, sample_time_s=0.02, method=method, bias=False,
        start_buffer=start_buffer,
    )  # fmt: skip
    information, n = plant.information(), len(plant.theta)
    q = np.empty((runs, len(LENGTHS)))
    for run in range(runs):
        u, y = plant.simulate(LENGTHS[-1], run)
        estimator, done = RecursiveArmax(config), 0
        for column, length in enumerate(LENGTHS):
            block = estimator.run(u[done:length], y[done:length], keep="last")
            miss = block.theta[-1] - plant.theta
            q[run, column] = length * miss @ information @ miss / n
            done = length
    return q


def summary(q: Floats) -> str:
    """Return mean over the runs that did not fail, its standard error, and failures."""
    good = q[q <= FAIL]
    if not len(good):
        return f"all {len(q)} fail"
    error = good.std() / np.sqrt(len(good))
    return f"{good.mean():.2f} ±{error:.2f}, {len(q) - len(good)} fail"


def main(arguments: list[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="bench.py efficiency", description=__doc__)
    parser.add_argument("--runs", type=int, default=400)
    runs = parser.parse_args(arguments).runs
    print(f"{runs} runs; q at N = " + " / ".join(str(length) for length in LENGTHS))
    for method, start_buffer in VARIANTS:
        for plant in PLANTS:
            q = ratios(plant, method, start_buffer, runs)
            columns = "  |  ".join(summary(q[:, i]) for i in range(len(LENGTHS)))
            print(f"{method} start_buffer={start_buffer:<4d} {plant.name}  {columns}", flush=True)
