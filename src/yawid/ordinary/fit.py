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
from yawid.lateral.model import AT, Guess
from yawid.lateral.roll_law import closed
from yawid.ordinary.model import FREE, FREE_AT, FROZEN, OUTPUTS, SPAN, Model, full, prior_of
from yawid.ordinary.spectra import ROLL, Band, Complex, R
from yawid.ordinary.spectra import P as ROLL_RATE
from yawid.quantities.airspeed import GRAVITY

LEAST_GAIN = 1e-2
"""The gain of the likelihood's logarithm below which a fit has settled."""
MOST_STEP = 2.0
"""The largest step, in scales of the parameters: beyond it the first steps leave all aircraft."""
MOST_GROWTH = 0.3
_DIFFERENCE = 1e-6


@dataclass(frozen=True, slots=True)
class Fitted:
    """Parameters x (n,) by FREE, L, the covariance (n, n), and the bands, model and guess."""

    x: Floats
    loss: float
    covariance: Floats
    band: Band
    model: Model
    guess: Guess


def left_over(band: Band, model: Model, G: Complex) -> tuple[Complex, Complex]:
    """Return M (b, 3, 6) and E (b, 3, 3)."""
    M = OUTPUTS - G @ model.inputs()
    return M, M @ band.Z @ M.conj().swapaxes(-1, -2)


def loss_of(x: Floats, band: Band, model: Model, prior: tuple[Floats, Floats]) -> float:
    """Return L of parameters x (n,)."""
    G, S = model.at(x)
    _, E = left_over(band, model, G)
    sign, log = np.linalg.slogdet(S)
    if not (np.isfinite(log).all() and (sign.real > 0.0).all()):
        return math.inf
    fit = band.n * log + np.einsum("bij,bji->b", np.linalg.inv(S), E).real
    return float(fit.sum() + 0.5 * np.sum(((x - prior[0]) / prior[1]) ** 2))


