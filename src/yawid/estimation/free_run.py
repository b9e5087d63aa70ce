"""The free run of a model over the stretches of a record, from the initial state that fits best.

It works on scaled signals, as ``prediction_error.py`` does. What an initial state can explain is a
free decay: a combination of the responses of 1/A to past values of 1, one for each lag of A.

Output error is the fit of A and B whose free run is nearest to y. Its model is y = B(q)/A(q) u +
bias + e, without C. ARMAX weighs the misfit one step ahead, so high frequencies count most there; a
free run weighs it where the aircraft moves most, at its mode. Where three poles cannot hold all of
an aircraft, that is the better criterion in calm air. In gusts it is the worse one: without a noise
model the fit takes a gust for a response to the rudder.
"""

import math
from typing import NamedTuple, cast

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.all_pole import all_pole, free_decays
from yawid.estimation.fit import fit_percent
from yawid.estimation.machine.products import along, cross
from yawid.estimation.polynomials import c_of, is_stable
from yawid.estimation.prediction_error import (
    HALVINGS,
    ITERATIONS,
    RIDGE,
    RecordFit,
    Scores,
)

NEAR_ENOUGH = 1e-5
"""The relative gain in loss after which the steps end: the next one is a small part of sigma."""
NEARLY = 1e-2
"""The same of the steps to the maximum likelihood, from which they begin."""
FAR, NEXT_POLE = 5.0, 3.0
"""The factor between a real pole and the mode beyond which the pole is another one than that of the
roll, and that from each real pole of another beginning to the next one."""
DAMPING, HARDER = 1e-3, 8.0
"""Of the steps: a part of the information's diagonal, and the factor by which it changes. It holds
a pole that all but cancels a zero, along which nothing changes the loss."""

TINY = float(np.finfo(float).tiny)


class RudderEffect(NamedTuple):
    """What the rudder adds to a model; NaN is what is not known.

    ``chance`` is the probability of so large a B by noise alone; ``fit_pct`` the free-run fit and
    ``without_pct`` that without the rudder. Where it was asked for, ``shifted_s`` is the shift in
    time, by an eighth of a period or more, at which the same rudder fits best, ``ratio`` the
    sum of squared residuals there over that of the rudder as it was measured, and ``excess`` the
    latter over that of the innovations.
    """

    chance: float
    fit_pct: float
    without_pct: float
    shifted_s: float = math.nan
    ratio: float = math.nan
    excess: float = math.nan


class _Basis:
    """Columns (n, l) made ready for finding the combinations of them that explain signals."""

    def __init__(self, columns: Floats) -> None:
        power = cross(columns, columns)
        size = np.sqrt(np.maximum(power.diagonal(), TINY))
        power /= size
        power /= size[:, None]
        power.flat[:: len(size) + 1] += RIDGE
        self._columns, self._size, self._power = columns, size[:, None], power

    def coefficients(self, x: Floats) -> Floats:
        """Return the combination (l, m) of the columns that is nearest to x (n, m)."""
        of_scaled = cross(self._columns, x) / self._size
        found: Floats = np.linalg.solve(self._power, of_scaled) / self._size
        return found

    def combined(self, coefficients: Floats) -> Floats:
        """Return the combinations (n, m) of the columns with these coefficients (l, m)."""
        return along(self._columns, coefficients)

    def without(self, x: Floats) -> Floats:
        """Return x (n, m) less what a combination of the columns explains of it."""
        return x - self.combined(self.coefficients(x))


def rudder_fits(record: RecordFit, theta: Floats) -> tuple[float, float, float]:
    """Return the free-run fits in percent, with the rudder and without it, and the loss with it.

    A is that of ``theta`` (n_theta,). B, bias and initial states are the best ones in both cases,
    so that without the rudder the free decay explains as much as it can.
    """
    rest = _driven(record, theta, _decays(record, theta), 0)
    ends = (1, 1 + record.orders.nb[0])
    left = [_Basis(rest[:, first:]).without(rest[:, :1])[:, 0] for first in ends]
    with_it, alone = (
        fit_percent(record.y, record.y - eps) if np.isfinite(eps).all() else math.nan
        for eps in left
    )
    return with_it, alone, float(np.sum(left[0] ** 2))


