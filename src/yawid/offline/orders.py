"""Choice of orders and delay: several models of the same samples, scored on data held back.

The paper asks for orders that "balance accuracy and computational efficiency". Each candidate is
estimated from the first two thirds of the samples by recursive maximum likelihood without
forgetting, and simulated from the inputs over the last third. The accuracy is the fit of that
simulation; the criteria of Akaike and Schwarz and the whiteness of the residuals are given next to
it. Of the candidates that simulate about as well as the best one, Schwarz's criterion chooses.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from yawid.answers.reports import OrdersTried
from yawid.answers.run_summary import DutchRoll, Manoeuvre, Orders
from yawid.blocks import Floats, SampleBlock, finite
from yawid.config.estimator import EstimatorConfig
from yawid.config.run import RunConfig
from yawid.errors import NotIdentifiable
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.fit import LEAST_SAMPLES, TRAINING, fit_percent, simulate
from yawid.estimation.methods import OF_STRUCTURES
from yawid.physics.modes import modes

CLOSE_PCT = 0.5
"""Candidates within this many percentage points of the best are equally good: BIC decides."""
CANDIDATES = [
    (na, na - fewer, nc, nk)
    for na, fewer, nc, nk in product((2, 3, 4), (0, 1), (0, 1, 2, 3), (1, 2, 3))
]
"""The structures to try, as ``--orders`` takes them: na, nb, nc, nk."""


def compare_orders(
    u: Floats,
    y: Floats,
    sample_time_s: float,
    config: RunConfig,
    tried: Sequence[tuple[int, int, int, int]] = CANDIDATES,
    advance: Callable[[int], None] = lambda count: None,
) -> tuple[list[OrdersTried], Orders]:
    """Return the candidates, best simulation first, for u (n, inputs) and y (n,); NaN is held.

    The orders to use are next to them: of those about as good as the best, the ones with the least
    BIC. ``advance`` is called with 1 after each candidate.

    Raises:
        NotIdentifiable: there are fewer than 200 samples without a NaN, or no candidate has a
            finite simulation and BIC.
    """
    good = np.isfinite(y) & np.isfinite(u).all(axis=1)
    if good.sum() < LEAST_SAMPLES:
        raise NotIdentifiable(
            f"{good.sum()} samples: at least {LEAST_SAMPLES} are needed to compare orders"
        )
    # Two thirds of the usable samples, not of the time: a flight may begin on the ground.
    split = int(np.flatnonzero(good)[int(TRAINING * good.sum())])
    found = []
    for four in tried:
        found.append(_try(u, y, split, sample_time_s, replace(config, orders=four)))
        advance(1)
    found.sort(key=lambda c: math.inf if c.simulation_pct is None else -c.simulation_pct)
    pct, bic = np.array([(each.simulation_pct, each.bic) for each in found], float).T
    known = np.isfinite(pct + bic)
    if not known.any():
        raise NotIdentifiable("no structure tried gives a finite model of this record")
    close = known & (pct >= pct[known].max() - CLOSE_PCT)
    best = found[int(np.argmin(np.where(close, bic, np.inf)))]
    return found, Orders(na=best.na, nb=best.nb, nc=best.nc, nk=best.nk)


def samples_of_manoeuvres(
    samples: SampleBlock | None, flown: Sequence[Manoeuvre]
) -> tuple[SampleBlock, int]:
    """Return the samples of the manoeuvres ``flown``, y NaN elsewhere, and how many these are.

    Where they have too few, these are all of the samples, and 0.

    Raises:
        NotIdentifiable: there are no samples.
    """
    if samples is None:
        raise NotIdentifiable("no sample has both rudder and yaw rate")
    t = samples.boot_us / 1e6
    inside = np.any([(each.from_s <= t) & (t <= each.to_s) for each in flown], axis=0)
    y = np.where(inside, samples.y, np.nan)
    if np.isfinite(y).sum() < LEAST_SAMPLES:
        return samples, 0
    return replace(samples, y=y), len(flown)


def _try(u: Floats, y: Floats, split: int, sample_time_s: float, run: RunConfig) -> OrdersTried:
    """Return one candidate, estimated from the samples before ``split`` and scored on the rest."""
    orders = run.armax_orders()
    config = EstimatorConfig(orders=orders, sample_time_s=sample_time_s, method=OF_STRUCTURES)
    armax = RecursiveArmax(config)
    block = armax.run(u[:split], y[:split], covariance=True)
    # Only the second half of the training: the transient of the recursion is not the model's.
    settled = block.innovation[split // 2 :]
    settled = settled[np.isfinite(settled)]
    loss = float(np.mean(settled**2)) if len(settled) else math.nan
    misfit = len(settled) * math.log(loss) if loss > 0.0 else math.nan
    scores = {
        "loss": loss,
        "aic": misfit + 2.0 * config.n_theta,
        "bic": misfit + config.n_theta * math.log(max(len(settled), 1)),
        "whiteness_p": armax.whiteness_p,
        "simulation_pct": fit_percent(
            y[split:], simulate(block.theta[-1], orders, config.bias, u[split:], y[split:])
        ),
    }
    roll = tuple(modes(block, orders, sample_time_s).dutch_roll[-1].tolist())
    return OrdersTried(*run.orders, **finite(scores), dutch_roll=DutchRoll.of(roll))
