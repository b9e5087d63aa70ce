"""What gusts, turns and noise make of p, r and roll, frequency by frequency, with its slopes.

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
from yawid.lateral.model import AT, NAMES, PARAMETERS, Guess, Law, P, airframe
from yawid.lateral.model import ROLL as ROLL_ANGLE
from yawid.ordinary.spectra import AILERON, ROLL, Complex
from yawid.quantities.airspeed import GRAVITY

STRUCTURE = (
    "log_Y_beta", "L_beta", "L_p", "L_r", "L_delta_a", "N_beta", "N_p", "N_r", "N_delta_a",
    "alpha", "delay", "servo_lag",
)  # fmt: skip
"""The parameters that are free and on which G depends."""
SIZES = {
    "log_gust": 0,
    "log_roll_gust": 1,
    "log_yaw_gust": 2,
    "log_sigma_p": 3,
    "log_sigma_roll": 4,
}
"""The logarithms of sizes, and the column of H that each scales."""
FREE = (
    *STRUCTURE,
    "frozen",
    "log_span_lag",
    *SIZES,
    "log_sigma_r",
    "log_gust_rate",
    "log_roll_gust_rate",
)
FREE_AT = {name: i for i, name in enumerate(FREE)}
FROZEN, SPAN = (0.5, 0.5), (0.5, 0.7)
"""Mean and sigma of c: 0 in JSBSim, whose gusts are north and east of the earth, 1 in nature. With
c = 1 for all every zeta in JSBSim's turbulence was .05 low. And of T: the mean in 1/wn, and sigma
of its logarithm. Without it wn was 3 to 18 % off in a frozen field (2.5 to 10 rad/s)."""
UNKNOWN_SIZES = "log_gust", "log_roll_gust", "log_yaw_gust", "log_sigma_p"
SIZE_STD = 3.0
"""Sigma of a size's logarithm: without it one that is 0, as a gust in calm air, has no end, and the
step towards it stops every other parameter: 11 of 20 fits ended in a false place."""
_DIFFERENCE = 1e-4
_PARAMETER = {each.name: each for each in PARAMETERS}
Prior = tuple[Floats, Floats]


def prior_of(guess: Guess) -> tuple[Prior, Floats]:
    """Return what is known of x beforehand, mean and sigma (inf: nothing), and its scales (n,)."""
    rows = []
    for name in FREE:
        each = _PARAMETER.get(name)
        prior, scale = (None, 0.3) if each is None else (each.prior, each.scale(guess))
        if name == "frozen":
            mean, std = FROZEN
        elif name == "log_span_lag":
            mean, std = math.log(SPAN[0] / guess.wn), SPAN[1]
        elif name in UNKNOWN_SIZES:
            mean, std = guess.start[name], SIZE_STD
        else:
            mean, std = prior(guess) if prior is not None else (0.0, np.inf)
        rows.append((mean, std, scale))
    mean, std, scales = np.array(rows).T
    return (mean, std), scales


def full(x: Floats) -> Floats:
    """Return parameters x (v, n) by FREE as those (v, m) of ``lateral/model.py``.

    Only a moment of yaw is the rudder's there, so that it shows what r takes part in.
    """
    theta = np.zeros((len(x), len(NAMES)))
    theta[:, AT["N_delta_r"]] = 1.0
    for i, name in enumerate(FREE):
        if name in AT:
            theta[:, AT[name]] = x[:, i]
    return theta


@dataclass(frozen=True, slots=True)
class Predicted:
    """G (b, 3, 3) from [a, f1, f2] to [p, r, roll], S (b, 3, 3), and slopes (n, b, 3, 3) by x."""

    G: Complex
    S: Complex
    dG: Complex
    dS: Complex


@dataclass(frozen=True, slots=True)
class Model:
    """The model at frequencies ``w`` (b,) in rad/s, at one airspeed and under one roll law.

    ``noise`` (b, 3, 3) takes the place of S where it is given: gusts then do not show the mode.
    """

    w: Floats
    airspeed_m_s: float
    law: Law
    noise: Complex | None = None

    def predict(self, x: Floats, *, slopes: bool = True) -> Predicted:
        """Return what is predicted of parameters x (n,); without ``slopes`` these are empty."""
        o, s, w = dict(zip(FREE, x, strict=True)), 1j * self.w, self.w
        A, B, dA, dB = self._airframe(x)
        servo = np.exp(-s * o["delay"]) / (1.0 + s * o["servo_lag"])
        k = self._feedback()
        Bs = servo[:, None] * B
        inverse = np.linalg.inv(s[:, None, None] * np.eye(4) - A + Bs[:, :, None] * k[:, None])
        logs = "log_gust", "log_gust_rate", "log_roll_gust_rate", "log_span_lag"
        b0, rate, roll_rate, span = (np.exp(o[x]) for x in logs)
        passing = b0 * np.sqrt(2.0 * rate / (w**2 + rate**2))
        rolling = np.exp(o["log_roll_gust"]) / np.sqrt(1.0 + (w / roll_rate) ** 2)
        noise = np.exp([o["log_sigma_p"], o["log_sigma_roll"]])
        fed_back = (noise * k[:, [P, ROLL_ANGLE]])[:, None]
        slope = s / (1.0 + s * span)

        def gusts(A: Floats) -> Complex:
            yawing = A[:, 0] + o["frozen"] * slope[:, None] * A[:, 2] * [0.0, 1.0, 1.0, 0.0]
            return np.stack(
                [passing[:, None] * yawing, rolling[:, None] * A[:, 1] * [0.0, 1.0, 1.0, 0.0]], 2
            )

        D = np.zeros((len(w), 4, 8), complex)
        D[:, :, 0], D[:, 0, 1], D[:, 3, 2] = Bs, GRAVITY / self.airspeed_m_s, 1.0
        D[:, :, 3:5], D[:, 2, 5] = gusts(A), np.exp(o["log_yaw_gust"])
        D[:, :, 6:] = -fed_back * Bs[:, :, None]
        X = inverse @ D
        H = X[:, 1:, 3:].copy()
        H[:, 0, 3] += noise[0]
        H[:, 2, 4] += noise[1]
        S = H @ H.conj().swapaxes(-1, -2)
        S[:, 1, 1] += np.exp(2.0 * o["log_sigma_r"])
        S = S if self.noise is None else self.noise
        if not slopes:
            empty = np.zeros((0, len(w), 3, 3), complex)
            return Predicted(X[:, 1:, :3], S, empty, empty)
        inner = len(STRUCTURE) + 2
        dX = np.zeros((inner, len(w), 4, 8), complex)
        dservo = {"delay": -s * servo, "servo_lag": -s * servo / (1.0 + s * o["servo_lag"])}
        for i, name in enumerate(STRUCTURE):
            dBs = servo[:, None] * dB[i] + dservo.get(name, np.zeros(1))[:, None] * B
            dX[i] = dA[i] @ X - dBs[:, :, None] * (k[:, None] @ X)
            dX[i, :, :, 0] += dBs
            dX[i, :, :, 3:5] += gusts(dA[i])
            dX[i, :, :, 6:] -= fed_back * dBs[:, :, None]
        dX[-2, :, 1:3, 3] = (passing * slope)[:, None] * A[1:3, 2]
        dX[-1] = -o["frozen"] * (span * slope)[:, None, None] * dX[-2]
        dX = inverse @ dX
        dG, dH = (np.zeros((len(FREE), len(w), 3, m), complex) for m in (3, 5))
        dG[:inner], dH[:inner] = dX[..., 1:, :3], dX[..., 1:, 3:]
        for name, column in SIZES.items():
            dH[FREE_AT[name], :, :, column] = H[:, :, column]
        by_rate = 0.5 - rate**2 / (w**2 + rate**2), w**2 / (w**2 + roll_rate**2)
        for i, (column, bent) in enumerate(enumerate(by_rate), start=len(FREE) - 2):
            dH[i, :, :, column] = H[:, :, column] * bent[:, None]
        dS = dH @ H.conj().swapaxes(-1, -2)
        dS += dS.conj().swapaxes(-1, -2)
        dS[FREE_AT["log_sigma_r"], :, 1, 1] += 2.0 * np.exp(2.0 * o["log_sigma_r"])
        dS *= self.noise is None
        return Predicted(X[:, 1:, :3], S, dG, dS)

    def _airframe(self, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return A (4, 4), B (4,), and their slopes by the parameters of STRUCTURE."""
        change = _DIFFERENCE * np.eye(len(x))[: len(STRUCTURE)]
        A, B = airframe(full(np.vstack([x, x + change, x - change])), self.airspeed_m_s)
        A, B = A[:, :4, :4], B[:, :4, 0]
        n = len(STRUCTURE) + 1
        return (
            A[0],
            B[0],
            (A[1:n] - A[n:]) / (2.0 * _DIFFERENCE),
            (B[1:n] - B[n:]) / (2.0 * _DIFFERENCE),
        )

    def _feedback(self) -> Complex:
        """Return k (b, 4)."""
        k = np.zeros((len(self.w), 4), complex)
        k[:, P] = self.law.rate_gain
        k[:, ROLL_ANGLE] = self.law.roll_gain + self.law.integral_gain / (1j * self.w)
        return k

    def inputs(self) -> Complex:
        """Return U (b, 3, 6), which makes [a, f1, f2] of the six signals."""
        U, k = np.zeros((len(self.w), 3, 6), complex), self._feedback()
        U[:, 0, 0], U[:, 0, ROLL], U[:, 0, AILERON] = k[:, P], k[:, ROLL_ANGLE], 1.0
        U[:, 1, 4] = U[:, 2, 5] = 1.0
        return U


OUTPUTS = np.eye(3, 6)
"""Which of the six signals are y."""
