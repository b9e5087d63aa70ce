"""Makes long logs quickly, with ATTITUDE and SERVO_OUTPUT_RAW alone."""

from __future__ import annotations

import numpy as np
from flightlog import START_US, FlightLog
from flights.long_log import packed
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def long_log(rate: Floats, rudder_us: Floats, hz: float, start_s: float = 10.0) -> bytes:
    """Return a plane's log: yaw rate (n,) in rad/s at each instant, rudder (n,) in us after it."""
    t_us = np.round(1e6 * (start_s + np.arange(len(rate)) / hz)).astype(np.int64)
    number, sent_us = 2 * np.arange(len(rate)), START_US + 3000
    pulses = dict.fromkeys((f"servo{i}_raw" for i in range(1, 9)), 1500)
    pulses |= {"servo4_raw": np.round(rudder_us)}
    parts = [
        packed("ATTITUDE", t_us, number, sent_us, {"yawspeed": rate}),
        packed("SERVO_OUTPUT_RAW", t_us, number + 1, sent_us, pulses),
    ]
    rows = [part.view(np.uint8).reshape(len(part), -1) for part in parts]
    head = FlightLog()
    head.heartbeat(start_s - 0.1)
    return head.data + np.concatenate(rows, axis=1).tobytes()
