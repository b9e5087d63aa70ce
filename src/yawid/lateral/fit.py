"""The fit: Levenberg's steps to the parameters of largest likelihood."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.machine.products import cross
from yawid.lateral.criterion import Criterion, Point
from yawid.lateral.model import NAMES, Guess
from yawid.lateral.record import Record
from yawid.lateral.start import N_R, equation_error, middle_of

NATS = 3.0
"""Starts whose log-likelihood is this near to the best one's count as answers, too, and one that
settled goes before one that did not."""
START_LAGS_S = (0.04, 0.1, 0.16)
"""Servo lags from which the fit starts. The aircraft of the second start is a plain one."""
ITERATIONS = 100
"""The most steps: one of SITL's manoeuvres, of 50 s, takes some 60."""
LONGEST_STEP = 2.0
"""Of a parameter in its scales: beyond it the slopes are those of another model."""
_DAMPING, _HARDER, _SOFTER, _LEAST, _MOST = 1.0, 10.0, 3.0, 1e-2, 1e9
"""The least damping holds noise of which the record shows nothing: with 1e-5 a fit in which a gust
was almost 0 took over a hundred steps, in place of 25."""
_SMALL_GAIN, _OF_NOISE = 0.02, 0.1
"""The expected gain of twice the log-likelihood below which the steps end: by the motion's
parameters, and by all."""


@dataclass(frozen=True, slots=True)
class Fit:
    """Where the steps ended: the point in scales (n,), its covariance (n, n), and the criterion.

    ``criterion`` is twice the negative logarithm of likelihood and priors. ``noise_scale`` is that
    of all sizes of noise in ``x``. ``at`` is the criterion's point there, and ``slopes`` (l, n) are
    those of its innovations.
    """

    of: Criterion
    x: Floats
    covariance: Floats
    criterion: float
    noise_scale: float
    settled: bool
    at: Point
    slopes: Floats


def guesses(records: Sequence[Record], servo_lag_s: float | None) -> list[Guess]:
    """Return the starts, from equation error and from the signals' sizes.

    They differ in the lag with which the equation error is made, and one takes the derivatives of
    r from the middle of its power. What is known beforehand is the same for all, so that their
    likelihoods compare. A servo lag that is given is that of all.
    """
    middle = middle_of(records)
    lags = START_LAGS_S if servo_lag_s is None else (servo_lag_s, servo_lag_s, START_LAGS_S[-1])
    starts = [equation_error(records, lag_s, middle) for lag_s in lags]
    wn = max(math.sqrt(abs(starts[1]["N_beta"])), 0.5)
    starts[1] |= {"N_beta": middle**2, "N_p": 0.0, "N_r": N_R * middle}
    return [
        _guess(records, start | {"servo_lag": lag_s if servo_lag_s is None else servo_lag_s}, wn)
        for lag_s, start in zip(lags, starts, strict=True)
    ]


def _guess(records: Sequence[Record], start: dict[str, float], wn: float) -> Guess:
    Ts = records[0].sample_time_s
    p, r, roll = np.sqrt(np.mean([np.mean(each.y**2, axis=0) for each in records], axis=0))
    noise = [max(float(np.mean([_fine(each.y[:, i]) for each in records])), 0.01 * rms, least)
             for i, rms, least in ((0, p, 1e-6), (1, r, 1e-6), (2, roll, 1e-4))]  # fmt: skip
    tiny = np.finfo(float).tiny
    values = start | {
        "log_Y_beta": math.log(max(-start["Y_beta"], 0.02 * wn)),
        "Y_delta_r": 0.0, "delay": 0.0, "roll_delay": 0.0,
        "alpha": float(np.mean([each.alpha for each in records])),
        "log_sigma_p": math.log(noise[0]), "log_sigma_r": math.log(noise[1]),
        "log_sigma_roll": math.log(noise[2]),
        "log_roll_gust": math.log(0.9 * p * math.sqrt(Ts) + tiny),
        "log_yaw_gust": math.log(0.9 * r * math.sqrt(Ts) + tiny),
        "log_roll_drift": math.log(noise[2] * math.sqrt(Ts)),
        "log_gust": math.log(0.075 * r + tiny),
        "log_gust_rate": math.log(0.15 * wn), "log_roll_gust_rate": math.log(1.5 * wn),
    }  # fmt: skip
    return Guess({name: float(values[name]) for name in NAMES}, wn, values["alpha"])


