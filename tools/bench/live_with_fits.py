"""Runs ``yawid live`` in a process that also fits a manoeuvre all the time, on another thread.

    python -m bench.live_with_fits udpin:127.0.0.1:14560 [options of yawid live]

A usual session fits a manoeuvre for some 0.1 s when it ends; here a fit always runs at the same
time as the stream.
"""

from __future__ import annotations

import sys
import threading

import numpy as np
from scipy.signal import lfilter

from yawid.cli.main import main
from yawid.manoeuvre.answered import seen_in

SAMPLES, SAMPLE_TIME_S = 2400, 0.05
A, B, NOISE = (1.0, -1.85, 0.9), (0.0, 0.02, 0.01), 0.002
"""A made-up yaw axis: A and B of the model, and the standard deviation of e. SAMPLES are 120 s, the
longest manoeuvre."""


def fit_for_ever() -> None:
    """Fit one record until the process ends, as a manoeuvre is fitted."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-0.5, 0.5], SAMPLES // 20), 20)
    y = lfilter(B, A, u) + lfilter((1.0,), A, NOISE * rng.standard_normal(SAMPLES))
    while True:
        seen_in(SAMPLE_TIME_S, u, y)


if __name__ == "__main__":
    threading.Thread(target=fit_for_ever, daemon=True).start()
    sys.exit(main(["live", *sys.argv[1:]]))