def slope_of(
    x: Floats, band: Band, model: Model, prior: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Return the slope (n,) of L by x, and the information (n, n)."""
    n = len(x)
    G, S = model.predict(np.vstack([x, x + _DIFFERENCE * np.eye(n)]))
    M, E = left_over(band, model, G[0])
    dM, inverse = -(G[1:] - G[0]) @ model.inputs() / _DIFFERENCE, np.linalg.inv(S[0])
    T = inverse @ (S[1:] - S[0]) / _DIFFERENCE
    slope = np.einsum("vbii,b->v", T, band.n) - np.einsum("vbij,bji->v", T, inverse @ E)
    slope += 2.0 * np.einsum("vbij,bji->v", dM, band.Z @ M.conj().swapaxes(-1, -2) @ inverse)
    one = (band.n[:, None, None] * T).reshape(n, -1)
    F = (one @ T.swapaxes(-1, -2).reshape(n, -1).T).real
    bent = (inverse @ dM @ band.Z).reshape(n, -1)
    F += 2.0 * (bent @ dM.conj().reshape(n, -1).T).real
    return slope.real + (x - prior[0]) / prior[1] ** 2, F + np.diag(prior[1] ** -2.0)


def fit(x: Floats, band: Band, model: Model, guess: Guess, steps: int = 60) -> Fitted:
    """Return the best parameters from x (n,) on, at the end of ``steps`` at most.

    Raises:
        numpy.linalg.LinAlgError: the model is not finite.
    """
    prior, scales = prior_of(guess)
    damping, loss = 1e-2, loss_of(x, band, model, prior)
    for _ in range(steps):
        slope, information = slope_of(x, band, model, prior)
        for _ in range(10):
            damped = information + damping * np.diag(np.diag(information))
            step = np.asarray(-np.linalg.solve(damped, slope), np.float64)
            tried = x + step * min(1.0, MOST_STEP / float(np.max(np.abs(step) / scales)))
            for name in ("delay", "servo_lag"):
                tried[FREE_AT[name]] = max(tried[FREE_AT[name]], 0.0)
            after = loss_of(tried, band, model, prior) if is_stable(tried, model) else math.inf
            if after < loss:
                break
            damping = max(5.0 * damping, 1e-4)
        else:
            break
        gain, x, loss, damping = loss - after, tried, after, max(damping / 6.0, 1e-9)
        if gain < LEAST_GAIN:
            break
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    return Fitted(x, loss, covariance, band, model, guess)


def is_stable(x: Floats, model: Model) -> bool:
    """Return whether the aircraft under its roll law is stable, but for a slow spiral.

    The delay counts as a lag. Its aileron rolls to the side that it is called by: without that,
    small aircraft in gusts ended with L_delta_a below 0, and wn up to 18 % off.
    """
    theta = full(x[None])
    theta[:, AT["servo_lag"]] += theta[:, AT["delay"]]
    whole = closed(theta, model.airspeed_m_s, model.law)[0]
    if not np.isfinite(whole).all() or not x[FREE_AT["L_p"]] < 0.0 < x[FREE_AT["L_delta_a"]]:
        return False
    poles = np.linalg.eigvals(whole)[0]
    return not ((poles[poles.imag > 0.05].real > 0.0).any() or (poles.real > MOST_GROWTH).any())


def start_at(
    wn: float, wide: Band, model: Model, pitch: float, noise: Floats
) -> tuple[Floats, Guess]:
    """Return parameters (n,) of a plausible aircraft of this wn in rad/s, and what they guess.

    Its rolling moment is by equation error, with the sideslip that p, r and roll imply. ``noise``
    (3,) has the logarithms of the noise of p, r and roll.
    """
    w, n, Z = wide.w, wide.n, wide.Z
    s, lag = 1j * w, 1.0 / (1j * w + 0.12 * wn)
    T = np.zeros((len(w), 4, 6), complex)
    T[:, 0, ROLL_RATE], T[:, 0, R] = pitch * lag, -lag
    T[:, 0, ROLL] = GRAVITY / model.airspeed_m_s * lag
    T[:, 1, ROLL_RATE] = T[:, 2, R] = 1.0
    T[:, 3] = model.inputs()[:, 0]
    XX = (T @ Z @ T.conj().swapaxes(-1, -2)).real.sum(0)
    Xp = (T @ Z[:, :, :1] * s.conj()[:, None, None])[..., 0].real.sum(0)
    by = np.linalg.solve(XX + np.diag(1e-6 * np.diag(XX) + 1e-12), Xp)
    at = max(int(np.argmin(np.abs(w - wn))) - 1, 0)
    near = float(np.mean(Z[at : at + 3, R, R].real / n[at : at + 3])) + 1e-14
    L_p = -max(-float(by[1] + by[3] * model.law.rate_gain), 1.5 * wn)
    start = dict.fromkeys(FREE, 0.0) | {
        "log_Y_beta": math.log(0.12 * wn), "L_beta": -1.5 * wn**2,
        "L_p": L_p, "L_r": 0.2 * wn, "L_delta_a": max(float(by[3]), -L_p),
        "N_beta": wn**2, "N_p": -0.05 * wn, "N_r": -0.25 * wn,
        "alpha": pitch, "delay": 0.01, "servo_lag": 0.04,
        "frozen": FROZEN[0], "log_span_lag": math.log(SPAN[0] / wn),
        "log_gust": 0.5 * math.log(near * 0.16 * wn**2 / (0.3 * wn)),
        "log_gust_rate": math.log(0.15 * wn),
        "log_roll_gust": 0.5 * math.log(float(np.median(Z[:, 0, 0].real / n)) + 1e-14),
        "log_roll_gust_rate": math.log(1.5 * wn), "log_yaw_gust": 0.5 * math.log(near) - 1.0,
        "log_sigma_p": noise[0], "log_sigma_r": noise[1], "log_sigma_roll": noise[2],
        "N_delta_r": 0.0,
    }  # fmt: skip
    x = np.array([start[name] for name in FREE])
    if not is_stable(x, model):
        x[FREE_AT["N_r"]], x[FREE_AT["L_r"]], x[FREE_AT["N_p"]] = -0.8 * wn, 0.0, 0.0
    return x, Guess(start, wn, pitch)
