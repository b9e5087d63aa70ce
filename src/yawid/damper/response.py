"""The response of the damped aircraft to a rudder that the pilot moves in addition."""

from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.damper.autopilots import Law
from yawid.physics.continuous import Transfer

FINER: Final = 8
"""The steps of a sample: the rudder is held over each sample."""


def closed_response(
    G: Transfer,  # noqa: N803  as in the text of damper/loop.py
    law: Law,
    gain: float | None,
    u: Floats,
    sample_time_s: float,
) -> Floats:
    """Return the yaw rate (n,) in rad/s of G / (1 + K G) for the rudder u (n,), from rest.

    Without a ``gain`` it is that of G alone. It is found in the frequency domain, where the delays
    are exact, and is valid only where the loop is stable.
    """
    n, step = len(u), sample_time_s / FINER
    length = 1 << int(np.ceil(np.log2(4 * n * FINER)))
    w = 2.0 * np.pi * np.fft.rfftfreq(length, step)
    s = 1j * np.maximum(w, 1e-6)
    aircraft = G.at(s)[0]
    K = 0.0 if gain is None else law.at(s, gain)  # noqa: N806
    # A step held over its length has its spectrum weighted by a sinc and comes half of it later.
    held = np.sinc(w * step / (2.0 * np.pi)) * np.exp(-0.5j * w * step)
    spectrum = np.fft.rfft(np.repeat(u, FINER), length) * held * aircraft / (1.0 + K * aircraft)
    return np.asarray(np.fft.irfft(spectrum, length)[: n * FINER : FINER])
