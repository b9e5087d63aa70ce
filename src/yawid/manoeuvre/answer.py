"""A manoeuvre's answer: wn and zeta over the structures, and the model that has them.

No structure is an aircraft, and each is wrong in its own way. With weights W_s the answer is the
mean over them, and its variance the mean of theirs plus their spread (Buckland and others, 1997):

    x = sum_s W_s x_s,   C = sum_s W_s (I_s C_s + (x_s - x)(x_s - x)') + floors

for x = (log wn, zeta, G(jw) from .6 to 1.6 wn): each number below has its sigma from one C.
Of "2", "2L" and "3" W_s goes with VOTES exp(-(BIC - least) / (2 T)), T = N / 10 within 8 and 50.
What these leave out is the roll loop's pair. Its distance from the Dutch roll's,
D = |log(p_2 / p_1)|, says how much that matters, so that "roll" has the weight

    q = V / (V + V_roll) exp(-max(d^2 - 2, 0) / 2),   V = tr C_yaw + 2 (LEFT_OUT / D)^2

with the traces of the covariances of log wn and zeta, which are the two parts of a pole's
relative error, and the distance d in sigma of the two results. Of (LEFT_OUT / D)^2 the part 1 - q
stays in the variance of zeta. Where BIC prefers the fits of small motion
(:mod:`yawid.manoeuvre.large`), both kinds have these weights and share them by exp(-BIC / (2 T)) in
C. They are in x where they take WORTH_BIC off.

The answer's model is the structure of the least BIC with its pair at (wn, zeta), its residues,
initial states and bias solved again; its parameters have the covariance that is nearest to C. Of
its response eq. 23's K and T follow by least squares,

    K (T s + 1) wn^2 / (s^2 + 2 zeta wn s + wn^2) = G(s),   s = jw from .6 to 1.6 wn

of the relative misfit. A doublet shows the yaw acceleration K T wn^2 of a step, and |G| near wn,
better than K alone.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from yawid.answers.run_summary import HIGHEST, LOWEST, POINTS
from yawid.blocks import Floats
from yawid.manoeuvre.fit import WORTH_BIC, Fit, best_alone
from yawid.manoeuvre.projection import ROLL
from yawid.physics.modes import Complexes

LEAST_TEMPER, TEMPER, ROWS_PER_TEMPER = 8.0, 50.0, 10.0
"""With BIC as it is, one structure has all of the weight on a long record, though each of them is
wrong by more than its sigma. Chosen by the prototype on 30 drawn flights."""
VOTES: Final = {"2": 0.5, "2L": 0.5, "3": 1.0}
"""The factors of the structures' weights: "3" is nearest to an aircraft. With equal votes the
median error of wn in calm air was .83 % instead of .72 %. Chosen on 72 drawn flights and 200
simulated aircraft."""
INFLATED, INFLATED_ROLL, FEW_PERIODS = 1.25, 2.5, 2.5
"""The factors of variance of the structures, and of the one with roll, and the periods that double
them: noise is estimated from the same few. Without the second and the third the errors in gusts are
1.3 sigma, of less than three periods 1.35. Chosen on 240 drawn flights and 200 simulated ones."""
LEFT_OUT, LEAST_APART = 0.015, 0.25
"""About the error of yaw rate alone where D is 1, relative, and the least D: without it too light a
weight of roll leaves 2 % of wn in a roll loop's neighbourhood. Chosen on the same aircraft."""
FLOOR_WN, FLOOR_ZETA = 0.005, 0.004
"""The least sigma of wn, relative, and of zeta."""
HIDDEN_ZETA: Final = 0.04
"""The part of zeta that a closed roll loop may hide where roll does not show it: of JSBSim's
linearised aircraft with a roll hold three poles are .036 off (RMS)."""
FLOOR_GAIN, FLOOR_DELAY = 0.03, 0.5
"""The least sigma of all of a response together: of its size, relative, and of its delay, in
samples. A command is known only when its message comes, up to a sample late, which K shows: 5
degrees at the mode are a third of it. Without them |G| at 1.4 wn was within 2 sigma in 86 %, K in
89 %. Chosen on 72 drawn flights."""
LIGHT_LOOP, KNOWN_LOOP = 0.05, 0.25
"""A roll loop's pair whose zeta is less than the first must be known to the second, relative: else
it is a line of the noise, and roll has no vote. Without it a trainer whose roll loop has real modes
had one of zeta .04, and a Dutch roll 3 % off. Chosen on 72 drawn flights."""
PAIR_FIRST: Final = 100.0
"""How much more wn and zeta weigh than each part of the response in the model's covariance."""


