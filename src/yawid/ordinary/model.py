"""What gusts, turns and noise make of p, r and roll, frequency by frequency.

A is the airframe's of ``lateral/model.py``. With s = j w, and D(s) the servo after a command,

    D(s) = exp(-s delay) / (1 + s servo_lag),   k = [0, kp, 0, kf + ki / s]   of beta, p, r, roll
    (s I - A + B D k) x = B D (a - k e) + [g/V, 0, 0, 0] f1 + [0, 0, 0, 1] f2 + gusts
    B = [0, L_delta_a, N_delta_a, 0]        with the rudder that follows the aileron in it
    lateral gust b:   [Y_beta, L_beta + f(s) L_r, N_beta + f(s) N_r, 0] b,   f = c s / (1 + s T)
    rolling gust w:   [0, L_p, N_p, 0] w
                      |b|^2 = 2 g b0^2 / (w^2 + g^2),    |w|^2 = w0^2 / (1 + (w / g_w)^2)
    white moment of yaw n0, and the white noise e_p, e_r, e_roll of what is measured

    y = G u + e,   u = [a, f1, f2],   cov e = S = H H^H + diag(0, sigma_r^2, 0)

``frozen``, c, is 1 in a field of gusts that is passed, whose yaw rate is then that of its slope,
and 0 where each gust is the same over all of the aircraft. The span does not feel what is shorter
than itself: T, of ``log_span_lag``, is 3 b / (pi V) in MIL-F-8785C, with the span b.
"""

import math
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import NAMES as LATERAL
from yawid.lateral.model import PARAMETERS, Guess, Law, P, airframe
from yawid.lateral.model import ROLL as ROLL_ANGLE
from yawid.ordinary.spectra import AILERON, ROLL, Complex
from yawid.quantities.airspeed import GRAVITY

NAMES = (*LATERAL, "frozen", "log_span_lag")
"""The parameters x: those of ``lateral/model.py`` come first."""
AT = {name: i for i, name in enumerate(NAMES)}
FREE = np.array([AT[name] for name in (
    "log_Y_beta", "L_beta", "L_p", "L_r", "L_delta_a", "N_beta", "N_p", "N_r", "N_delta_a",
    "alpha", "delay", "servo_lag", "frozen", "log_span_lag", "log_gust", "log_roll_gust",
    "log_yaw_gust", "log_sigma_p", "log_sigma_roll", "log_sigma_r", "log_gust_rate",
    "log_roll_gust_rate",
)])  # fmt: skip
"""Which of them a fit seeks; the others are 0, or of no effect."""
FROZEN, SPAN = (0.5, 0.5), (0.5, 0.7)
"""Mean and sigma of c: 0 in JSBSim, whose gusts are north and east of the earth, 1 in nature. With
c = 1 for all every zeta in JSBSim's turbulence was .05 low. And of T: the mean in 1/wn, and sigma
of its logarithm. Without it wn was 3 to 18 % off in a frozen field (2.5 to 10 rad/s)."""
UNKNOWN_SIZES = "log_gust", "log_roll_gust", "log_yaw_gust", "log_sigma_p"
SIZE_STD = 3.0
"""Sigma of a size's logarithm: without it one that is 0, as a gust in calm air, has no end, and the
step towards it stops every other parameter: 11 of 20 fits ended in a false place."""


def known_before(guess: Guess) -> tuple[Floats, Floats]:
    """Return mean and sigma (n,) of what is known of FREE beforehand; inf: nothing."""
    own = {name: (guess.start[name], SIZE_STD) for name in UNKNOWN_SIZES}
    own |= {"frozen": FROZEN, "log_span_lag": (math.log(SPAN[0] / guess.wn), SPAN[1])}
    shared = {each.name: each.prior(guess) for each in PARAMETERS if each.prior}
    mean, std = np.array([(shared | own).get(NAMES[i], (0.0, np.inf)) for i in FREE]).T
    return mean, std


