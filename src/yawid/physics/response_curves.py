"""The plant as curves: transient function h(t), weighting function g(t), G(jw). Eq. 1-3.

In the active method h is measured with a step. In the passive method g is estimated from any input
by least squares, and G from cross spectra. h and g of an identified model can be computed too. On
the grid, with u held between its instants, h(k) is the response at k Ts and g(k) the mean of dh/dt
over [k Ts, (k+1) Ts), so that both convolutions are exact.

Printed slips: eq. 3 has a d/dt too many, and its delta(t) = dh/dt means g(t) = dh/dt; y = u h(0) +
integral of g(t - tau) u(tau) is meant.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from yawid.blocks import Floats, shifted
from yawid.config.estimator import ArmaxOrders
from yawid.errors import ConfigError, NotIdentifiable
from yawid.estimation.checks import checked_record
from yawid.physics.model_response import step_response


@dataclass(frozen=True, slots=True)
class Curves:
    """h (n,) in y per u and g (n,) in y per u and s at ``t`` (n,) in s, with their sigma (n,)."""

    t: Floats
    h: Floats
    h_std: Floats
    g: Floats
    g_std: Floats


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """G (n,) of the sampled plant in y per u, at ``frequency_hz`` (n,).

    ``coherence`` (n,) is the squared coherence; ``magnitude_std`` (n,) in y per u and
    ``phase_std_rad`` (n,) are the sigma of |G| and of its angle.
    """

    frequency_hz: Floats
    G: NDArray[np.complex128]
    coherence: Floats
    magnitude_std: Floats
    phase_std_rad: Floats


def curves_from_step(
    y: ArrayLike, sample_time_s: float, u0: float = 1.0, before: int = 0
) -> Curves:
    """Return h and g measured with a step of height u0 at the sample ``before`` (active, eq. 1-2).

    ``y`` (n,); h = 0 is its mean before the step, or its first sample. Sigma assumes white noise
    with the variance that follows from the second differences of y.

    Raises:
        ConfigError: y is not finite, has fewer than 3 samples from the step on, or u0 = 0.
    """
    y = np.asarray(y, dtype=np.float64)
    if y.ndim != 1 or not np.isfinite(y).all() or not 0 <= before <= len(y) - 3:
        raise ConfigError(f"y must be finite and hold 3 samples after the step, got {y.shape}")
    if not math.isfinite(u0) or u0 == 0.0 or not sample_time_s > 0.0:
        raise ConfigError(f"u0 must not be 0 and Ts > 0, got {u0!r} and {sample_time_s!r}")
    level = y[:before].mean() if before else y[0]
    h = (y[before:] - level) / u0
    noise = float(np.std(np.diff(y[before:], 2))) / math.sqrt(6.0) / abs(u0)
    g, one = np.diff(h) / sample_time_s, np.ones(len(h) - 1)
    h_std = one * noise * math.sqrt(1.0 + 1.0 / max(before, 1))
    g_std = one * noise * math.sqrt(2.0) / sample_time_s
    return Curves(_grid(len(one), sample_time_s), h[:-1], h_std, g, g_std)


def curves_from_data(u: ArrayLike, y: ArrayLike, sample_time_s: float, length: int) -> Curves:
    """Return the first ``length`` values of g and h from any input by least squares (passive).

    ``u``, ``y`` (n,). y(k) = sum of g(i) Ts u(k-1-i) + a constant; sigma assumes white noise.

    Raises:
        ConfigError: a shape is wrong, or the record is too short for this length.
        NotIdentifiable: the input does not excite all values of g.
    """
    u, y = checked_record(u, y)
    rows = len(y) - length
    if length < 1 or rows <= 2 * (length + 1):
        raise ConfigError(f"a length of {length} needs more than the record's {len(y)} samples")
    pasts = [shifted(u, i + 1)[length:] for i in range(length)]
    phi = np.column_stack([*pasts, np.ones(rows)])
    theta, _, rank, _ = np.linalg.lstsq(phi, y[length:], rcond=1e-10)
    if rank < length + 1:
        raise NotIdentifiable(f"the input excites only {rank} of the {length + 1} values asked for")
    residual = y[length:] - phi @ theta
    covariance = np.linalg.inv(phi.T @ phi) * (residual @ residual / (rows - length - 1))
    pulse, spread = theta[:-1], covariance[:-1, :-1]
    # h(k) is the sum of the pulses up to k - 1.
    h_std = np.sqrt(np.diag(np.cumsum(np.cumsum(spread, axis=0), axis=1)))
    return Curves(
        _grid(length, sample_time_s),
        np.concatenate([[0.0], np.cumsum(pulse)[:-1]]),
        np.concatenate([[0.0], h_std[:-1]]),
        np.asarray(pulse / sample_time_s),
        np.sqrt(np.diag(spread)) / sample_time_s,
    )


def curves_from_model(
    theta: Floats, orders: ArmaxOrders, sample_time_s: float, length: int
) -> Curves:
    """Return h and g (length,) of a model's first input, from its theta (n,); sigma is 0."""
    h = step_response(theta, orders, length + 1)
    zero = np.zeros(length)
    t = _grid(length, sample_time_s)
    return Curves(t, h[:-1], zero, np.diff(h) / sample_time_s, zero)