class Known(NamedTuple):
    """A number and its sigma."""

    value: float
    std: float


@dataclass(frozen=True, slots=True)
class Eq23:
    """Eq. 23 of the rudder: K in rad/s per unit, T in s, and the yaw acceleration K T wn^2."""

    K: Known
    T_s: Known
    yaw_acceleration: Known


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer of a manoeuvre.

    ``weights`` are those of the structures that were averaged, by name. ``model`` is the answer's
    model. At ``w`` (n,) in rad/s it has the ``response`` (inputs, n); ``covariance`` is that of
    (log wn, zeta, its real parts, its imaginary parts). ``large_gain`` is what large motion as an
    input takes off the least BIC: more than WORTH_BIC where the answer is that of small motion.
    """

    wn_rad_s: Known
    zeta: Known
    weights: dict[str, float]
    model: Fit
    w: Floats
    response: Complexes
    covariance: Floats
    eq_23: Eq23
    large_gain: float


def answer_of(fits: Sequence[Fit], *, has_roll_loop: bool = False) -> Answer | None:
    """Return the answer of a manoeuvre's fits; None where none of them knows its pair.

    With a roll loop that roll does not show, zeta's sigma has the part that the loop may hide.
    """
    gain = large_gain(fits)
    weighted = weights_of(fits)
    if not weighted:
        return None
    counted = [each for each in weighted if gain > WORTH_BIC or not each[0].is_small]
    share = np.array([s for _, s in counted])
    share /= share.sum()
    log_wn, zeta = (share @ np.stack([_pair(fit)[0] for fit, _ in counted])).tolist()
    wn = math.exp(log_wn)
    w = wn * np.linspace(LOWEST, HIGHEST, POINTS)
    some = (fit for fit, _ in counted if fit.structure.name != ROLL)
    model = min(some, key=lambda fit: fit.bic).with_pair(wn, zeta)
    G = model.response(w)[0]
    x = np.concatenate([[log_wn, zeta], G.real.ravel(), G.imag.ravel()])
    C = np.zeros((len(x), len(x)))
    for fit, s in weighted:
        each, J = _numbers(fit, w)
        C += s * (_inflated(fit) * J @ fit.covariance @ J.T + np.outer(each - x, each - x))
    hidden = HIDDEN_ZETA * zeta if has_roll_loop else 0.0
    if rolls := [(s, _left_out(fit)) for fit, s in weighted if fit.structure.name == ROLL]:
        hidden = math.sqrt(1.0 - sum(s for s, _ in rolls)) * max(rolls)[1]
    C[[0, 1], [0, 1]] += FLOOR_WN**2, FLOOR_ZETA**2 + hidden**2
    late = FLOOR_DELAY * model.blocks.record.sample_time_s * (1j * w * G)
    for moved in (FLOOR_GAIN * G, late):
        each = np.concatenate([moved.real.ravel(), moved.imag.ravel()])
        C[2:, 2:] += np.outer(each, each)
    model = replace(model, covariance=_as_parameters(model, w, C))
    std = np.sqrt(np.diag(C)[:2])
    return Answer(
        Known(wn, wn * float(std[0])), Known(zeta, float(std[1])),
        _by_name(counted, share), model, w, G, C,
        _eq_23(wn, zeta, w, G, C), gain,
    )  # fmt: skip


def large_gain(fits: Sequence[Fit]) -> float:
    """Return what large motion as an input takes off the least BIC; 0 where no fit has it."""
    best, small = best_alone(fits), best_alone(fits, small=True)
    return 0.0 if best is None or small is None else best.bic - small.bic


def weights_of(fits: Sequence[Fit]) -> list[tuple[Fit, float]]:
    """Return the fits that count, and their weights.

    Where there are fits of small motion, both kinds must count, and BIC shares the weight.
    """
    plain, small = (_weights([fit for fit in fits if fit.is_small == each])
                    for each in (False, True))  # fmt: skip
    if not any(fit.is_small for fit in fits):
        return plain
    if not (plain and small):
        return []
    share = 1.0 / (1.0 + math.exp(-large_gain(fits) / (2.0 * _temper(plain[0][0]))))
    return [(fit, w * (1.0 - share)) for fit, w in plain] + [(fit, w * share) for fit, w in small]


def _by_name(weighted: Sequence[tuple[Fit, float]], share: Floats) -> dict[str, float]:
    found: dict[str, float] = {}
    for (fit, _), s in zip(weighted, share.tolist(), strict=True):
        found[fit.name] = found.get(fit.name, 0.0) + s
    return found


def _temper(fit: Fit) -> float:
    return min(max(len(fit.blocks) / ROWS_PER_TEMPER, LEAST_TEMPER), TEMPER)


def _weights(fits: Sequence[Fit]) -> list[tuple[Fit, float]]:
    """Return those of fits that count, and their weights, of one kind of fits."""

    def counts(fit: Fit) -> bool:
        log_z = 2 * np.delete(np.arange(fit.structure.pairs), fit.pair) + 1
        is_light = np.exp(fit.theta[log_z]) < LIGHT_LOOP
        is_noise = is_light & (np.diag(fit.covariance)[log_z] > KNOWN_LOOP**2)
        return not (fit.at_bound or is_noise.any())

    kept = [fit for fit in fits if counts(fit)]
    yaw = [fit for fit in kept if fit.structure.name != ROLL]
    if not yaw:
        return []
    bic = np.array([fit.bic for fit in yaw])
    share = np.exp(-(bic - bic.min()) / (2.0 * _temper(yaw[0])))
    share *= [VOTES[fit.structure.name] for fit in yaw]
    share /= share.sum()
    roll = [fit for fit in kept if fit.structure.name == ROLL]
    q = _weight_of_roll(roll[0], yaw, share) if roll else 0.0
    return [*zip(yaw, ((1.0 - q) * share).tolist(), strict=True), *((fit, q) for fit in roll)]


def _weight_of_roll(roll: Fit, yaw: Sequence[Fit], share: Floats) -> float:
    pairs, own = zip(*map(_pair, yaw), strict=True)
    mean = share @ np.stack(pairs)
    apart = np.stack(pairs) - mean
    noise = [_inflated(fit) * each for fit, each in zip(yaw, own, strict=True)]
    V = np.tensordot(share, np.stack(noise), 1) + (apart.T * share) @ apart
    V += _left_out(roll) ** 2 * np.eye(2)
    x, C = _pair(roll)
    of_roll, off = _inflated(roll) * C, x - mean
    surprise = float(off @ np.linalg.solve(V + of_roll, off))
    return float(np.trace(V) / np.trace(V + of_roll)) * math.exp(-0.5 * max(surprise - 2.0, 0.0))


def _left_out(roll: Fit) -> float:
    """Return about the error of yaw rate alone next to a roll loop that roll shows."""
    poles = roll.structure.poles(roll.theta)
    others = np.delete(poles, roll.pair)
    return LEFT_OUT / max(float(np.abs(np.log(others / poles[roll.pair])).min()), LEAST_APART)


def _inflated(fit: Fit) -> float:
    """Return the factor of a fit's covariance."""
    periods = fit.blocks.record.seconds * math.exp(fit.log_pair[0]) / (2.0 * math.pi)
    factor = INFLATED_ROLL if fit.structure.name == ROLL else INFLATED
    return factor * (1.0 + (FEW_PERIODS / periods) ** 2)


