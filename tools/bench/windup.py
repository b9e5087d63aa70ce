"""Wind-up of S1 with lambda .98: cycles of 2 000 excited and 48 000 poor samples of four kinds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np
from scipy.signal import lfilter

from bench.plants import PLANTS, Floats
from yawid import EstimatorConfig, RecursiveArmax

EXCITED, POOR = 2_000, 48_000
FACTOR = 0.98
PATTERNS = ("always excited", "input silent", "dead silence", "input at trim")
TRIM = 0.3
SETTLED = 300


def cycle(pattern: str, gain: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return u and y of one cycle of S1, whose b is multiplied by ``gain``."""
    plant = PLANTS[0]
    u, e = rng.standard_normal((2, EXCITED + POOR))
    if pattern != "always excited":
        u[EXCITED:] = TRIM if pattern == "input at trim" else 0.0
    if pattern == "dead silence":
        e[EXCITED:] = 0.0
    a = (1.0, *plant.a)
    y = lfilter((0.0, *(gain * np.array(plant.b))), a, u) + lfilter((1.0, *plant.c), a, e)
    return u, y


def endure(pattern: str, method: str, updates: int, **options: float) -> dict[str, float]:
    """Run a pattern for ``updates`` samples, whose gain alternates from cycle to cycle.

    Return the worst error of theta after SETTLED samples of a cycle, the mean error of the gain at
    that moment, the range of P, and the number of restarts.
    """
    plant = PLANTS[0]
    config = EstimatorConfig(
        orders=plant.orders, sample_time_s=0.02, method=method, bias=False,
        forgetting_factor=FACTOR, **options,
    )  # fmt: skip
    estimator, rng = RecursiveArmax(config), np.random.default_rng(0)
    worst, largest, least, gains = 0.0, 0.0, np.inf, []
    first = len(plant.a)
    for number in range(updates // (EXCITED + POOR)):
        gain = 1.0 if number % 2 == 0 else 1.5
        u, y = cycle(pattern, gain, rng)
        truth = plant.theta.copy()
        truth[first : first + len(plant.b)] *= gain
        back = estimator.run(u[:SETTLED], y[:SETTLED])
        rest = estimator.run(u[SETTLED:], y[SETTLED:])
        if number > 0:
            miss = np.abs(rest.theta - truth).max() if len(rest) else 0.0
            worst = max(worst, float(miss))
            steady = estimator_gain(back.theta[-1], first, len(plant.b))
            gains.append(steady / estimator_gain(truth, first, len(plant.b)) - 1.0)
        P = estimator.P
        largest, least = max(largest, float(np.max(P))), min(least, float(np.linalg.eigvalsh(P)[0]))
    return {
        "worst": worst,
        "gain_error": max(abs(float(np.mean(gains[i::2]))) for i in range(2)),
        "P_max": largest, "P_least": least, "restarts": estimator.restarts,
    }  # fmt: skip


def estimator_gain(theta: Floats, first: int, nb: int) -> float:
    """Return the sum of b in theta: the numerator's gain."""
    return float(theta[first : first + nb].sum())


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table: the worst error of theta / the gain error when excitation returns."""
    parser = argparse.ArgumentParser(prog="bench.py windup", description=__doc__)
    parser.add_argument("--updates", type=int, default=10_000_000)
    updates = parser.parse_args(arguments).updates
    yield "| | " + " | ".join(PATTERNS) + " |"
    yield "|---" * (1 + len(PATTERNS)) + "|"
    for method in ("els", "rml"):
        found = []
        for pattern in PATTERNS:
            found.append(endure(pattern, method, updates))
            print(f"{method}, {pattern}: {found[-1]}", file=sys.stderr)
        cells = [f"{each['worst']:.2f} / {each['gain_error']:.3f}" for each in found]
        yield f"| {method} | " + " | ".join(cells) + " |"
