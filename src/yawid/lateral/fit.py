"""The fit: Levenberg's and Marquardt's steps to the parameters of largest likelihood."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.machine.products import cross
from yawid.lateral.criterion import Criterion, Point
from yawid.lateral.model import NAMES, Guess
from yawid.lateral.record import Record
from yawid.lateral.start import band, equation_error, plain

START_LAGS_S = (0.04, 0.1, 0.16)
"""Servo lags from which the fit starts. The aircraft of the second start is a plain one."""
ITERATIONS, TRIALS = 60, 8
"""The most steps, and trials of a step: with 40 of them one of SITL's manoeuvres, of 50 s, ended
before the best of its three starts had settled, after 43."""
LONGEST_STEP = 2.0
"""Of a parameter in its scales."""
_PROBE = 0.1
"""The part of a step after which it is seen how the innovations bend."""
_DAMPING, _HARDER, _SOFTER, _LEAST = 1e-3, 6.0, 8.0, 1e-9
_SHRINK, _GROW = 0.95, 20.0
"""The largest share by which a variance falls and grows in a step."""
_SMALL_GAIN = 0.02
"""The expected gain of twice the log-likelihood below which the steps end."""
_SAME = 0.1
"""The expected gain of twice the log-likelihood below which a fit ends where another one did."""
_EARLY = 5
"""Steps after which what the noise would still gain no longer counts."""


@dataclass(frozen=True, slots=True)
class Fit:
    """Where the steps ended: the point in scales (n,), its covariance (n, n), and the criterion.

    ``criterion`` is twice the negative logarithm of likelihood and priors. ``errors`` (l,) are the
    innovations and the jumps' times over their ``scale``; ``noise_scale`` is that of all sizes of
    noise in ``x``.
    """

    of: Criterion
    x: Floats
    covariance: Floats
    criterion: float
    scale: float
    noise_scale: float
    errors: Floats
    settled: bool
    steps: int


def guesses(records: Sequence[Record], servo_lag_s: float | None) -> list[Guess]:
    """Return the starts, from equation error and from the signals' sizes.

    They differ in the lag with which the equation error is made, and one takes the derivatives of
    r from the middle of its power. What is known beforehand is the same for all, so that their
    likelihoods compare. A servo lag that is given is that of all.
    """
    middle, w = band(records)
    lags = START_LAGS_S if servo_lag_s is None else (servo_lag_s, servo_lag_s, START_LAGS_S[-1])
    starts = [equation_error(records, lag_s, w, middle) for lag_s in lags]
    wn = max(math.sqrt(abs(starts[1]["N_beta"])), 0.5)
    starts[1] |= plain(middle)
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


def fit(criterion: Criterion, others: Sequence[Fit] = ()) -> Fit:
    """Return the fit from the criterion's start, or the one of ``others`` that it comes near to.

    The Hessian's block of the noise parameters is doubled: Gauss and Newton's has half of their
    information. Parameters at their least value stay there while the criterion would push them on.

    Raises:
        numpy.linalg.LinAlgError: there is no predictor at the start.
    """
    at, damping, settled, bends = criterion.at(criterion.start()), _DAMPING, False, False
    for step in range(ITERATIONS + 1):
        for other in others:
            if other.settled and _apart(other, at.x * criterion.scale) < _SAME:
                return other
        variance = float(at.e @ at.e) / criterion.count
        loss = at.loss(variance)
        J = criterion.slopes(at)
        H, score = _curvature(criterion, at, J, variance)
        held = _held(criterion, at.x, H, score)
        gain, motion_gain = _gains(H, score, held, criterion.is_noise)
        settled = gain < _SMALL_GAIN or (step >= _EARLY and motion_gain < _SMALL_GAIN)
        if settled or step == ITERATIONS:
            break
        better = None
        for _ in range(TRIALS):
            damped = H + damping * np.diag(np.diag(H))
            moved = _moved(criterion, at.x, _step(criterion, at.x, damped, score, held))
            if bends:
                moved = after_bend(criterion, at, moved, J, damped * variance)
            tried = _at_or_none(criterion, moved)
            after = math.inf if tried is None else tried.loss(variance)
            if after < loss:
                better = tried
                break
            damping, bends = max(damping * _HARDER, _DAMPING), True
        if better is None:
            settled = gain < 1.0  # nothing is gained within the rounding of the slopes
            break
        expected = _expected(H, score, better.x - at.x)
        at = better
        if loss - after > 0.5 * expected:
            damping = max(damping / _SOFTER, _LEAST)
    return _ended(criterion, at, H, settled, step)


def _apart(fit: Fit, theta: Floats) -> float:
    """Return what twice the log-likelihood should lose from a fit's end to ``theta`` (n,)."""
    apart = theta / fit.of.scale - fit.x
    return float(apart @ np.linalg.solve(fit.covariance, apart))