def _pair(fit: Fit) -> tuple[Floats, Floats]:
    """Return log wn and zeta (2,) of a fit, and their covariance."""
    at, (log_w, log_z) = 2 * fit.pair, fit.log_pair
    scale = np.array([1.0, math.exp(log_z)])
    own = fit.covariance[at : at + 2, at : at + 2]
    return np.array([log_w, math.exp(log_z)]), own * np.outer(scale, scale)


def _numbers(fit: Fit, w: Floats) -> tuple[Floats, Floats]:
    """Return x (2 + 2 inputs n,) of a fit at w (n,), and its slopes by the parameters."""
    at, (pair, _) = 2 * fit.pair, _pair(fit)
    G, slopes = fit.response(w)
    J = np.zeros((2 + 2 * G.size, len(fit.covariance)))
    J[0, at], J[1, at + 1] = 1.0, pair[1]
    moved = slopes.reshape(len(slopes), -1).T
    J[2:] = np.concatenate([moved.real, moved.imag])
    return np.concatenate([pair, G.real.ravel(), G.imag.ravel()]), J


def _as_parameters(model: Fit, w: Floats, C: Floats) -> Floats:
    """Return the covariance of a model's parameters that is nearest to C of x at w (n,).

    wn and zeta count most, so that their sigmas are those of C.
    """
    scale = 1.0 / np.sqrt(np.diag(C))
    scale[:2] *= PAIR_FIRST
    back = np.linalg.pinv(scale[:, None] * _numbers(model, w)[1], rcond=1e-9) * scale
    found: Floats = back @ C @ back.T
    return found


