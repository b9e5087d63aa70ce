"""Which orders and which delay: a larger bank over the same samples, judged on data held back.

The paper asks for orders that "balance accuracy and computational efficiency". Each candidate
learns the first two thirds of the record by recursive maximum likelihood without forgetting and is
then run free from the inputs over the last third. Accuracy is that simulation; the criteria of
Akaike and Schwarz and the whiteness of the residuals stand beside it, and the cost of one update.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.errors import NotIdentifiable
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.fit import LEAST_SAMPLES, TRAINING, fit_percent, simulate
from yawid.estimation.methods import OF_STRUCTURES
from yawid.physics.modes import modes

CLOSE_PCT = 0.5
"""Candidates within so many points of the best simulation are equally good; then BIC decides."""


@dataclass(frozen=True, slots=True)
class Tried:
    """One structure and how it did.

    ``loss`` is the mean square innovation over the training samples, ``simulation_pct`` the fit on
    the samples held back, ``dutch_roll`` (wn, wn_std, zeta, zeta_std), ``update_ns`` the cost of an
    update.
    """

    orders: ArmaxOrders
    loss: float
    aic: float
    bic: float
    whiteness_p: float
    simulation_pct: float
    dutch_roll: tuple[float, float, float, float]
    update_ns: float


def candidates(n_inputs: int, *, extra_b: int = 0) -> list[ArmaxOrders]:
    """Return the structures tried: na 2-4, nb na-1 to na, nc 0-3, nk 1-3, for every input.

    ``extra_b`` is added to nb (1 with the yaw angle as output).
    """
    return [
        ArmaxOrders(na=na, nb=(nb + extra_b,) * n_inputs, nc=nc, nk=(nk,) * n_inputs)
        for na, fewer, nc, nk in product((2, 3, 4), (0, 1), (0, 1, 2, 3), (1, 2, 3))
        if (nb := na - fewer) >= 1
    ]


def compare_orders(
    u: Floats,
    y: Floats,
    sample_time_s: float,
    tried: list[ArmaxOrders],
    advance: Callable[[int], None] = lambda count: None,
) -> list[Tried]:
    """Return the candidates, best simulation first, for u (n, inputs) and y (n,), NaN held.

    ``advance`` is called with 1 as each has been tried.

    Raises:
        NotIdentifiable: fewer than 200 samples.
    """
    good = np.isfinite(y) & np.isfinite(u).all(axis=1)
    if good.sum() < LEAST_SAMPLES:
        raise NotIdentifiable(f"{good.sum()} samples: {LEAST_SAMPLES} are needed to compare orders")
    # Two thirds of what can be used, not of the clock: a flight may begin on the ground.
    split = int(np.flatnonzero(good)[int(TRAINING * good.sum())])
    found = []
    for orders in tried:
        found.append(_try(u, y, split, sample_time_s, orders))
        advance(1)
    return sorted(found, key=lambda candidate: -candidate.simulation_pct)


def recommended(found: list[Tried]) -> Tried:
    """Return the candidate to use: of those about as good as the best, the one of least BIC.

    Raises:
        NotIdentifiable: no candidate is finite.
    """
    finite = [c for c in found if math.isfinite(c.simulation_pct) and math.isfinite(c.bic)]
    if not finite:
        raise NotIdentifiable("no structure tried gives a finite model of this record")
    best = max(candidate.simulation_pct for candidate in finite)
    close = [c for c in finite if c.simulation_pct >= best - CLOSE_PCT]
    return min(close, key=lambda candidate: candidate.bic)


def _try(u: Floats, y: Floats, split: int, sample_time_s: float, orders: ArmaxOrders) -> Tried:
    config = EstimatorConfig(orders=orders, sample_time_s=sample_time_s, method=OF_STRUCTURES)
    armax = RecursiveArmax(config)
    start = time.perf_counter()
    block = armax.run(u[:split], y[:split], covariance=True)
    seconds = time.perf_counter() - start
    theta = block.theta[-1]
    # The transient of the recursion is no property of the model: the second half of the training.
    settled = block.innovation[split // 2 :]
    settled = settled[np.isfinite(settled)]
    loss = float(np.mean(settled**2)) if len(settled) else math.nan
    count, parameters = len(settled), config.n_theta
    misfit = count * math.log(loss) if loss > 0.0 else math.nan
    wn, wn_std, zeta, zeta_std = modes(block, orders, sample_time_s).dutch_roll[-1].tolist()
    simulated = simulate(theta, orders, config.bias, u[split:], y[split:])
    return Tried(
        orders,
        loss,
        misfit + 2.0 * parameters,
        misfit + parameters * math.log(max(count, 1)),
        armax.whiteness_p,
        fit_percent(y[split:], simulated),
        (wn, wn_std, zeta, zeta_std),
        1e9 * seconds / max(split, 1),
    )