def best_shift(record: RecordFit, theta: Floats, least: int, most: int) -> tuple[int, float]:
    """Return the shift of the rudder in samples that fits best, and its loss.

    Shifts of ``least`` to ``most`` samples either way are tried, half of ``least`` apart. A is that
    of ``theta`` (n_theta,), all else is fitted again. A rudder that did not move the
    aircraft has no reason to fit best at the time at which it was measured.
    """
    losses, decays = {}, _decays(record, theta)
    later = range(least, most + 1, max(1, least // 2))
    for shift in (*later, *(-each for each in later)):
        rest = _driven(record, theta, decays, shift)
        losses[shift] = float(np.sum(_Basis(rest[:, 1:]).without(rest[:, :1]) ** 2))
    found = min(losses, key=lambda shift: losses[shift])
    return found, losses[found]


def _driven(record: RecordFit, theta: Floats, decays: list[_Basis], shift: int) -> Floats:
    """Return y and the responses of 1/A to each column of B and to the bias, without free decays.

    The rudder comes ``shift`` samples later; what lies beyond a stretch is as at its end.
    """
    na, known, parts = record.orders.na, record.orders.na + sum(record.orders.nb), []
    rudder = slice(na, na + record.orders.nb[0])
    for (y, phi), decay in zip(record.stretches, decays, strict=True):
        inputs = np.column_stack([phi[:, na:known], np.ones(len(y))])
        rows = np.clip(np.arange(len(y)) - shift, 0, len(y) - 1)
        inputs[:, : record.orders.nb[0]] = phi[rows, rudder]
        responses = all_pole(theta[:na], inputs)
        parts.append(decay.without(np.column_stack([y, responses])))
    return np.concatenate(parts)


def _decays(record: RecordFit, theta: Floats) -> list[_Basis]:
    """Return the free decays of A over each stretch."""
    return [_Basis(free_decays(theta[: record.orders.na], len(y))) for y, _ in record.stretches]


class _Run(NamedTuple):
    """The free run of one stretch: what it leaves (n,), its past (na,), the free decays."""

    left: Floats
    past: Floats
    decays: _Basis


class _Descent(NamedTuple):
    """Where the steps of a fit end: theta (n_theta,), its loss, and its free run."""

    theta: Floats
    loss: float
    runs: list[_Run]


def output_error(record: RecordFit, settled: float) -> Floats:
    """Return the theta (n_theta,), C = 1, of least free-run error near that of least loss.

    The steps begin near RML's theta. Where they end without a real pole near the mode, they begin
    again with one: a slow real pole may have been lost on the way, and the mode takes its part,
    which made wn of a 737 6 % too high. That answers if its free-run error is less and the pole is
    still there. They end when the loss gains a smaller share than ``settled``, or than 1e-5.
    """
    begin = record.gauss_newton(max(settled, NEARLY))
    c_of(begin, record.orders)[:] = 0.0
    found = _descended(record, begin, settled)
    poles = _with_real_poles(found.theta[: record.orders.na])
    if poles is not None:
        begin = np.concatenate([poles, np.zeros(len(begin) - len(poles))])
        other = _descended(record, begin, settled)
        if other.loss < found.loss and _with_real_poles(other.theta[: len(poles)]) is None:
            found = other
    record.ran = found.theta, found.runs
    return found.theta


def _with_real_poles(a: Floats) -> Floats | None:
    """Return the A (na,) of the slowest pair of ``a`` (na,) and real poles from its frequency up.

    None where ``a`` has no pair, or a real pole near it already.
    """
    z = np.roots(np.concatenate([[1.0], a])).astype(complex) if len(a) > 2 else np.empty(0)
    pairs, real = np.log(z[z.imag > 0.0]), -np.log(z.real[(z.imag == 0.0) & (z.real > 0.0)])
    if not len(pairs):
        return None
    pair = pairs[np.argmin(np.abs(pairs))]
    wn = float(np.abs(pair))
    if np.any((real > wn / FAR) & (real < FAR * wn)):
        return None
    poles = [pair, pair.conjugate(), *(-wn * NEXT_POLE**k for k in range(len(a) - 2))]
    return np.asarray(np.poly(np.exp(poles)).real[1:])


def _descended(record: RecordFit, theta: Floats, settled: float) -> _Descent:
    """Return where Levenberg's and Marquardt's steps from ``theta`` (n_theta,) end.

    The initial state of each stretch is free and eliminated (Golub and Pereyra 1973).
    """
    free, runs, damping = record.without_c, _runs(record, theta), DAMPING
    loss = _loss(runs)
    for _ in range(ITERATIONS):
        psi = _slopes(record, theta, runs)
        information = cross(psi, psi)
        if not np.isfinite(information).all():
            break
        score = cross(psi, np.concatenate([each.left for each in runs]))
        scale, better = information.diagonal() + TINY, loss
        for _ in range(HALVINGS):
            trial, damped = theta.copy(), information.copy()
            damped.flat[:: len(free) + 1] += damping * scale
            trial[free] += np.linalg.solve(damped, score)
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
    return _Descent(theta, loss, runs)


def free_run_residuals(record: RecordFit, theta: Floats) -> list[Floats]:
    """Return y less the free run (n,) of each stretch, from the initial state that fits best."""
    return [each.left for each in _runs(record, theta)]


def output_error_scores(record: RecordFit, theta: Floats, residuals: list[Floats]) -> Scores:
    """Return psi for the instruments, psi and eps at theta, whose ``residuals`` are known.

    Psi (n, n_theta) is the slope of the free run, without what the initial states take up; it is 0
    for C.
    """
    psi = np.zeros((len(record.y), len(theta)))
    psi[:, record.without_c] = _slopes(record, theta, _runs(record, theta))
    return psi, psi, np.concatenate(residuals)


def _runs(record: RecordFit, theta: Floats) -> list[_Run]:
    """Return the free run of each stretch; that of a fit's own theta is known already."""
    na, runs = record.orders.na, []
    if record.ran[0] is theta:
        return cast("list[_Run]", record.ran[1])
    driving = theta[record.without_c]
    driving[:na] = 0.0
    decayed = _decays(record, theta)
    for (y, _), phi, decays in zip(record.stretches, record.measured, decayed, strict=True):
        drive = along(phi, driving)
        rest = (y - all_pole(theta[:na], drive))[:, None]
        past = decays.coefficients(rest)
        runs.append(_Run((rest - decays.combined(past))[:, 0], past[:, 0], decays))
    return runs


def _slopes(record: RecordFit, theta: Floats, runs: list[_Run]) -> Floats:
    """Return the slope of the free run of all stretches for A, B and the bias, (n, of them)."""
    na, rows = record.orders.na, []
    for (y, _), phi, run in zip(record.stretches, record.measured, runs, strict=True):
        simulated = np.concatenate([run.past[::-1], y - run.left])
        drive = phi.copy()
        for i in range(na):
            drive[:, i] = -simulated[na - 1 - i : len(simulated) - 1 - i]
        rows.append(run.decays.without(all_pole(theta[:na], drive)))
    return np.concatenate(rows)


def _loss(runs: list[_Run]) -> float:
    loss = sum(float(cross(each.left[:, None], each.left)[0]) for each in runs)
    return loss if math.isfinite(loss) else math.inf