def _eq_23(wn: float, zeta: float, w: Floats, G: Complexes, C: Floats) -> Eq23:
    """Return K and T of the rudder from the response G (inputs, n) with the covariance C.

    P (K, K T) = 1 is solved for the relative misfit, so the slopes are -(P'P)^-1 P' (dP x).
    """
    s, g, n = 1j * w, G[0], len(w)
    den = s * s + 2.0 * zeta * wn * s + wn * wn
    columns = np.stack([wn * wn / den / g, wn * wn / den / g * s])
    P = np.concatenate([columns.real, columns.imag], axis=1).T
    inverse = np.linalg.inv(P.T @ P)
    solve = inverse @ P.T
    x = solve @ np.repeat([1.0, 0.0], n)
    M = x @ columns
    moved = np.zeros((n, len(C)), complex)
    moved[:, 0] = M * (2.0 - (2.0 * zeta * wn * s + 2.0 * wn * wn) / den)
    moved[:, 1] = M * (-2.0 * wn * s / den)
    at = 2 + np.arange(n)
    moved[np.arange(n), at] = -M / g
    moved[np.arange(n), at + G.size] = -1j * M / g
    S = -solve @ np.concatenate([moved.real, moved.imag])
    misfit = float(np.mean(np.abs(M - 1.0) ** 2))
    V = S @ C @ S.T + inverse * (misfit * n / 2.0)
    K, KT = x.tolist()
    by_wn = S @ C[:, 0]
    rate = wn * wn * KT
    of_rate = wn**4 * (V[1, 1] + 4.0 * KT * by_wn[1] + 4.0 * KT * KT * C[0, 0])
    by_T = np.array([-KT / K, 1.0]) / K
    return Eq23(
        Known(K, math.sqrt(V[0, 0])), Known(KT / K, math.sqrt(by_T @ V @ by_T)),
        Known(rate, math.sqrt(max(of_rate, 0.0))),
    )  # fmt: skip
