"""The paper's step responses, read by its formulas and fitted: eq. 4-16, 23.

After a step of height u0 at t = 0, with K and k in y per u::

    first order   y = K u0 (1 - e^(-t/T))                                            eq. 4
    second order  y = k u0 (1 - e^(-D q t)/root sin(q root t + arccos D))            eq. 7
    yaw rate      y = K u0 (T s + 1) w^2 / (s^2 + 2 xi w s + w^2), as time response  eq. 23

with root = sqrt(1 - D^2). Read off the curve: K = y_end/u0 and T where it passes 63 % (eq. 5-6);
k = y_end/u0, and D and q from the overshoot and the time T1 of the first extremum (eq. 8-16).

The record is scaled to run from 0 to 1. The formulas, applied to its moving average, give the
paper's answer. From it ``scipy.optimize.curve_fit`` fits the closed form with a free offset, and
gives the sigmas. A parameter must be clear of its bounds by 3 sigma, as one on a bound is that of
another form: without an overshoot D of eq. 7 is 1.

Printed slips: the limit of eq. 8 is s -> 0; eq. 15 repeats the letters of eq. 12, Delta h/k, and
means Delta y/(k u0).
"""

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product, starmap
from typing import Final

import numpy as np
from scipy.optimize import OptimizeWarning, approx_fprime, curve_fit

from yawid.answers.reports import StepReport, Told
from yawid.blocks import Floats
from yawid.errors import ConfigError, NotIdentifiable

BAND = 0.05
"""The steady state is reached where the fitted form is within this share of its final value; a form
is refused where its systematic misfit exceeds this share of the step."""
FEWEST_SAMPLES = 10
"""The fewest samples after the step."""
SMOOTHING = 0.01
"""Width of the moving average before the reading, as a share of the record."""
CLEAR = 3.0
"""The sigmas by which the response or a misfit must exceed the noise, and a bound its parameter."""


def first_order_response(t: Floats, K: float, T: float) -> Floats:
    """Return c(t) = K (1 - exp(-t/T)) of eq. 4 at t (n,) in s, 0 before t = 0."""
    return np.asarray(-K * np.expm1(-np.maximum(t, 0.0) / T))


def first_order_from_curve(t: Floats, y: Floats) -> tuple[float]:
    """Return T in s by eq. 6: when y (n,), which runs from 0 to 1, has passed 63 %."""
    level = 1.0 - math.exp(-1.0)
    after = max(int(np.argmax(y >= level)), 1)
    return (
        max(
            float(np.interp(level, y[after - 1 : after + 1], t[after - 1 : after + 1])), 0.5 * t[1]
        ),
    )


def second_order_from_curve(t: Floats, y: Floats) -> tuple[float, float]:
    """Return D and q in rad/s by eq. 12 and 13 of y (n,), which runs from 0 to 1 at last.

    The overshoot is exp(-pi D / sqrt(1 - D^2)) by eq. 10 and 11, which is solved for D.

    Raises:
        NotIdentifiable: y has no overshoot between 0 and 100 % after the start: not eq. 7.
    """
    share, t1 = float(y.max()) - 1.0, float(t[np.argmax(y)])
    if not 0.0 < share < 1.0 or not t1 > 0.0:
        raise NotIdentifiable(
            "not the form of eq. 7: the record shows no overshoot between 0 and 100 %"
        )
    D = 1.0 / math.sqrt(1.0 + math.pi**2 / math.log(share) ** 2)
    return D, math.pi / (t1 * math.sqrt(1.0 - D * D))


def yaw_response(t: Floats, K: float, T: float, xi: float, omega: float) -> Floats:
    """Return the yaw rate of eq. 23, K (T s + 1) w^2 / (s^2 + 2 xi w s + w^2), after a unit step.

    ``t`` (n,) in s, T in s, omega in rad/s, 0 <= xi < 1; 0 before t = 0. With T = 0 it is eq. 7.
    """
    t, root = np.maximum(t, 0.0), math.sqrt(1.0 - xi * xi)
    swing = (xi - T * omega) / root * np.sin(omega * root * t) + np.cos(omega * root * t)
    return np.asarray(K * (1.0 - np.exp(-xi * omega * t) * swing))


def yaw_envelope(T: float, xi: float, omega: float) -> tuple[float, float]:
    """Return the height, over K, and the rate in 1/s of the envelope of eq. 23's transient."""
    return math.hypot(1.0, (xi - T * omega) / math.sqrt(1.0 - xi * xi)), xi * omega


