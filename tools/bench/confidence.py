"""Tracking and confidence of RML on S1-S4: error against theory, coverage of 95 % intervals."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from bench.plants import PLANTS, Floats, Plant
from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax

FACTORS = (0.99, 0.995, 0.998)
SAMPLES, EVERY = 20_000, 2_000
NOMINAL = 1.96
LAGS = 20


def track(plant: Plant, config: EstimatorConfig, truth: Floats, runs: int) -> tuple[Floats, Floats]:
    """Return the errors and the sigmas (instants, n) after every EVERY samples of each run."""
    errors, sigmas = [], []
    for run in range(runs):
        u, y = plant.simulate(SAMPLES, run)
        block = RecursiveArmax(config).run(u, y)
        errors.append(block.theta[EVERY - 1 :: EVERY] - truth)
        sigmas.append(block.theta_std[EVERY - 1 :: EVERY])
    return np.concatenate(errors), np.concatenate(sigmas)


def configuration(orders: ArmaxOrders, factor: float, lags: int) -> EstimatorConfig:
    """Return the configuration of RML without a bias term."""
    return EstimatorConfig(
        orders=orders, sample_time_s=0.02, method="rml", bias=False, forgetting_factor=factor,
        residual_lags=lags,
    )  # fmt: skip


def coverage(errors: Floats, sigmas: Floats) -> Floats:
    """Return the share of 95 % intervals that contain the truth, for each parameter (n,)."""
    shares: Floats = (np.abs(errors) <= NOMINAL * sigmas).mean(axis=0)
    return shares


def row(name: str, mse: list[float], covered: list[Floats]) -> str:
    """Return a row: the ranges of ``mse`` and of the mean coverage, and the worst parameter."""
    means = [float(each.mean()) for each in covered]
    worst = min(float(each.min()) for each in covered)
    theory = f"{min(mse):.2f} to {max(mse):.2f}" if mse else ""
    return f"| {name} | {theory} | {min(means):.3f} to {max(means):.3f} | {worst:.2f} |"


def right_orders(runs: int) -> str:
    """Return the row of the true orders, over all plants, forgetting factors and corrections."""
    mse, covered = [], []
    for factor in FACTORS:
        for plant in PLANTS:
            for lags in (0, LAGS):
                config = configuration(plant.orders, factor, lags)
                errors, sigmas = track(plant, config, plant.theta, runs)
                metric = plant.information() * (1.0 + factor) / (1.0 - factor) / len(plant.theta)
                mse.append(float(np.einsum("ki,ij,kj->k", errors, metric, errors).mean()))
                covered.append(coverage(errors, sigmas))
    return row("right orders", mse, covered)


def too_low(runs: int) -> Iterator[str]:
    """Yield the rows of orders that are too low.

    The truth is the estimate from 10^6 samples with these orders.
    """
    limits = []
    for plant in PLANTS:
        o = plant.orders
        for orders in (replace(o, nc=o.nc - 1), replace(o, na=o.na - 1)):
            armax = RecursiveArmax(configuration(orders, 1.0, 0))
            truth = armax.run(*plant.simulate(10**6, 999), keep="last").theta[-1]
            limits.append((plant, orders, truth))
    for lags, name in ((LAGS, "corrected"), (0, "not corrected")):
        covered = [
            coverage(*track(plant, configuration(orders, 1.0, lags), truth, runs))
            for plant, orders, truth in limits
        ]
        yield row(f"one order too low, {name}", [], covered)


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table."""
    parser = argparse.ArgumentParser(prog="bench.py confidence", description=__doc__)
    parser.add_argument("--runs", type=int, default=40)
    runs = parser.parse_args(arguments).runs
    yield "| | squared error over theory | 95 % intervals cover | worst parameter |"
    yield "|---|---|---|---|"
    yield right_orders(runs)
    yield from too_low(runs)
