"""What one estimator of the bank found: its part of the summary, and what the verdict needs."""

from __future__ import annotations

import math

import numpy as np

from yawid.channels.sample_flags import strokes, window_of
from yawid.estimation.bank import Bank, History, PastModels
from yawid.estimation.fit import fit_percent, simulate
from yawid.estimation.polynomials import c_of, parameter_names, spr_margin
from yawid.physics.derivatives import summary_of
from yawid.physics.flying_qualities import dutch_roll_level
from yawid.physics.model_response import early_response
from yawid.physics.modes import dutch_roll_of, finite, mode_list, modes
from yawid.results.excitation import LEAST_STROKE
from yawid.results.judge_estimate import Evidence
from yawid.results.roll_test import roll_p
from yawid.results.run_summary import DutchRoll, Fit, MethodSummary, Mode, Orders, Value

TRAINING = 2.0 / 3.0
"""The model as it stood after this part of the usable samples is tried on the rest."""
LEAST_SAMPLES = 200
"""Usable samples below which there is nothing to hold back."""


def method_summary(bank: Bank, method: str) -> tuple[MethodSummary, Evidence]:
    """Return the summary of one method, and what the verdict needs of it."""
    estimator, last = bank.estimators[method], bank.last[method]
    orders, sample_time_s = estimator.config.orders, bank.sample_time_s
    mean_output = bank.config.output == "yaw"
    found = modes(last, orders, sample_time_s, mean_output=mean_output)
    wn, zeta = (float(value) for value in found.dutch_roll[-1, ::2])
    theta = last.theta[-1]
    physics = summary_of(
        theta, estimator.covariance, orders, sample_time_s,
        mean_output=mean_output, servo_tau_s=bank.config.servo_tau,
    )  # fmt: skip
    history = bank.history()
    fit = _fit(bank, method, history)
    names = parameter_names(orders, bank.config.inputs, bias=estimator.config.bias)
    described = MethodSummary(
        method=method,
        orders=Orders(orders.na, orders.nb[0], orders.nc, orders.nk[0]),
        sample_time_s=sample_time_s,
        forgetting_factor=estimator.config.forgetting_factor,
        updates=estimator.updates,
        held=estimator.held,
        theta=finite(dict(zip(names, theta, strict=True))),
        theta_std=finite(dict(zip(names, last.theta_std[-1], strict=True))),
        modes=[Mode(**each) for each in mode_list(found)],
        dutch_roll=DutchRoll.of(found.dutch_roll[-1], dutch_roll_level(wn, zeta)),
        physics={name: Value(**each) for name, each in physics.items()} or None,
        fit=Fit(**finite(fit)),
    )
    earlier = _shortly_before(bank, history)
    before = np.full(2, np.nan)
    if earlier is not None:
        before = dutch_roll_of(
            earlier.theta[method], orders, sample_time_s, mean_output=mean_output
        )
    evidence = Evidence(
        int(last.status[-1]),
        estimator.updates,
        found.dutch_roll[-1],
        estimator.whiteness_p,
        early_response(theta, orders, sample_time_s, wn),
        fit["simulation_pct"],
        fit["simulation_held_back_pct"],
        before,
        # With a band the roll is another signal: it has not passed the filter.
        math.nan if bank.config.band is not None else roll_p(theta, estimator.config, history),
    )
    return described, evidence


def _fit(bank: Bank, method: str, history: History) -> dict[str, float]:
    estimator = bank.estimators[method]
    theta, config = bank.last[method].theta[-1], estimator.config
    y, y_hat = history.y, history.y_hat[method]
    simulated = simulate(theta, config.orders, config.bias, history.u, y)
    return {
        "one_step_pct": fit_percent(y, y_hat),
        "simulation_pct": fit_percent(y, simulated),
        "simulation_held_back_pct": _held_back_pct(bank, method, history),
        "innovation_std": estimator.innovation_std,
        "residual_std": estimator.residual_std,
        "whiteness_p": estimator.whiteness_p,
        "spr_margin": spr_margin(c_of(estimator.theta, config.orders)),
    }


def _held_back_pct(bank: Bank, method: str, history: History) -> float:
    """Return the fit of the model as it stood at two thirds, run free over the last third.

    NaN where there is too little data, or where the rudder rests in the last third: a model tells
    nothing of noise alone. The samples are those of the history: all of a run that
    forgets nothing, else the newest three memories, so that memory stays bounded however long a
    run or a session lasts.
    """
    good = history.good
    if len(good) < LEAST_SAMPLES:
        return math.nan
    earlier = bank.earlier(int(good[int(TRAINING * len(good))]))
    if earlier is None or not earlier.theta[method].any():
        return math.nan
    config, rows = bank.estimators[method].config, slice(earlier.first, None)
    u, y = history.u[rows], history.y[rows]
    moved, least = u[np.isfinite(u[:, 0]), 0], LEAST_STROKE * bank.config.half_travel
    if len(moved) == 0 or strokes(moved, window_of(bank.sample_time_s)).max() < least:
        return math.nan
    return fit_percent(y, simulate(earlier.theta[method], config.orders, config.bias, u, y))


def _shortly_before(bank: Bank, history: History) -> PastModels | None:
    """Return the models a third of the memory ago, or before the last third of a short record."""
    good = history.good
    if len(good) < LEAST_SAMPLES:
        return None
    forgotten = 1.0 - bank.config.forgetting_factor(bank.sample_time_s)
    back = (1.0 - TRAINING) * min(len(good), 1.0 / forgotten if forgotten > 0.0 else math.inf)
    return bank.earlier(int(good[-math.ceil(back)]))
