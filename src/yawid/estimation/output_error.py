"""Output error: A and B fitted so that the model's free run is as near to y as it can be.

The model is y = B(q)/A(q) u + bias + e, without C. ARMAX weighs the misfit one step ahead, so high
frequencies count most there; a free run weighs it where the aircraft moves most, at its mode. Where
three poles cannot hold all of an aircraft, that is the better criterion in calm air. In gusts it is
the worse one: without a noise model the fit takes a gust for a response to the rudder.
"""

from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.all_pole import all_pole
from yawid.estimation.free_run import coefficients, free_decays, without
from yawid.estimation.polynomials import c_of, is_stable
from yawid.estimation.prediction_error import HALVINGS, ITERATIONS, RecordFit, Scores
from yawid.estimation.products import along, cross

NEAR_ENOUGH = 1e-5
"""The relative gain in loss after which the steps end: the next one is a small part of sigma."""
NEARLY = 1e-2
"""The same of the steps to the maximum likelihood, from which they begin."""
DAMPING, HARDER = 1e-3, 8.0
"""Of the steps: a part of the information's diagonal, and the factor by which it changes. It holds
a pole that all but cancels a zero, along which nothing changes the loss."""


class _Run(NamedTuple):
    """The free run of one stretch: what it leaves (n,), its past (na,), the decays (n, na)."""

    left: Floats
    past: Floats
    decays: Floats


def output_error(record: RecordFit, settled: float) -> Floats:
    """Return the theta (n_theta,), C = 1, of least free-run error near that of least loss.

    Levenberg's and Marquardt's steps begin near RML's theta. The initial state of each stretch is
    free and eliminated (Golub and Pereyra 1973). They end when the loss gains a smaller share than
    ``settled``, or than 1e-5.
    """
    theta = record.gauss_newton(max(settled, NEARLY))
    is_free = np.ones(len(theta), bool)
    c_of(theta, record.orders)[:], c_of(is_free, record.orders)[:] = 0.0, False
    runs, damping = _runs(record, theta), DAMPING
    loss = _loss(runs)
    for _ in range(ITERATIONS):
        psi = _slopes(record, theta, runs)[:, is_free]
        information = cross(psi, psi)
        if not np.isfinite(information).all():
            break
        score = cross(psi, np.concatenate([each.left for each in runs]))
        scale, better = np.diag(np.diag(information) + np.finfo(float).tiny), loss
        for _ in range(HALVINGS):
            trial = theta.copy()
            trial[is_free] += np.linalg.solve(information + damping * scale, score)
            if is_stable(trial[: record.orders.na]):
                tried = _runs(record, trial)
                if (better := _loss(tried)) < loss:
                    break
            damping, better = damping * HARDER, loss
        if not better < loss:
            break
        damping /= HARDER
        is_done = better > loss * (1.0 - max(settled, NEAR_ENOUGH))
        theta, loss, runs = trial, better, tried
        if is_done:
            break
    return theta


def free_run_residuals(record: RecordFit, theta: Floats) -> list[Floats]:
    """Return y less the free run (n,) of each stretch, from the initial state that fits best."""
    return [each.left for each in _runs(record, theta)]


def output_error_scores(record: RecordFit, theta: Floats, residuals: list[Floats]) -> Scores:
    """Return psi for the instruments, psi and eps at theta, whose ``residuals`` are known.

    Psi (n, n_theta) is the slope of the free run, without what the initial states take up; it is 0
    for C.
    """
    psi = _slopes(record, theta, _runs(record, theta))
    return psi, psi, np.concatenate(residuals)


def _runs(record: RecordFit, theta: Floats) -> list[_Run]:
    na, runs = record.orders.na, []
    for y, phi in record.stretches:
        drive = along(phi[:, na:], theta[na:])  # the columns of C are 0
        rest = (y - all_pole(theta[:na], drive, np.zeros(na)))[:, None]
        decays = free_decays(theta[:na], len(y))
        past = coefficients(decays, rest)
        runs.append(_Run((rest - cross(decays.T, past))[:, 0], past[:, 0], decays))
    return runs


def _slopes(record: RecordFit, theta: Floats, runs: list[_Run]) -> Floats:
    """Return the slope (n, n_theta) of the free run of all stretches."""
    na, rows = record.orders.na, []
    for (y, phi), run in zip(record.stretches, runs, strict=True):
        simulated = np.concatenate([run.past[::-1], y - run.left])
        drive = phi.copy()
        for i in range(na):
            drive[:, i] = -simulated[na - 1 - i : len(simulated) - 1 - i]
        slopes = all_pole(theta[:na], drive, np.zeros((na, len(theta))))
        rows.append(without(run.decays, slopes))
    return np.concatenate(rows)


def _loss(runs: list[_Run]) -> float:
    loss = float(sum(np.sum(each.left**2) for each in runs))
    return loss if np.isfinite(loss) else np.inf
