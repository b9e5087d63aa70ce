"""K and T, or k, D and q, of a measured step response: the paper's method, then a refinement.

The record comes from a CSV file or as arrays, and is checked and scaled to run from 0 to 1. Eq. 5-6
and 8-16, applied to the record smoothed over a few samples, give the start of a least-squares fit
of the closed form with a free offset, which gives the estimates and their sigma. Several widths of
smoothing are tried, and the fit with the least loss is kept.

The yaw rate after a step of the rudder has neither of these forms but that of eq. 23, which has a
zero: the starts of its fit come from linear fits on a grid of frequencies and damping ratios.
"""

import csv
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from yawid.answers.reports import StepReport, Told
from yawid.blocks import Floats
from yawid.errors import ConfigError, NotIdentifiable, SourceError
from yawid.offline.step_forms import (
    first_order_response,
    first_order_settling,
    overshoot,
    second_order_from_peak,
    second_order_response,
    second_order_settling,
    yaw_response,
    yaw_settling,
)

SETTLED = 0.05
"""The steady state is reached where the fitted form is within this share of its final value."""
MISFIT = 0.05
"""A form is refused where its systematic misfit exceeds this share of the step."""
FEWEST_SAMPLES = 10
"""The fewest samples after the step."""
SMOOTHING = (0.0, 0.01, 0.03)
"""Widths of the moving average before the reading, as shares of the record."""
TAIL = 0.1
"""The share of the record whose mean is read as the steady state."""
GRID_SAMPLES, GRID_OMEGAS, GRID_XIS, GRID_BEST = 400, 30, (0.05, 0.15, 0.3, 0.5, 0.8), 3
"""The grid on which starts for eq. 23 are searched, and how many of them are refined."""
CLEAR = 3.0
"""The number of sigma by which the response, an overshoot or a misfit must exceed the noise."""


def read_step(
    path: Path, u0: float | None = None, step_time_s: float | None = None
) -> tuple[Floats, Floats, float, float]:
    """Return t (n,) in s, y (n,), and the step's height and time in s, of a CSV file (-: stdin).

    The first line names the columns t and y, and u where it was recorded. A height or time that is
    not given is taken from u; without u they are 1 and 0 s. The columns r and rudder of a flight
    record count as y and u. A row of units, other columns and empty lines are ignored; an empty y
    is NaN.

    Raises:
        SourceError: the file cannot be read or is not text.
        ConfigError: a column t or y is missing, a value is not a number, or u is not one step.
    """
    try:
        if str(path) == "-":
            t, y, u = _columns("stdin", sys.stdin)
        else:
            with path.open(newline="", encoding="utf-8-sig") as file:
                t, y, u = _columns(path.name, file)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        why = "it is not a text file" if isinstance(error, UnicodeDecodeError) else why
        raise SourceError(f"{path}: cannot be read: {why}; give a CSV with t and y") from error
    height, time_s = 1.0, 0.0
    if u is not None and (u0 is None or step_time_s is None):
        height, time_s = _step_of(t, u, path)
    return t, y, height if u0 is None else u0, time_s if step_time_s is None else step_time_s


def _columns(name: str, lines: Iterable[str]) -> tuple[Floats, Floats, Floats | None]:
    rows = csv.reader(lines)
    header = [column.strip().lower() for column in next(rows, [])]
    for column, of_record in (("y", "r"), ("u", "rudder")):
        if column not in header:
            header = [column if each == of_record else each for each in header]
    for column in ("t", "y"):
        if header.count(column) != 1:
            raise ConfigError(f"{name}: the first line must name one column t and one y: {header}")
    wanted = ["t", "y"] + ["u"] * (header.count("u") == 1)
    places = [header.index(column) for column in wanted]
    found: list[list[float]] = []
    for row in rows:
        is_units = not found and not any(c.isdigit() for c in "".join(row[: places[0] + 1]))
        if is_units or not any(cell.strip() for cell in row):
            continue
        cells = [row[place].strip() if place < len(row) else "" for place in places]
        try:
            found.append([float(cells[0]), *(float(cell or math.nan) for cell in cells[1:])])
        except ValueError:
            raise ConfigError(f"{name}, line {rows.line_num}: no numbers: {cells}") from None
    table = np.array(found, dtype=np.float64).reshape(-1, len(wanted))
    return table[:, 0], table[:, 1], table[:, 2] if len(wanted) > 2 else None


