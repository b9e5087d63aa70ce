"""What an identified model says, as curves with their sigma, and what its residuals say of it.

All sigmas by the delta method from the covariance of theta; the derivatives are exact. With q^-1
the delay and X = B/A u the model's answer,

    dX/da_i = -(q^-i / A) X,    dX/db_i = (q^-(nk+i-1) / A) u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from yawid.blocks import Floats
from yawid.physics.model_response import step_response
from yawid.physics.modes import discrete_poles
from yawid.report.data import Model

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Response:
    """G(e^jw) of rudder to yaw rate at ``frequency_hz`` (n,), sigma of ln|G| and of the angle."""

    frequency_hz: Floats
    G: Complexes
    log_magnitude_std: Floats
    phase_std_rad: Floats


def frequency_band(model: Model, frequency_hz: Floats) -> Response:
    """Return the frequency response of the first input with its sigma."""
    na, nb, nk = model.orders.na, model.orders.nb[0], model.orders.nk[0]
    z = np.exp(2j * np.pi * frequency_hz * model.sample_time_s)
    delays = z[:, None] ** -np.arange(1, na + 1)
    forward = z[:, None] ** -(nk + np.arange(nb))
    denominator = 1.0 + delays @ model.theta[:na]
    numerator = forward @ model.theta[na : na + nb]
    # d ln G: its real part is that of ln|G|, its imaginary part that of the angle.
    slopes = np.hstack([-delays / denominator[:, None], forward / numerator[:, None]])
    covariance = model.covariance[: na + nb, : na + nb]
    real, imaginary = (_sigma(part, covariance) for part in (slopes.real, slopes.imag))
    return Response(frequency_hz, numerator / denominator, real, imaginary)


def step_band(model: Model, steps: int) -> tuple[Floats, Floats]:
    """Return the yaw rate (steps,) after a unit step of the first input, and its sigma."""
    na, nb, nk = model.orders.na, model.orders.nb[0], model.orders.nk[0]
    answer = step_response(model.theta, model.orders, steps)
    a = np.concatenate([[1.0], model.theta[:na]])
    by_a = [-lfilter(_delay(i), a, answer) for i in range(1, na + 1)]
    by_b = [lfilter(_delay(nk + i), a, np.ones(steps)) for i in range(nb)]
    covariance = model.covariance[: na + nb, : na + nb]
    return answer, _sigma(np.column_stack([*by_a, *by_b]), covariance)


def _delay(count: int) -> Floats:
    return np.concatenate([np.zeros(count), [1.0]])


def _sigma(slopes: Floats, covariance: Floats) -> Floats:
    variance = np.einsum("ki,ij,kj->k", slopes, covariance, slopes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def zeros(model: Model) -> Complexes:
    """Return the zeros of B(z) of the first input, those at infinity left out."""
    first = model.orders.na
    b = model.theta[first : first + model.orders.nb[0]]
    return np.asarray(np.roots(np.trim_zeros(b, "f")), dtype=np.complex128)


def poles_with_sigma(model: Model) -> tuple[Complexes, Floats]:
    """Return the poles z (na,) and the covariance (na, 2, 2) of their real and imaginary part."""
    na = model.orders.na
    z = discrete_poles(model.theta[None, :na])[0]
    distance = z[:, None] - z[None, :] + np.eye(na)
    with np.errstate(divide="ignore", invalid="ignore"):
        dz = -(z[:, None] ** np.arange(na - 1, -1, -1)) / np.prod(distance, axis=1)[:, None]
    parts = np.stack([dz.real, dz.imag], axis=1)
    return z, parts @ model.covariance[:na, :na] @ parts.transpose(0, 2, 1)


def correlation(x: Floats, v: Floats, lags: int) -> tuple[Floats, Floats, int]:
    """Return r(l) = corr(x(k), v(k-l)) and l for l = -lags..lags, and the number of samples.

    ``x``, ``v`` (n,); rows where either is NaN count as their mean.
    """
    good = np.isfinite(x) & np.isfinite(v)
    count = int(good.sum())
    if count < 3 or not (x[good].std() > 0.0 and v[good].std() > 0.0):
        return np.zeros(2 * lags + 1), np.arange(-lags, lags + 1, dtype=np.float64), count
    p, q = (np.where(good, (s - s[good].mean()) / s[good].std(), 0.0) for s in (x, v))
    n = len(p)
    ahead = [float(p[lag:] @ q[: n - lag]) / count for lag in range(min(lags, n - 1) + 1)]
    behind = [float(p[: n - lag] @ q[lag:]) / count for lag in range(min(lags, n - 1) + 1)]
    r = np.array([*behind[:0:-1], *ahead])
    half = len(r) // 2
    return r, np.arange(-half, half + 1, dtype=np.float64), count