def _grid(length: int, sample_time_s: float) -> Floats:
    return np.asarray(np.arange(length) * sample_time_s, dtype=np.float64)


def answer_by_transient(h: Floats, u: Floats) -> Floats:
    """Return the response y (n,) to the held u (n,) by eq. 2: sum of h(k-j) (u(j) - u(j-1)).

    ``h`` (n,) or longer; u is 0 before its first value.
    """
    return np.convolve(h[: len(u)], np.diff(u, prepend=0.0))[: len(u)]


def answer_by_weighting(g: Floats, u: Floats, sample_time_s: float, h0: float = 0.0) -> Floats:
    """Return the response y (n,) to the held u (n,) by eq. 3: u(k) h(0) + Ts sum g(k-1-j) u(j)."""
    answer = np.convolve(np.concatenate([[0.0], g[: len(u) - 1]]), u)[: len(u)]
    return np.asarray(h0 * u + sample_time_s * answer)


def frequency_response(
    u: ArrayLike, y: ArrayLike, sample_time_s: float, segment_s: float
) -> FrequencyResponse:
    """Return G = S_uy / S_uu of u (n,) and y (n,) from averaged cross spectra (passive).

    Hann windows of ``segment_s`` s overlap by half, each with its mean removed; the frequency 0 is
    left out. Sigma follows Bendat and Piersol (2010, table 9.6), with 0.95 independent averages for
    each of the overlapping segments.

    Raises:
        ConfigError: a shape is wrong, or a segment is below 8 samples or above half the record.
        NotIdentifiable: the input does not move.
    """
    u, y = checked_record(u, y)
    length = round(segment_s / sample_time_s)
    if not 8 <= length <= len(y) // 2:
        raise ConfigError(
            f"a segment must hold at least 8 samples and at most half the record, got {segment_s} s"
        )
    if not np.ptp(u) > 0.0:
        raise NotIdentifiable("the input does not move")
    options = {"fs": 1.0 / sample_time_s, "window": "hann", "nperseg": length}
    frequency, s_uu = signal.welch(u, **options)
    _, s_yy = signal.welch(y, **options)
    _, s_uy = signal.csd(u, y, **options)
    with np.errstate(divide="ignore", invalid="ignore"):
        G = s_uy / s_uu
        coherence = np.clip(np.abs(s_uy) ** 2 / (s_uu * s_yy), 0.0, 1.0)
        averages = 0.95 * (2 * len(y) // length - 1)
        relative = np.sqrt((1.0 - coherence) / (2.0 * averages * coherence))
    return FrequencyResponse(
        frequency[1:], G[1:], coherence[1:], np.abs(G[1:]) * relative[1:], relative[1:]
    )
