"""Tracking and confidence of rml on S1-S4: error against theory, coverage of 95 % intervals."""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from bench_plants import PLANTS, Floats, Plant

from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax

FACTORS = (0.99, 0.995, 0.998)
SAMPLES, EVERY = 20_000, 2_000
NOMINAL = 1.96
LAGS = 20


def track(plant: Plant, config: EstimatorConfig, truth: Floats, runs: int) -> tuple[Floats, Floats]:
    """Return the errors and the sigmas (instants, n): every EVERY samples after the first ones."""
    errors, sigmas = [], []
    for run in range(runs):
        u, y = plant.simulate(SAMPLES, run)
        block = RecursiveArmax(config).run(u, y)
        errors.append(block.theta[EVERY - 1 :: EVERY] - truth)
        sigmas.append(block.theta_std[EVERY - 1 :: EVERY])
    return np.concatenate(errors), np.concatenate(sigmas)


def configuration(orders: ArmaxOrders, factor: float, lags: int) -> EstimatorConfig:
    """Return rml without bias term."""
    return EstimatorConfig(
        orders=orders, sample_time_s=0.02, method="rml", bias=False, forgetting_factor=factor,
        residual_lags=lags,
    )  # fmt: skip


def coverage(errors: Floats, sigmas: Floats) -> str:
    """Return the share of intervals that hold the truth, over all parameters and the worst one."""
    inside = np.abs(errors) <= NOMINAL * sigmas
    return f"{inside.mean():.3f} (worst {inside.mean(axis=0).min():.3f})"


def main(arguments: list[str]) -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(prog="bench.py confidence", description=__doc__)
    parser.add_argument("--runs", type=int, default=40)
    runs = parser.parse_args(arguments).runs
    print(f"{runs} runs of {SAMPLES} samples, every {EVERY}: MSE over theory; coverage of 95 %")
    for factor in FACTORS:
        for plant in PLANTS:
            line = f"lambda {factor} {plant.name}"
            for lags in (0, LAGS):
                errors, sigmas = track(
                    plant, configuration(plant.orders, factor, lags), plant.theta, runs
                )
                metric = plant.information() * (1.0 + factor) / (1.0 - factor) / len(plant.theta)
                q = np.einsum("ki,ij,kj->k", errors, metric, errors)
                line += f" | lags {lags}: MSE {q.mean():.2f}, cover {coverage(errors, sigmas)}"
            print(line, flush=True)
    print("order too low by one; the truth is the model's own limit, from 10^6 samples")
    for plant in PLANTS:
        o = plant.orders
        for orders in (replace(o, nc=o.nc - 1), replace(o, na=o.na - 1)):
            limit = configuration(orders, 1.0, 0)
            truth = RecursiveArmax(limit).run(*plant.simulate(10**6, 999), keep="last").theta[-1]
            line = f"{plant.name} ({orders.na},{orders.nb[0]},{orders.nc})"
            for lags in (0, LAGS):
                errors, sigmas = track(plant, configuration(orders, 1.0, lags), truth, runs)
                line += f" | lags {lags}: cover {coverage(errors, sigmas)}"
            print(line, flush=True)
