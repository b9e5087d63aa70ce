"""Monte-Carlo efficiency on S1-S4: the mean of q = d' CRB^-1 d / n.

d (n,) is the error of theta, CRB the Cramer-Rao bound of its covariance; the best mean of q is 1.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from bench.plants import PLANTS, Floats, Plant
from yawid import EstimatorConfig, RecursiveArmax

LENGTHS = (2_000, 10_000)
FAIL = 100.0
VARIANTS = (("els", 0), ("rml", 0), ("rml", 500))


def ratios(plant: Plant, method: str, start_buffer: int, runs: int) -> Floats:
    """Return q (runs, lengths) of one plant and method."""
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


def cell(q: Floats) -> str:
    """Return the cell: the mean of q (runs, lengths) by length, over the runs with q <= FAIL."""
    means, failed = [], int((q > FAIL).any(axis=1).sum())
    for column in q.T:
        good = column[column <= FAIL]
        means.append(f"{good.mean():.2f}" if len(good) else "-")
    return " / ".join(means) + (f", {failed} fail" if failed else "")


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table: q at each length."""
    parser = argparse.ArgumentParser(prog="bench.py efficiency", description=__doc__)
    parser.add_argument("--runs", type=int, default=400)
    runs = parser.parse_args(arguments).runs
    yield "| | " + " | ".join(plant.name for plant in PLANTS) + " |"
    yield "|---" * (1 + len(PLANTS)) + "|"
    for method, start_buffer in VARIANTS:
        cells = [cell(ratios(plant, method, start_buffer, runs)) for plant in PLANTS]
        yield f"| {method}, start_buffer={start_buffer} | " + " | ".join(cells) + " |"