def _ended(criterion: Criterion, at: Point, H: Floats, settled: bool, steps: int) -> Fit:
    variance, n = float(at.e @ at.e) / criterion.count, len(at.x)
    size = np.sqrt(np.diag(H))
    inverse = np.linalg.inv(H / np.outer(size, size) + 1e-12 * np.eye(n))
    unbiased = criterion.count / max(criterion.count - n, 1)
    covariance = unbiased * inverse / np.outer(size, size)
    total = criterion.count * math.log(variance) + float(at.surprise @ at.surprise)
    scale = math.sqrt(variance)
    noise_scale = scale / math.exp(float(at.parts[0].predictor.log_det[0]) / 3.0)
    return Fit(criterion, at.x, covariance, total, scale, noise_scale, at.e / scale, settled, steps)


def _at_or_none(criterion: Criterion, x: Floats) -> Point | None:
    try:
        return criterion.at(x)
    except np.linalg.LinAlgError:
        return None


def _curvature(
    criterion: Criterion, at: Point, J: Floats, variance: float
) -> tuple[Floats, Floats]:
    """Return the Hessian (n, n) and the slope (n,) of half the criterion, over the variance.

    ``J`` (l, n) are the slopes of the innovations.
    """
    H, score = cross(J, J) / variance, cross(J, at.e) / variance
    H[np.ix_(criterion.is_noise, criterion.is_noise)] *= 2.0
    H += np.diag(1.0 / (criterion.spread / criterion.scale) ** 2)
    score += at.surprise * criterion.scale / criterion.spread
    return H, score


def _expected(H: Floats, score: Floats, step: Floats) -> float:
    """Return what a step should gain in twice the log-likelihood, if the criterion is square."""
    return float(-2.0 * score @ step - step @ H @ step)


def _moved(criterion: Criterion, x: Floats, step: Floats) -> Floats:
    """Return the point after a step, which a variance of noise takes as itself, not as logarithm.

    The likelihood is nearly square in a variance that is small next to others (Fisher's scoring). A
    step that is too long keeps its direction.
    """
    others = ~criterion.is_size
    step = np.where(others, step * _share_of(step[others]), step)
    twice = 2.0 * criterion.scale
    share = np.log1p(np.clip(twice * step, -_SHRINK, _GROW)) / twice
    tried = x + np.where(criterion.is_size, share, np.clip(step, -LONGEST_STEP, LONGEST_STEP))
    return np.asarray(np.maximum(tried, criterion.least), np.float64)


def after_bend(criterion: Criterion, at: Point, moved: Floats, J: Floats, H: Floats) -> Floats:
    """Return where a step of the motion's parameters to ``moved`` (n,) ends in a bent valley.

    How the innovations bend along it shows a point a tenth of the way (Transtrum and Sethna 2012).
    ``J`` (l, n) are their slopes, ``H`` (n, n) is the damped Hessian of half their squares.
    """
    motion = ~criterion.is_noise
    step = np.where(motion, moved - at.x, 0.0)
    if (probe := _at_or_none(criterion, at.x + _PROBE * step)) is None:
        return moved
    bend = 2.0 / _PROBE * ((probe.e - at.e) / _PROBE - J @ step)
    more = _solved(H, cross(J, bend), motion & (moved > criterion.least), np.zeros(len(step)))
    size = np.diag(H)
    if more**2 @ size > step**2 @ size:
        return moved
    return np.asarray(np.maximum(moved + 0.5 * more, criterion.least), np.float64)


def _share_of(step: Floats) -> float:
    return LONGEST_STEP / max(LONGEST_STEP, float(np.abs(step).max()))


def _held(criterion: Criterion, x: Floats, H: Floats, score: Floats) -> np.ndarray:
    """Return which parameters (n,) stay at their least value, because the step would go below."""
    at_least = x <= criterion.least
    held = at_least & (score > 0.0)
    while (more := at_least & ~held & (_solved(H, score, ~held, np.zeros(len(x))) < 0.0)).any():
        held |= more
    return np.asarray(held, np.bool_)


def _step(
    criterion: Criterion, x: Floats, damped: Floats, score: Floats, held: np.ndarray
) -> Floats:
    """Return the step (n,) of a damped Hessian; what would go below its least value goes there."""
    step, on = np.zeros(len(x)), ~held
    to_least = criterion.least - x
    while True:
        step = _solved(damped, score, on, step)
        below = on & ~criterion.is_size & (step < to_least)
        if not below.any():
            return step
        step, on = np.where(below, to_least, step), on & ~below


def _solved(H: Floats, score: Floats, on: np.ndarray, step: Floats) -> Floats:
    """Return the step to the least criterion in ``on``, with the others of ``step`` as given."""
    found = np.where(on, 0.0, step)
    found[on] = -np.linalg.solve(H[np.ix_(on, on)], (score + H @ found)[on])
    return np.asarray(found, np.float64)


def _gains(H: Floats, score: Floats, held: np.ndarray, is_noise: np.ndarray) -> tuple[float, float]:
    """Return what the full step would gain, and what its part along the motion would gain."""
    on = ~held
    some = H[np.ix_(on, on)] + _LEAST * np.diag(np.diag(H)[on])
    inverse, noise = np.linalg.inv(some), is_noise[on]
    full = -inverse @ score[on]
    motion = full[~noise]
    kept = np.linalg.solve(inverse[np.ix_(~noise, ~noise)], motion)
    return float(-score[on] @ full), float(motion @ kept)
