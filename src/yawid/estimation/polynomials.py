"""The polynomials A, B, C in theta: names, lags, regressors, and properties of C(q)."""

import numpy as np

from yawid.blocks import Floats, shifted
from yawid.config.estimator import ArmaxOrders
from yawid.errors import ConfigError

FREQUENCIES = 512
"""Number of frequencies at which the positive-real condition is checked."""


def parameter_names(
    orders: ArmaxOrders, inputs: tuple[str, ...] = ("rudder",), bias: bool = True
) -> tuple[str, ...]:
    """Return theta's names: a1.., b1.. of the first input, b1_<input>.. of others, c1.., bias.

    Raises:
        ConfigError: the number of inputs differs from that of the orders.
    """
    if len(inputs) != orders.n_inputs:
        raise ConfigError(f"{len(inputs)} input names for orders with {orders.n_inputs} inputs")
    names = [f"a{i + 1}" for i in range(orders.na)]
    for j, (name, nb) in enumerate(zip(inputs, orders.nb, strict=True)):
        names += [f"b{i + 1}" + (f"_{name}" if j else "") for i in range(nb)]
    names += [f"c{i + 1}" for i in range(orders.nc)]
    return (*names, "bias") if bias else tuple(names)


def c_of(theta: Floats, orders: ArmaxOrders) -> Floats:
    """Return c1..c_nc (..., nc), a view of theta (..., n)."""
    first = orders.na + sum(orders.nb)
    return theta[..., first : first + orders.nc]


def lag_depth(orders: ArmaxOrders) -> int:
    """Return the number of earlier samples of y and u that phi(k) needs (eq. 32)."""
    inputs = [nb + nk - 1 for nb, nk in zip(orders.nb, orders.nk, strict=True) if nb > 0]
    return max([0, orders.na, *inputs])


def known_regressors(u: Floats, y: Floats, orders: ArmaxOrders, bias: bool) -> Floats:
    """Return the measured columns of phi over a record: -y(k-1).., u(k-nk).., 1 (eq. 32).

    ``u`` (samples, n_inputs), ``y`` (samples,); the result (samples, n_theta - nc) has the order of
    theta without c1... It is NaN where a lag lies before the record or on a missing sample.
    """
    columns = [-shifted(y, i + 1) for i in range(orders.na)]
    for j, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
        columns += [shifted(u[:, j], nk + i) for i in range(nb)]
    if bias:
        columns.append(np.ones(len(y)))
    return np.column_stack(columns) if columns else np.empty((len(y), 0))


def spr_margin(c: Floats) -> float:
    """Return the minimum over frequency of Re(1/C(e^jw)) - 1/2, without unit.

    The convergence of ELS is certain only where it is > 0 (Ljung 1977; Ljung and Soderstrom 1983,
    section 4.4). ``c`` (nc,) without its leading 1.
    """
    w = np.linspace(0.0, np.pi, FREQUENCIES)
    powers = np.exp(-1j * np.outer(w, np.arange(len(c) + 1)))
    response = powers @ np.concatenate([[1.0], c])
    with np.errstate(divide="ignore", invalid="ignore"):
        real = response.real / np.abs(response) ** 2
    return float(np.min(real)) - 0.5


def reflected(c: Floats) -> Floats:
    """Return ``c`` (nc,) with the zeros of C(q) outside the unit circle reflected into it.

    The reflection keeps the shape of the spectrum. Then zeros beyond a radius of 0.98 are moved to
    that radius, which changes it a little. All are 0 where a coefficient is not finite.
    """
    if not len(c) or not np.isfinite(c).all():
        return np.zeros_like(c)
    zeros = np.roots(np.concatenate([[1.0], c]))
    outside = np.abs(zeros) >= 1.0
    zeros[outside] = 1.0 / np.conj(zeros[outside])
    zeros *= np.minimum(1.0, 0.98 / np.maximum(np.abs(zeros), 1e-300))
    return np.asarray(np.real(np.poly(zeros))[1:], dtype=np.float64)