def yaw_from_grid(t: Floats, y: Floats) -> tuple[float, float, float]:
    """Return T in s, xi, and omega in rad/s of eq. 23 near y (n,), from a grid of omega and xi.

    Of each pair K and K T are linear. The paper has no formula for these four numbers.
    """
    every = slice(None, None, max(1, len(t) // 400))
    t, y = t[every], y[every]
    slowest, fastest = 2.0 * math.pi / t[-1], math.pi / (2.0 * float(np.median(np.diff(t))))

    def nearest(xi: float, omega: float) -> tuple[float, tuple[float, float, float]]:
        plain = yaw_response(t, 1.0, 0.0, xi, omega)
        terms = np.stack([np.ones(len(t)), plain, yaw_response(t, 1.0, 1.0, xi, omega) - plain])
        (offset, K, KT), *_ = np.linalg.lstsq(terms.T, y, rcond=None)
        return float(np.linalg.norm(y - (offset, K, KT) @ terms)), (float(KT / K), xi, omega)

    omegas = np.geomspace(slowest, max(fastest, 2.0 * slowest), 40).tolist()
    return min(starmap(nearest, product((0.05, 0.15, 0.3, 0.5, 0.8), omegas)))[1]


@dataclass(frozen=True, slots=True)
class Form:
    """One closed form: its words, its parameters, and its functions.

    The first parameter is the gain, the last a time or a frequency. Of all but the gain
    ``envelope`` returns the height, over the gain, and the rate in 1/s of the transient's envelope;
    ``read`` returns them. ``low`` and ``high`` bound them in the fit.
    """

    words: str
    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    response: Callable[..., Floats]
    envelope: Callable[..., tuple[float, float]]
    read: Callable[[Floats, Floats], tuple[float, ...]]


_ANY, _MOST_DAMPED = math.inf, 1.0 - 1e-6
FORMS: Final[Mapping[str, Form]] = {
    "first": Form(
        "first order (eq. 4)", ("K", "T"), (0.0,), (_ANY,),
        first_order_response, lambda T: (1.0, 1.0 / T), first_order_from_curve,
    ),
    "second": Form(  # k q^2 / (s^2 + 2 q D s + q^2)
        "second order (eq. 7)", ("k", "D", "q"), (1e-6, 0.0), (_MOST_DAMPED, _ANY),
        lambda t, k, D, q: yaw_response(t, k, 0.0, D, q),
        lambda D, q: yaw_envelope(0.0, D, q), second_order_from_curve,
    ),
    "yaw": Form(
        "yaw rate (eq. 23)", ("K", "T_theta_s", "xi_beta", "omega_beta"), (-_ANY, 1e-6, 0.0),
        (_ANY, _MOST_DAMPED, _ANY), yaw_response, yaw_envelope, yaw_from_grid,
    ),
}  # fmt: skip


def settling(form: Form, tolerance: float, *p: float) -> float:
    """Return the time in s at which the envelope is the tolerance times the gain.

    ``p`` are all parameters but the gain. Of the first order it is T ln(1/tolerance), by eq. 6.
    """
    height, rate = form.envelope(*p)
    return max(math.log(height / tolerance), 0.0) / rate


def fit_step(
    model: str, t: Floats, y: Floats, u0: float = 1.0, step_time_s: float = 0.0
) -> StepReport:
    """Fit a form of :data:`FORMS` to y (n,) at t (n,) in s, increasing; NaN in y is left out.

    The input steps by u0 at ``step_time_s``. The gain is in y per u, times are in s, frequencies
    in rad/s, the noise is in y's unit. Sigma assumes white noise or, where the residuals are
    correlated, a first-order process. ``formula`` has what the paper's formulas read.

    Raises:
        ConfigError: there are fewer than 10 samples after the step, the times do not increase, a
        value is infinite, or u0 is 0.
        NotIdentifiable: y does not respond to the step, reaches no steady state, shows too little
        of the transient, or has another form.
    """
    t, y = _checked(t, y, u0, step_time_s)
    form, (low, scale, noise) = FORMS[model], _scale(t, y)
    y = (y - low) / scale
    read = form.read(*_smoothed(t, y))
    bounds = np.array([[-np.inf, -np.inf, *form.low], [np.inf, np.inf, *form.high]])
    start = np.clip([0.0, 1.0, *read], *bounds)
    # where it warns the covariance is infinite
    with warnings.catch_warnings(action="ignore", category=OptimizeWarning):
        try:
            p, covariance, more, *_ = curve_fit(
                lambda t, offset, *p: offset + form.response(t, *p), t, y, start, bounds=bounds,
                full_output=True, jac="3-point", xtol=1e-14, ftol=1e-14, gtol=1e-14,
                x_scale=np.maximum(np.abs(start), 1e-3),
            )  # fmt: skip
        except RuntimeError as error:
            raise NotIdentifiable(
                "the record does not have this form, or does not reach a steady state: "
                "the fit does not converge"
            ) from error
    residual = more["fvec"]
    power = float(residual @ residual)
    correlation = float(residual[1:] @ residual[:-1]) / max(power, 1e-300)
    if correlation > 2.0 / math.sqrt(len(t)):  # the samples count for fewer than white noise's
        covariance = covariance * (1.0 + correlation) / max(1.0 - correlation, 1e-3)
    _check(form, t, residual, noise / abs(scale), p, covariance)
    units = np.array([scale / u0, *np.ones(len(read))])
    values, stds = p[1:] * units, np.sqrt(np.diag(covariance))[1:] * np.abs(units)
    found = (Told(value=x, std=std) for x, std in zip(values.tolist(), stds.tolist(), strict=True))
    formula = dict(zip(form.names, map(float, (scale / u0, *read)), strict=True))
    return StepReport(
        model=model,
        parameters=dict(zip(form.names, found, strict=True)),
        formula=None if form.read is yaw_from_grid else formula,
        settling_2pct_s=_settling(form, 0.02, p[2:], covariance[2:, 2:]),
        settling_5pct_s=_settling(form, 0.05, p[2:], covariance[2:, 2:]),
        noise_std=math.sqrt(power / (len(t) - len(p))) * abs(scale),
    )


def _checked(t: Floats, y: Floats, u0: float, step_time_s: float) -> tuple[Floats, Floats]:
    """Return t (n,) in s since the step and y (n,) without NaN; errors as :func:`fit_step`."""
    is_finite = np.isfinite([*t, u0, step_time_s]).all() and not np.isinf(y).any()
    if not is_finite or u0 == 0.0 or not (np.diff(t) > 0.0).all():
        raise ConfigError(
            "t must be finite and increasing, y finite (NaN where missing), u0 finite and not 0, "
            f"got u0 {u0!r} (step at {step_time_s!r} s)"
        )
    t, y = t[np.isfinite(y)] - step_time_s, y[np.isfinite(y)]
    if (after := int(np.sum(t >= 0.0))) < FEWEST_SAMPLES:
        raise ConfigError(f"{after} samples after the step, at least {FEWEST_SAMPLES} are needed")
    return t, y


def _scale(t: Floats, y: Floats) -> tuple[float, float, float]:
    """Return y before the step, its change to the last tenth, and its white noise's sigma."""
    after = int(np.sum(t >= 0.0))
    before, tail = max(len(y) - after, 1), max(1, round(0.1 * after))
    low, scale = float(y[:before].mean()), float(y[-tail:].mean() - y[:before].mean())
    noise = float(np.median(np.abs(np.diff(y)))) / 0.954  # of |x1 - x2|, both N(0, 1)
    if not abs(scale) > CLEAR * noise * math.sqrt(1.0 / before + 1.0 / tail):
        raise NotIdentifiable(
            f"y does not respond to the step: its change of {scale:.3g} is not clear of the noise"
        )
    return low, scale, noise


def _smoothed(t: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the times after the step and the moving average of y over them."""
    after = t >= 0.0
    half = round(0.5 * SMOOTHING * np.count_nonzero(after))
    average = np.ones(2 * half + 1) / (2 * half + 1)
    return t[after][half : -half or None], np.convolve(y[after], average, mode="valid")


def _settling(form: Form, tolerance: float, p: Floats, covariance: Floats) -> Told:
    """Return the settling time in s and its sigma, from p (n,) and its covariance (n, n)."""
    slope = approx_fprime(p, lambda p: settling(form, tolerance, *p), 1e-8 * np.abs(p))
    return Told(
        value=float(settling(form, tolerance, *p)), std=math.sqrt(slope @ covariance @ slope)
    )


def _check(
    form: Form, t: Floats, residual: Floats, noise: float, p: Floats, covariance: Floats
) -> None:
    """Raise NotIdentifiable where the fitted form does not describe the scaled record."""
    step, settling_s = abs(float(p[1])), settling(form, BAND, *p[2:])
    # The mean product of neighbours is the systematic part; that of white noise is about 0.
    after = residual[t >= 0.0], residual[(t >= 0.0) & (t <= 1.5 * settling_s)]
    near = [part[1:] * part[:-1] for part in after if len(part) > FEWEST_SAMPLES]
    power = max(
        [0.0, *(float(x.mean()) - CLEAR * noise**2 / math.sqrt(len(x)) for x in near)]
    )  # less what noise makes by chance
    if power > (BAND * step) ** 2:
        raise NotIdentifiable(
            f"the record does not have this form: the fit misses it by "
            f"{100.0 * math.sqrt(power) / step:.0f} % of the step over the transient"
        )
    if not settling_s <= t[-1]:
        raise NotIdentifiable(
            f"the record does not reach a steady state: it ends {t[-1]:.3g} s after the "
            f"step, the response needs {settling_s:.3g} s"
        )
    std, size = np.sqrt(np.diag(covariance)), np.abs(p) + 1e-3
    clear = np.minimum(p[2:] - form.low, form.high - p[2:]) > CLEAR * std[2:]
    is_known = clear.all() and std[1] < step / CLEAR
    if not is_known or not np.linalg.cond(covariance / np.outer(size, size)) < 1e14:
        lacks = "an overshoot" if (np.isfinite(form.high) & ~clear).any() else "the transient"
        raise NotIdentifiable(f"the record shows too little of {lacks} for the {form.words}")
