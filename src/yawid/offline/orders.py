"""Choice of orders and delay: several models of the same samples, scored on data held back.

The paper asks for orders that "balance accuracy and computational efficiency". Each candidate is
estimated from the first two thirds of the record by recursive maximum likelihood without
forgetting, and simulated from the inputs over the last third. The accuracy is the fit of that
simulation; the criteria of Akaike and Schwarz, the whiteness of the residuals and the time of one
update are given next to it.
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
"""Candidates within this many percentage points of the best are equally good: BIC decides."""


@dataclass(frozen=True, slots=True)
class Tried:
    """One structure and its scores.

    ``loss`` is the mean square of the innovation in y's unit squared, over the second half of the
    training samples; ``aic`` and ``bic`` are the criteria of Akaike and Schwarz; ``whiteness_p`` is
    the p-value of the Ljung-Box test; ``simulation_pct`` is the fit on the samples held back, in
    percent; ``dutch_roll`` is (wn, wn_std in rad/s, zeta, zeta_std); ``update_ns`` is the time of
    one update in ns.
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
    """Return the structures to try: na 2-4, nb na-1 to na, nc 0-3, nk 1-3, alike for all inputs.

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
    """Return the candidates, best simulation first, for u (n, inputs) and y (n,); NaN is held.

    ``advance`` is called with 1 after each candidate.

    Raises:
        NotIdentifiable: there are fewer than 200 samples without a NaN.
    """
    good = np.isfinite(y) & np.isfinite(u).all(axis=1)
    if good.sum() < LEAST_SAMPLES:
        raise NotIdentifiable(
            f"{good.sum()} samples: at least {LEAST_SAMPLES} are needed to compare orders"
        )
    # Two thirds of the usable samples, not of the time: a flight may begin on the ground.
    split = int(np.flatnonzero(good)[int(TRAINING * good.sum())])
    found = []
    for orders in tried:
        found.append(_try(u, y, split, sample_time_s, orders))
        advance(1)
    return sorted(found, key=lambda candidate: -candidate.simulation_pct)


def recommended(found: list[Tried]) -> Tried:
    """Return the candidate to use: of those about as good as the best, the one with the least BIC.

    Raises:
        NotIdentifiable: no candidate has a finite simulation and BIC.
    """
    finite = [c for c in found if math.isfinite(c.simulation_pct) and math.isfinite(c.bic)]
    if not finite:
        raise NotIdentifiable("no structure tried gives a finite model of this record")
    best = max(candidate.simulation_pct for candidate in finite)
    close = [c for c in finite if c.simulation_pct >= best - CLOSE_PCT]
    return min(close, key=lambda candidate: candidate.bic)


def _try(u: Floats, y: Floats, split: int, sample_time_s: float, orders: ArmaxOrders) -> Tried:
    """Return one candidate, estimated from the samples before ``split`` and scored on the rest."""
    config = EstimatorConfig(orders=orders, sample_time_s=sample_time_s, method=OF_STRUCTURES)
    armax = RecursiveArmax(config)
    start = time.perf_counter()
    block = armax.run(u[:split], y[:split], covariance=True)
    seconds = time.perf_counter() - start
    theta = block.theta[-1]
    # Only the second half of the training: the transient of the recursion is not the model's.
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
