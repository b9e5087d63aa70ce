"""The lateral motion as a state space: states, parameters and what is known of them beforehand.

Eq. 17-21 linearised, in the field's symbols, with two gusts; primed derivatives (Ixz folded in)::

    beta' = Y_beta (beta + b) + alpha p - r + (g/V) cos(pitch) roll + Y_delta_r dr + c1 + (g/V) f1
    p'    = L_beta (beta + b) + L_p p + L_r r + L_delta_a da + L_delta_r dr + w + c2
    r'    = N_beta (beta + b) + N_p (p + w / L_p) + N_r r + N_delta_a da + N_delta_r dr + n + c3
    roll' = p + tan(pitch) r + c4 + n_d + f2                drift of an estimator's roll angle
    b'    = -gust_rate b + sqrt(2 gust_rate) gust n_b       lateral gust, as sideslip
    w'    = -roll_gust_rate w + roll_gust_rate roll_gust n_w      rolling gust

Measured are p, r and roll. c1 to c4 are trims, f1 and f2 what a bank adds to the linear motion,
known from roll, pitch rate and yaw rate. The pitch is measured, alpha is sought: in level flight,
of which the answer is, they are equal, in a turn that descends several degrees apart. da and dr are
commands after delay and servo lag. Roll may come later than the rates, which may have filters of
their own. The paper's coefficients have the opposite sign of Y_beta, L_beta, L_p, L_delta and N_r.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats
from yawid.quantities.airspeed import GRAVITY

STATES = ("beta", "p", "r", "roll", "b", "w")
BETA, P, R, ROLL, GUST, ROLL_GUST = range(len(STATES))
AILERON, RUDDER, TURN_FORCE, TURN_ROLL = range(4)


@dataclass(frozen=True, slots=True)
class Guess:
    """What scales and priors are made from: start values, wn, the flight path's mean alpha."""

    start: dict[str, float]
    wn: float
    alpha: float