def _fine(x: Floats) -> float:
    """Return the size of white noise in x, from fourth differences."""
    d = np.diff(x, 4) / math.sqrt(70.0)
    return float(1.4826 * np.median(np.abs(d - np.median(d)))) if len(d) else 0.0


def fit(criterion: Criterion, most_steps: int = ITERATIONS, before: "Fit | None" = None) -> Fit:
    """Return the fit from the criterion's start, at the least criterion that the steps reach.

    Another start ended ``before``: its noise is kept until the motion has settled. Where that is as
    likely the steps end there, and else they go on with the noise free. Where it moves from the
    beginning, a start that is far away may end where noise explains the motion.

    A step is -(H + damping I)^-1 score (Levenberg 1944), in scales, of the free parameters: those
    at their least value stay there while the criterion would push them on.

    Raises:
        numpy.linalg.LinAlgError: there is no predictor at the start.
    """
    if before is not None:
        criterion.begin_with_noise_of(before.of, before.x)
    at, damping = criterion.at(criterion.start()), _DAMPING
    kept = criterion.is_noise & (before is not None)
    enough = math.inf if before is None else before.criterion + 2.0 * NATS
    for step in range(most_steps + 1):
        variance = at.power / criterion.count
        J, H, score = _curvature(criterion, at, variance)
        free = ~kept & ((at.x > criterion.least) | (score <= 0.0))
        while (below := free & (at.x <= criterion.least) & (_step(H, score, free) < 0.0)).any():
            free &= ~below
        settled = _is_settled(H[np.ix_(free, free)], score[free], criterion.is_noise[free])
        if settled and kept.any() and criterion.total(at) > enough:
            kept[:] = settled = False
            continue
        if settled or step == most_steps:
            break
        tried, loss = at, at.loss(variance)
        while damping < _MOST and not tried.loss(variance) < loss:
            move = _step(H + damping * np.eye(len(H)), score, free)
            x = np.maximum(at.x + np.clip(move, -LONGEST_STEP, LONGEST_STEP), criterion.least)
            with suppress(np.linalg.LinAlgError):  # there is no predictor so far away
                tried = criterion.at(x)
            damping *= _HARDER
        if not tried.loss(variance) < loss:
            break
        at, damping = tried, max(damping / _HARDER / _SOFTER, _LEAST)
    return _ended(criterion, at, J, H, settled)


def _ended(criterion: Criterion, at: Point, J: Floats, H: Floats, settled: bool) -> Fit:
    variance, n = at.power / criterion.count, len(at.x)
    size = np.sqrt(np.diag(H))
    inverse = np.linalg.inv(H / np.outer(size, size) + 1e-12 * np.eye(n))
    unbiased = criterion.count / max(criterion.count - n, 1)
    covariance = unbiased * inverse / np.outer(size, size)
    noise_scale = math.sqrt(variance) / math.exp(float(at.parts[0].predictor.log_det[0]) / 3.0)
    return Fit(criterion, at.x, covariance, criterion.total(at), noise_scale, settled, at, J)


def _curvature(criterion: Criterion, at: Point, variance: float) -> tuple[Floats, Floats, Floats]:
    """Return the innovations' slopes; the Hessian (n, n) and slope (n,) of half the criterion.

    The latter are over the variance.
    """
    J, of_sizes = criterion.slopes(at)
    H, score = cross(J, J) / variance + of_sizes, cross(J, at.e) / variance
    H += np.diag(1.0 / (criterion.spread / criterion.scale) ** 2)
    score += at.surprise * criterion.scale / criterion.spread
    return J, H, score


def _step(H: Floats, score: Floats, free: np.ndarray) -> Floats:
    """Return the step (n,) to the least criterion in the parameters that are ``free`` (n,)."""
    step = np.zeros(len(score))
    step[free] = -np.linalg.solve(H[np.ix_(free, free)], score[free])
    return step


def _is_settled(H: Floats, score: Floats, is_noise: np.ndarray) -> bool:
    """Return whether a whole step would gain little, and next to nothing along the motion."""
    inverse = np.linalg.inv(H + _LEAST * np.eye(len(H)))
    step = inverse @ score
    motion, own = step[~is_noise], inverse[np.ix_(~is_noise, ~is_noise)]
    gain = float(motion @ np.linalg.solve(own, motion))
    return gain < _SMALL_GAIN and float(score @ step) < _OF_NOISE