@dataclass(frozen=True, slots=True)
class Band:
    """Spectra at frequencies ``w`` (b,) in rad/s, their model, and its likelihood.

    ``n`` (b,) counts; ``Z`` (b, 6, 6) sums z z^H, with f1 and f2 for f and g of ``spectra.py``.
    They are of one airspeed and under one roll law. ``known`` is what :func:`known_before` gives.
    """

    w: Floats
    n: Floats
    Z: Complex
    airspeed_m_s: float
    law: Law
    known: tuple[Floats, Floats]

    def predict(self, x: Floats) -> tuple[Complex, Complex]:
        """Return G (v, b, 3, 3) from [a, f1, f2] to p, r, roll, and S (v, b, 3, 3), of x (v, n)."""
        o, s, w = dict(zip(NAMES, x.T[:, :, None], strict=True)), 1j * self.w, self.w
        A, B = airframe(x[:, : len(LATERAL)], self.airspeed_m_s)
        A, k = A[:, None, :4, :4], self.feedback()
        servo = np.exp(-s * o["delay"]) / (1.0 + s * o["servo_lag"])
        rate, roll_rate = np.exp(o["log_gust_rate"]), np.exp(o["log_roll_gust_rate"])
        passing = np.exp(o["log_gust"]) * np.sqrt(2.0 * rate / (w**2 + rate**2))
        rolling = np.exp(o["log_roll_gust"]) / np.sqrt(1.0 + (w / roll_rate) ** 2)
        turning = o["frozen"] * s / (1.0 + s * np.exp(o["log_span_lag"]))
        moments = np.array([0.0, 1.0, 1.0, 0.0])
        heard = np.exp(np.stack([o["log_sigma_p"], o["log_sigma_roll"]], axis=-1))
        D = np.zeros((*servo.shape, 4, 8), complex)
        D[..., 0] = servo[..., None] * B[:, None, :4, 0]
        D[..., 0, 1], D[..., 3, 2] = GRAVITY / self.airspeed_m_s, 1.0
        D[..., 3] = passing[..., None] * (A[..., 0] + turning[..., None] * moments * A[..., 2])
        D[..., 4] = rolling[..., None] * moments * A[..., 1]
        D[..., 2, 5] = np.exp(o["log_yaw_gust"])
        D[..., 6:] = -D[..., :1] * (heard * k[:, [P, ROLL_ANGLE]])[..., None, :]
        X = np.linalg.solve(s[:, None, None] * np.eye(4) - A + D[..., :1] * k[:, None], D)
        X = X[..., 1:, :]
        X[..., [0, 2], [6, 7]] += heard
        S = X[..., 3:] @ X[..., 3:].conj().swapaxes(-1, -2)
        S[..., 1, 1] += np.exp(2.0 * o["log_sigma_r"])
        return np.asarray(X[..., :3], np.complex128), np.asarray(S, np.complex128)

    def feedback(self) -> Complex:
        """Return k (b, 4)."""
        k = np.zeros((len(self.w), 4), complex)
        k[:, P] = self.law.rate_gain
        k[:, ROLL_ANGLE] = self.law.roll_gain + self.law.integral_gain / (1j * self.w)
        return k

    def inputs(self) -> Complex:
        """Return U (b, 3, 6), which makes [a, f1, f2] of the six signals."""
        U, k = np.zeros((len(self.w), 3, 6), complex), self.feedback()
        U[:, 0, 0], U[:, 0, ROLL], U[:, 0, AILERON] = k[:, P], k[:, ROLL_ANGLE], 1.0
        U[:, 1, 4] = U[:, 2, 5] = 1.0
        return U

    def left_over(self, G: Complex) -> tuple[Complex, Complex]:
        """Return M (b, 3, 6) and E (b, 3, 3)."""
        M = np.eye(3, 6) - G @ self.inputs()
        return M, M @ self.Z @ M.conj().swapaxes(-1, -2)