ALPHA_STD = 0.015
"""Sigma in rad of the angle of attack that pitch, climb and bank imply."""
CALMEST = 5.0
"""The logarithm of the guess of a gust over its least size."""
SMOOTHEST = 2.0
"""The same of the noise of a measurement."""
Prior = Callable[[Guess], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A row of ``PARAMETERS``.

    ``scale`` is a change of it that matters. ``prior`` gives mean and sigma of what is known
    beforehand. A logarithm is of a size: Y_beta of -Y_beta. ``is_noise`` is True for what shapes
    the noise and not the motion. The parameter stays at ``least`` or above.
    """

    name: str
    scale: Callable[[Guess], float]
    prior: Prior | None = None
    is_noise: bool = False
    least: Callable[[Guess], float] | None = None


def _rate(name: str) -> Callable[[Guess], float]:
    return lambda guess: max(abs(guess.start[name]), 0.1 * guess.wn)


def _stiffness(name: str) -> Callable[[Guess], float]:
    return lambda guess: max(abs(guess.start[name]), 0.1 * guess.wn**2)


def _control(name: str) -> Callable[[Guess], float]:
    return lambda guess: max(abs(guess.start[name]), 0.1 * _power(guess))


def _power(guess: Guess) -> float:
    """Return the larger of the controls' main effects, in 1/s^2."""
    return max(abs(guess.start["L_delta_a"]), abs(guess.start["N_delta_r"]), 1e-2)


def _fixed(value: float) -> Callable[[Guess], float]:
    return lambda guess: value


def _noise(name: str) -> Parameter:
    """Return the row of a measurement's noise: without a least value a smooth roll has none."""
    return Parameter(
        name, _fixed(0.5), lambda guess: (guess.start[name], 2.0), is_noise=True,
        least=lambda guess: guess.start[name] - SMOOTHEST,
    )  # fmt: skip


def _gust(name: str) -> Parameter:
    """Return the row of a gust: in calm air it is as small as it may be, and nothing is known."""
    return Parameter(
        name, _fixed(0.5), is_noise=True, least=lambda guess: guess.start[name] - CALMEST
    )


PARAMETERS = (
    Parameter("log_Y_beta", _fixed(0.5), lambda guess: (math.log(0.1 * guess.wn), 0.7)),
    Parameter(
        "Y_delta_r",
        lambda guess: max(0.05 * abs(guess.start["N_delta_r"]), 1e-4),
        lambda guess: (0.0, 0.05 * max(abs(guess.start["N_delta_r"]), 0.1)),
    ),
    Parameter("L_beta", _stiffness("L_beta")),
    Parameter("L_p", _rate("L_p")),
    Parameter("L_r", _rate("L_r"), lambda guess: (0.0, 4.0 * guess.wn)),
    Parameter("L_delta_a", _control("L_delta_a")),
    Parameter("L_delta_r", _control("L_delta_r")),
    Parameter("N_beta", _stiffness("N_beta")),
    Parameter("N_p", _rate("N_p"), lambda guess: (0.0, 1.5 * guess.wn)),
    Parameter("N_r", _rate("N_r")),
    Parameter("N_delta_a", _control("N_delta_a")),
    Parameter("N_delta_r", _control("N_delta_r")),
    Parameter("servo_lag", _fixed(0.02), lambda guess: (0.08, 0.08), least=_fixed(0.0)),
    Parameter("delay", _fixed(0.02), lambda guess: (0.01, 0.01), least=_fixed(0.0)),
    Parameter("roll_delay", _fixed(0.02), lambda guess: (0.0, 0.015)),
    Parameter("alpha", _fixed(0.02), lambda guess: (guess.alpha, ALPHA_STD)),
    _noise("log_sigma_r"),
    _noise("log_sigma_roll"),
    _gust("log_roll_gust"),
    _gust("log_yaw_gust"),
    _gust("log_gust"),
    _gust("log_roll_drift"),
    Parameter(
        "log_roll_gust_rate",
        _fixed(0.5),
        lambda guess: (math.log(1.5 * guess.wn), 1.0),
        is_noise=True,
    ),
    Parameter(
        "log_gust_rate",
        _fixed(0.5),
        lambda guess: (math.log(0.15 * guess.wn), 1.0),
        is_noise=True,
    ),
    Parameter("log_sigma_p", _fixed(0.5), is_noise=True),
)
"""Every parameter of the model, with what is known of it beforehand. The last one never changes:
the criterion eliminates the scale of all noise, and this one stands for it."""
NAMES = tuple(each.name for each in PARAMETERS)
AT = {name: i for i, name in enumerate(NAMES)}
DERIVATIVES = (
    "Y_beta", "L_beta", "L_p", "L_r", "L_delta_a", "L_delta_r",
    "N_beta", "N_p", "N_r", "N_delta_a", "N_delta_r", "Y_delta_r",
)  # fmt: skip
"""The derivatives that are answered, all of them parameters but for Y_beta, which is -exp of it."""
OF = {"Y_beta": "log_Y_beta", "alpha_rad": "alpha", "servo_lag_s": "servo_lag"}
"""The parameters of which answered numbers are made, where they have other names."""
LEAST_Y_BETA = 1e-9
"""The least size of Y_beta in 1/s: of a file that somebody has changed it may be 0."""


@dataclass(frozen=True, slots=True)
class Law:
    """A roll law found in the aileron: da = -roll_gain roll - rate_gain p + what is left of it.

    An autopilot may filter the roll angle: it then goes through a lag of first order before. It may
    integrate it: ``integral_gain`` is that of the roll angle's integral.
    """

    roll_gain: float = 0.0
    rate_gain: float = 0.0
    roll_lag_s: float = 0.0
    integral_gain: float = 0.0


@dataclass(frozen=True, slots=True)
class System:
    """x' = A x + B u + noise of density Q; p, r and roll have the noise R; v variants of it all.

    ``A`` (v, 6, 6), ``B`` (v, 6, 4), ``C`` (v, 3, 6), ``Q`` (v, 6, 6), ``R`` (v, 3, 3).
    """

    A: Floats
    B: Floats
    C: Floats
    Q: Floats
    R: Floats


def system(theta: Floats, airspeed_m_s: float, pitch: float) -> System:
    """Return the state space of parameters ``theta`` (v, n)."""
    A, B = airframe(theta, airspeed_m_s)
    A[:, BETA, ROLL] = GRAVITY / airspeed_m_s * math.cos(pitch)
    A[:, ROLL, R] = math.tan(pitch)

    def power(name: str) -> Floats:
        return np.exp(2.0 * theta[:, AT[name]])

    gust_rate = np.exp(theta[:, AT["log_gust_rate"]])
    roll_gust_rate = np.exp(theta[:, AT["log_roll_gust_rate"]])
    A[:, GUST, GUST], A[:, ROLL_GUST, ROLL_GUST] = -gust_rate, -roll_gust_rate
    Q, noise = np.zeros_like(A), np.zeros((len(theta), 3, 3))
    C = np.zeros((len(theta), 3, 6))
    C[:, 0, P] = C[:, 1, R] = C[:, 2, ROLL] = 1.0
    C[:, 2, P] = -theta[:, AT["roll_delay"]]  # roll(t - d) is about roll - d p
    Q[:, R, R] = power("log_yaw_gust")
    Q[:, ROLL, ROLL] = power("log_roll_drift")
    Q[:, GUST, GUST] = 2.0 * gust_rate * power("log_gust")
    Q[:, ROLL_GUST, ROLL_GUST] = roll_gust_rate**2 * power("log_roll_gust")
    for i, name in enumerate(("log_sigma_p", "log_sigma_r", "log_sigma_roll")):
        noise[:, i, i] = power(name)
    return System(A, B, C, Q, noise)


def airframe(theta: Floats, airspeed_m_s: float) -> tuple[Floats, Floats]:
    """Return A (v, 6, 6) without the gusts' own rates, and B (v, 6, 4), of level flight.

    The states are STATES; the inputs are aileron, rudder, f1 and f2 of the equations above.
    """
    of = dict(zip(NAMES, theta.T, strict=True))
    Y_beta, alpha = -np.exp(of["log_Y_beta"]), of["alpha"]
    turn = GRAVITY / airspeed_m_s
    A, B = np.zeros((len(theta), 6, 6)), np.zeros((len(theta), 6, 4))
    for column in (BETA, GUST):
        A[:, BETA, column] = Y_beta
        A[:, P, column], A[:, R, column] = of["L_beta"], of["N_beta"]
    A[:, BETA, P], A[:, BETA, R], A[:, BETA, ROLL] = alpha, -1.0, turn * np.cos(alpha)
    A[:, P, P], A[:, P, R], A[:, P, ROLL_GUST] = of["L_p"], of["L_r"], 1.0
    A[:, R, P], A[:, R, R] = of["N_p"], of["N_r"]
    A[:, R, ROLL_GUST] = of["N_p"] / of["L_p"]  # the air's rolling is felt as p is
    A[:, ROLL, P], A[:, ROLL, R] = 1.0, np.tan(alpha)
    B[:, BETA, RUDDER], B[:, BETA, TURN_FORCE], B[:, ROLL, TURN_ROLL] = of["Y_delta_r"], turn, 1.0
    B[:, P, AILERON], B[:, P, RUDDER] = of["L_delta_a"], of["L_delta_r"]
    B[:, R, AILERON], B[:, R, RUDDER] = of["N_delta_a"], of["N_delta_r"]
    return A, B


def theta_of(names: Sequence[str], values: Floats) -> Floats:
    """Return parameters (v, n) that have these answered numbers (v, m) by their names, and 0."""
    theta = np.zeros((len(values), len(NAMES)))
    theta[:, [AT[OF.get(name, name)] for name in names]] = values
    Y_beta = AT["log_Y_beta"]
    theta[:, Y_beta] = np.log(np.maximum(-theta[:, Y_beta], LEAST_Y_BETA))
    return theta


def modes(theta: Floats, airspeed_m_s: float) -> Floats:
    """Return wn in rad/s and zeta of the Dutch roll, and the poles of roll and spiral in 1/s.

    ``theta`` (v, n); the result is (v, 4), NaN where a mode is missing.
    """
    poles = np.linalg.eigvals(airframe(theta, airspeed_m_s)[0][:, :4, :4])
    found = np.full((len(theta), 4), np.nan)
    for row, each in zip(found, poles, strict=True):
        pairs, real = each[each.imag > 1e-6], np.sort(each[np.abs(each.imag) <= 1e-6].real)
        if len(pairs):
            pair = pairs[np.argmax(np.abs(pairs))]
            row[:2] = abs(pair), -pair.real / abs(pair)
        if len(real) == 2:  # roll and spiral; else the two oscillate together
            row[2:] = real
    return found
