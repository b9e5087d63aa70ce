"""The likelihood of spectra (Whittle), and the parameters of which it is largest.

    L(x) = sum over b of n_b log det S_b + tr(S_b^-1 E_b) + prior,    E_b = M_b Z_b M_b^H
    M = Y - G U        what u = U z leaves of y = Y z

It is minus the logarithm of the likelihood that p, r and roll have given the aileron's own part a
(what feedback leaves of the aileron), so that bands may be left out without bias. Its slope, and
the information by which the steps are scored (Fisher), are

    L_i  = tr(S^-1 S_i (n - S^-1 E)) + 2 Re tr(S^-1 M_i Z M^H)
    F_ij = n tr(S^-1 S_i S^-1 S_j) + 2 Re tr(S^-1 M_i Z M_j^H)

Spectra do not show the sign of a real part: an aircraft that flew is stable, and x stays there.
Without that zeta was -.155 for .201 in one of 20 flights.
"""

import math
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import NAMES as LATERAL
from yawid.lateral.model import modes
from yawid.lateral.roll_law import closed
from yawid.ordinary.model import AT, FREE, Band

LEAST_GAIN = 1e-2
"""The gain of the likelihood's logarithm below which a fit has settled."""
MOST_STEP = 1.0
"""The largest step of a parameter, as a part of it: beyond it the first ones leave all aircraft."""
MOST_GROWTH = 0.3
DIFFERENCE = 1e-6


@dataclass(frozen=True, slots=True)
class Fitted:
    """Parameters x (n,) by NAMES, L, the covariance of those that are FREE, and the band."""

    x: Floats
    loss: float
    covariance: Floats
    band: Band

    @property
    def wn(self) -> float:
        """wn in rad/s of the bare airframe, NaN where it does not oscillate."""
        return float(modes(self.x[None, : len(LATERAL)], self.band.airspeed_m_s)[0, 0])


def loss_of(x: Floats, band: Band) -> float:
    """Return L of parameters x (n,)."""
    G, S = (y[0] for y in band.predict(x[None]))
    _, E = band.left_over(G)
    sign, log = np.linalg.slogdet(S)
    if not (np.isfinite(log).all() and (sign.real > 0.0).all()):
        return math.inf
    fit = band.n * log + np.einsum("bij,bji->b", np.linalg.inv(S), E).real
    return float(fit.sum() + 0.5 * np.sum(((x[FREE] - band.known[0]) / band.known[1]) ** 2))


def slope_of(x: Floats, band: Band) -> tuple[Floats, Floats]:
    """Return the slope (n,) of L by the parameters that are FREE, and the information (n, n)."""
    n, (mean, std) = len(FREE), band.known
    G, S = band.predict(np.vstack([x, x + DIFFERENCE * np.eye(len(x))[FREE]]))
    M, E = band.left_over(G[0])
    dM, inverse = -(G[1:] - G[0]) @ band.inputs() / DIFFERENCE, np.linalg.inv(S[0])
    T = inverse @ (S[1:] - S[0]) / DIFFERENCE
    slope = np.einsum("vbii,b->v", T, band.n) - np.einsum("vbij,bji->v", T, inverse @ E)
    slope += 2.0 * np.einsum("vbij,bji->v", dM, band.Z @ M.conj().swapaxes(-1, -2) @ inverse)
    one = (band.n[:, None, None] * T).reshape(n, -1)
    F = (one @ T.swapaxes(-1, -2).reshape(n, -1).T).real
    bent = (inverse @ dM @ band.Z).reshape(n, -1)
    F += 2.0 * (bent @ dM.conj().reshape(n, -1).T).real
    return slope.real + (x[FREE] - mean) / std**2, F + np.diag(std**-2.0)


def fit(x: Floats, band: Band, steps: int = 40) -> Fitted:
    """Return the best parameters from x (n,) on, at the end of ``steps`` at most.

    Raises:
        numpy.linalg.LinAlgError: the model is not finite.
    """
    damping, loss, lags = 1e-2, loss_of(x, band), [AT["delay"], AT["servo_lag"]]
    for _ in range(steps):
        slope, information = slope_of(x, band)
        for _ in range(10):
            damped = information + damping * np.diag(np.diag(information))
            step, tried = -np.linalg.solve(damped, slope), x.copy()
            most = float(np.max(np.abs(step) / (np.abs(x[FREE]) + 0.5)))
            tried[FREE] += step * min(1.0, MOST_STEP / most)
            tried[lags] = np.maximum(tried[lags], 0.0)
            after = loss_of(tried, band) if is_stable(tried, band) else math.inf
            if after < loss:
                break
            damping = max(5.0 * damping, 1e-4)
        else:
            break
        gain, x, loss, damping = loss - after, tried, after, max(damping / 6.0, 1e-9)
        if gain < LEAST_GAIN:
            break
    return Fitted(x, loss, np.asarray(np.linalg.inv(information), np.float64), band)


def is_stable(x: Floats, band: Band) -> bool:
    """Return whether the aircraft under its roll law is stable, but for a slow spiral.

    The delay counts as a lag. Its aileron rolls to the side that it is called by: without that,
    small aircraft in gusts ended with L_delta_a below 0, and wn up to 18 % off.
    """
    theta = x[None, : len(LATERAL)].copy()
    theta[:, AT["servo_lag"]] += theta[:, AT["delay"]]
    whole = closed(theta, band.airspeed_m_s, band.law)[0]
    if not np.isfinite(whole).all() or not x[AT["L_p"]] < 0.0 < x[AT["L_delta_a"]]:
        return False
    poles = np.linalg.eigvals(whole)[0]
    return not ((poles[poles.imag > 0.05].real > 0.0).any() or (poles.real > MOST_GROWTH).any())