def _step_of(t: Floats, u: Floats, path: Path) -> tuple[float, float]:
    """Return the height of the only step of u (n,), and its time in s."""
    changes = np.flatnonzero(np.diff(u, prepend=0.0))
    if len(changes) != 1:
        raise ConfigError(
            f"{path}: column u changes {len(changes)} times, and a step is one change from 0: "
            "give --u0 and --step-time to pass over it"
        )
    return float(u[changes[0]]), float(t[changes[0]])


@dataclass(frozen=True, slots=True)
class StepRecord:
    """A checked record: ``t`` in s since the step and scaled ``y`` (n,), from about 0 to about 1.

    y is (measured - ``low``) / ``scale``; ``noise`` is its standard deviation, scaled too.
    """

    t: Floats
    y: Floats
    low: float
    scale: float
    noise: float

    @classmethod
    def checked(
        cls, times: ArrayLike, values: ArrayLike, u0: float, step_time_s: float
    ) -> "StepRecord":
        """Return the record of y (n,) at t (n,) in s; errors as in :func:`fit_first_order`."""
        t, y = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
        if t.ndim != 1 or t.shape != y.shape:
            raise ConfigError(f"t and y must be (n,) alike, got {t.shape} and {y.shape}")
        if not np.isfinite(t).all() or np.isinf(y).any() or not (np.diff(t) > 0.0).all():
            raise ConfigError("t must be finite and increasing and y finite (NaN where missing)")
        if not math.isfinite(u0) or u0 == 0.0 or not math.isfinite(step_time_s):
            raise ConfigError(
                f"u0 must be finite and not 0, got {u0!r} (step at {step_time_s!r} s)"
            )
        t, y = t[np.isfinite(y)] - step_time_s, y[np.isfinite(y)]
        after = int(np.sum(t >= 0.0))
        if after < FEWEST_SAMPLES:
            raise ConfigError(
                f"{after} samples after the step, at least {FEWEST_SAMPLES} are needed"
            )
        before, tail = max(len(y) - after, 1), max(1, round(TAIL * after))
        low, scale = float(y[:before].mean()), float(y[-tail:].mean() - y[:before].mean())
        noise = float(np.median(np.abs(np.diff(y)))) / 0.954  # of |x1 - x2|, both N(0, 1)
        if not abs(scale) > CLEAR * noise * math.sqrt(1.0 / before + 1.0 / tail):
            raise NotIdentifiable(
                f"y does not answer the step: its change of {scale:.3g} is not clear of the noise"
            )
        return cls(t, (y - low) / scale, low, scale, noise / abs(scale))

    def smoothed(self) -> Iterator[tuple[Floats, Floats]]:
        """Yield t and y (m,) from the step on, with y averaged over more and more samples."""
        t, y = self.t[self.t >= 0.0], self.y[self.t >= 0.0]
        for width in sorted({2 * round(0.5 * share * len(y)) + 1 for share in SMOOTHING}):
            mean = np.convolve(y, np.ones(width) / width, mode="valid")
            yield t[width // 2 : len(t) - width // 2], mean


def read_first_order(record: StepRecord) -> Iterator[float]:
    """Yield T in s, when the response reaches 63 % of its final value (eq. 6), per smoothing."""
    level = 1.0 - math.exp(-1.0)
    for t, y in record.smoothed():
        after = int(np.argmax(y >= level))
        if after == 0:
            yield float(max(t[0], 0.5 * (t[1] - t[0])))
            continue
        part = (level - y[after - 1]) / (y[after] - y[after - 1])
        yield float(t[after - 1] + part * (t[after] - t[after - 1]))


def read_second_order(record: StepRecord) -> Iterator[tuple[float, float]]:
    """Yield D and q by eq. 12-13 from the maximum, for each smoothing that shows an overshoot."""
    for t, y in record.smoothed():
        peak, y_max = float(t[np.argmax(y)]), float(y.max())
        if 0.0 < y_max - 1.0 < 1.0 and peak > 0.0:
            _, D, q = second_order_from_peak(1.0, y_max, peak)
            yield D, q


def read_yaw(record: StepRecord) -> list[Floats]:
    """Return the best starts [offset, K, T, xi, ln omega] (5,): eq. 23 is linear in K and K T."""
    every = max(1, len(record.t) // GRID_SAMPLES)
    t, y = record.t[::every], record.y[::every]
    slowest, fastest = 2.0 * math.pi / record.t[-1], math.pi / (2.0 * float(np.median(np.diff(t))))
    found = []
    for omega in np.geomspace(slowest, max(fastest, 2.0 * slowest), GRID_OMEGAS):
        for xi in GRID_XIS:
            plain = second_order_response(t, 1.0, xi, omega)
            per_T = yaw_response(t, 1.0, 1.0, xi, omega) - plain
            terms = np.column_stack([np.ones(len(t)), plain, per_T])
            (offset, K, KT), *_ = np.linalg.lstsq(terms, y, rcond=None)
            left = y - terms @ (offset, K, KT)
            start = np.array([offset, K, KT / K if K else 0.0, xi, math.log(omega)])
            found.append((float(left @ left), start))
    return [start for _, start in sorted(found, key=lambda each: each[0])[:GRID_BEST]]


def fit_first_order(
    t: ArrayLike, y: ArrayLike, u0: float = 1.0, step_time_s: float = 0.0
) -> StepReport:
    """Fit eq. 4 to y (n,) at t (n,) in s, increasing; the input steps by u0 at ``step_time_s``.

    K is in y per u, T and the settling times (eq. 6) are in s, the noise is in y's unit. A NaN in y
    is left out. Sigma assumes white noise or, where the residuals are correlated, a first-order
    process.

    Raises:
        ConfigError: a shape is wrong, there are fewer than 10 samples after the step, the times do
        not increase, a value is infinite, or u0 is 0.
        NotIdentifiable: y does not respond to the step, reaches no steady state, shows too little
        of the transient, or has another form.
    """
    record = StepRecord.checked(t, y, u0, step_time_s)

    def form(p: Floats) -> Floats:
        return first_order_response(record.t, p[1], _exp(p[2]))

    starts = (np.array([0.0, 1.0, math.log(T)]) for T in read_first_order(record))
    fit = _refine(record, form, starts, [-np.inf] * 3, [np.inf] * 3)
    T = _exp(fit.p[2])
    left = math.exp(-record.t[-1] / T)
    _check_form(record, fit, left, first_order_settling(T, SETTLED))

    def settling(tolerance: float) -> list[float]:
        time = first_order_settling(T, tolerance)
        return [time, time]

    return _report("first", record, fit, u0, {"T": _told(T, T * fit.std[2])}, settling)


def fit_second_order(
    t: ArrayLike, y: ArrayLike, u0: float = 1.0, step_time_s: float = 0.0
) -> StepReport:
    """Fit h(t) of eq. 7 to y (n,) at t (n,) in s; the rest as in :func:`fit_first_order`.

    k is in y per u, q in rad/s; the settling times are the envelope's.

    Raises:
        ConfigError: as there.
        NotIdentifiable: as there, or no overshoot is clear of the noise.
    """
    record = StepRecord.checked(t, y, u0, step_time_s)

    def form(p: Floats) -> Floats:
        return second_order_response(record.t, p[1], p[2], _exp(p[3]))

    starts = [np.array([0.0, 1.0, D, math.log(q)]) for D, q in read_second_order(record)]
    if not starts:
        raise NotIdentifiable("not the form of eq. 7: the record shows no overshoot")
    low, high = [-np.inf, -np.inf, 1e-6, -np.inf], [np.inf, np.inf, 1.0 - 1e-9, np.inf]
    fit = _refine(record, form, starts, low, high)
    D, q = float(fit.p[2]), _exp(fit.p[3])
    root = math.sqrt(1.0 - D * D)
    # d ln(overshoot) / dD = -pi / root^3; an overshoot of CLEAR sigma: its logarithm to 1/CLEAR.
    if not overshoot(D) > 1e-6 or not math.pi / root**3 * fit.std[2] < 1.0 / CLEAR:
        raise NotIdentifiable(
            f"not the form of eq. 7: its overshoot of {100.0 * overshoot(D):.2g} % is not clear"
        )
    _check_form(
        record, fit, math.exp(-D * q * record.t[-1]) / root, second_order_settling(D, q, SETTLED)
    )

    def settling(tolerance: float) -> list[float]:
        time = second_order_settling(D, q, tolerance)
        return [time, 1.0 / (q * (1.0 - D * D)) - time / D, -time]

    found = {"D": _told(D, fit.std[2]), "q": _told(q, q * fit.std[3])}
    return _report("second", record, fit, u0, found, settling)


def fit_yaw(t: ArrayLike, y: ArrayLike, u0: float = 1.0, step_time_s: float = 0.0) -> StepReport:
    """Fit eq. 23 to the yaw rate y (n,) at t (n,) in s; the rest as in :func:`fit_first_order`.

    K is in y per u, T_theta in s, omega_beta in rad/s; the settling times are the envelope's.

    Raises:
        ConfigError, NotIdentifiable: as there.
    """
    record = StepRecord.checked(t, y, u0, step_time_s)

    def form(p: Floats) -> Floats:
        return yaw_response(record.t, p[1], p[2], p[3], _exp(p[4]))

    low = [-np.inf, -np.inf, -np.inf, 1e-6, -np.inf]
    high = [np.inf, np.inf, np.inf, 1.0 - 1e-9, np.inf]
    fit = _refine(record, form, read_yaw(record), low, high)
    T, xi, omega = float(fit.p[2]), float(fit.p[3]), _exp(fit.p[4])
    left = SETTLED * math.exp(xi * omega * (yaw_settling(T, xi, omega, SETTLED) - record.t[-1]))
    _check_form(record, fit, left, yaw_settling(T, xi, omega, SETTLED))
    root = math.sqrt(1.0 - xi * xi)

    def settling(tolerance: float) -> list[float]:
        time = yaw_settling(T, xi, omega, tolerance)
        miss = (xi - T * omega) / root
        turn = miss / (1.0 + miss * miss) / (xi * omega)
        of_xi = turn * (1.0 / root + miss * xi / root**2) - time / xi
        return [time, -turn * omega / root, of_xi, -turn * T * omega / root - time]

    found = {"T_theta_s": _told(T, fit.std[2]), "omega_beta": _told(omega, omega * fit.std[4])}
    found["xi_beta"] = _told(xi, fit.std[3])
    return _report("yaw", record, fit, u0, found, settling)


def _report(
    model: str, record: StepRecord, fit: "_Fit", u0: float, found: dict[str, Told],
    settling: Callable[[float], list[float]],
) -> StepReport:  # fmt: skip
    """Return the result of a fit, whose parameters but the gain are ``found``.

    ``settling`` returns the time for a tolerance, and its slopes by the fit's parameters from the
    third one on.
    """
    scale, times = record.scale / u0, []
    for tolerance in (0.02, 0.05):
        time, *slopes = settling(tolerance)
        times.append(_told(time, math.sqrt(slopes @ fit.covariance[2:, 2:] @ slopes)))
    gain = "k" if model == "second" else "K"
    return StepReport(
        model=model,
        parameters={gain: _told(fit.p[1] * scale, fit.std[1] * scale)} | found,
        settling_2pct_s=times[0],
        settling_5pct_s=times[1],
        noise_std=float(fit.noise_std * abs(record.scale)),
    )


def _told(value: float, std: float) -> Told:
    return Told(value=float(value), std=abs(float(std)))


def _exp(exponent: float) -> float:
    """Return e^exponent within the range of floats: times and frequencies are fitted as ln."""
    return math.exp(min(max(exponent, -300.0), 300.0))


@dataclass(frozen=True, slots=True)
class _Fit:
    """Parameters ``p`` (n,) on the scaled record, their covariance (n, n), and the residual."""

    p: Floats
    covariance: Floats
    residual: Floats
    noise_std: float

    @property
    def std(self) -> list[float]:
        return [math.sqrt(variance) for variance in np.diag(self.covariance)]


def _refine(
    record: StepRecord, form: Callable[[Floats], Floats], starts: Iterable[Floats],
    low: list[float], high: list[float],
) -> _Fit:  # fmt: skip
    """Return the best fit of the offset p[0] plus form(p), made from each start."""

    def misses(p: Floats) -> Floats:
        return np.asarray(record.y - p[0] - form(p))

    options = {"jac": "3-point", "xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14, "x_scale": 1.0}
    found = [least_squares(misses, start, bounds=(low, high), **options) for start in starts]
    best = min(found, key=lambda result: float(result.cost))
    p, residual, n = best.x, best.fun, len(best.fun)
    variance = 2.0 * best.cost / (n - len(p))
    information = best.jac.T @ best.jac
    if not np.linalg.cond(information) < 1e14:
        raise NotIdentifiable("the record has too few samples in the transient")
    correlation = float(residual[1:] @ residual[:-1]) / max(2.0 * best.cost, 1e-300)
    if correlation > 2.0 / math.sqrt(n):  # more than white noise has: the samples count for fewer
        variance *= (1.0 + correlation) / max(1.0 - correlation, 1e-3)
    covariance = np.linalg.inv(information) * variance
    return _Fit(p, covariance, residual, math.sqrt(2.0 * best.cost / (n - len(p))))


def _check_form(record: StepRecord, fit: _Fit, left: float, settling_s: float) -> None:
    """Raise NotIdentifiable where the fitted form does not describe the record.

    ``left`` is the share of the transient that is left at the end of the record.
    """
    step = abs(float(fit.p[1]))
    # The mean product of neighbours is the systematic part; that of white noise is about 0.
    after = record.t >= 0.0
    residuals = [fit.residual[after], fit.residual[after & (record.t <= 1.5 * settling_s)]]
    products = [r[1:] * r[:-1] for r in residuals if len(r) > FEWEST_SAMPLES]
    power = max([0.0, *(float(p.mean()) - _chance(record, len(p)) for p in products)])
    if power > (MISFIT * step) ** 2:
        raise NotIdentifiable(
            f"the record does not have this form: the fit misses it by "
            f"{100.0 * math.sqrt(power) / step:.0f} % of the step over the transient"
        )
    if not left <= SETTLED:
        raise NotIdentifiable(
            f"the record does not reach a steady state: it ends {record.t[-1]:.3g} s after the "
            f"step, the response needs {settling_s:.3g} s"
        )
    if not (fit.std[1] < step / CLEAR and fit.std[-1] < 1.0 / CLEAR):
        raise NotIdentifiable("the record shows too little of the transient to find gain and time")


def _chance(record: StepRecord, count: int) -> float:
    """Return a limit that the mean product of ``count`` pairs of white noise rarely exceeds."""
    return CLEAR * record.noise**2 / math.sqrt(count)
