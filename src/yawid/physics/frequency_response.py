"""The frequency response of the plant from measured data, by cross spectra."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from yawid.blocks import Floats
from yawid.errors import ConfigError, NotIdentifiable
from yawid.physics.modes import Complexes


class FrequencyResponse(NamedTuple):
    """G at ``w`` (k,) in rad/s from an input to an output, in y per u.

    ``magnitude_std`` (k,) in y per u and ``phase_std_rad`` (k,) are sigmas of |G| and of its angle,
    NaN where a model does not hold. ``coherence`` (k,) is the squared coherence of what was
    measured with the input or with what a model makes of it, NaN where there is none.
    """

    w: Floats
    G: Complexes
    magnitude_std: Floats
    phase_std_rad: Floats
    coherence: Floats


def frequency_response(
    u: ArrayLike, y: ArrayLike, sample_time_s: float, segment_s: float
) -> FrequencyResponse:
    """Return G = S_uy / S_uu of u (n,) and y (n,) from averaged cross spectra (passive).

    The response is that of the sampled plant. Hann windows of ``segment_s`` s overlap by half, each
    with its mean removed; the frequency 0 is left out. Sigma follows Bendat and Piersol (2010,
    table 9.6), with 0.95 independent averages for each of the overlapping segments.

    Raises:
        ConfigError: a shape is wrong, or a segment is below 8 samples or above half the record.
        NotIdentifiable: the input does not move.
    """
    u, y = np.asarray(u, np.float64), np.asarray(y, np.float64)
    if u.ndim != 1 or u.shape != y.shape or not np.isfinite([u, y]).all():
        raise ConfigError(f"u and y must be (n,) alike, without gaps, got {u.shape} and {y.shape}")
    length = round(segment_s / sample_time_s)
    if not 8 <= length <= len(y) // 2:
        raise ConfigError(
            f"a segment must hold at least 8 samples and at most half the record, got {segment_s} s"
        )
    if not np.ptp(u) > 0.0:
        raise NotIdentifiable("the input does not move")
    options = {"fs": 2.0 * np.pi / sample_time_s, "window": "hann", "nperseg": length}
    w, s_uu = signal.welch(u, **options)
    _, s_uy = signal.csd(u, y, **options)
    _, coherence = signal.coherence(u, y, **options)
    with np.errstate(divide="ignore", invalid="ignore"):
        G = s_uy / s_uu
        averages = 0.95 * (2 * len(y) // length - 1)
        relative = np.sqrt((1.0 - coherence) / (2.0 * averages * coherence))
    return FrequencyResponse(
        w[1:], G[1:], np.abs(G[1:]) * relative[1:], relative[1:], coherence[1:]
    )
