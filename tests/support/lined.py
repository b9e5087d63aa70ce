"""A flight with a vibration, whose frequency once was the answer."""

from __future__ import annotations

import numpy as np
from flights.flight import Hands
from flights.fly import Made, fly
from flights.hands import by_hand
from flights.moved import SEED
from flights.plan import FlightPlan
from flights.quiet import with_line
from flights.telemetry import Link


def lined() -> Made:
    """Fly a Dutch roll near 1.3 rad/s by hand, and add a vibration of 2.4 Hz to the gyro.

    The vibration has 17 % of the yaw rate's power and is not a mode of the aircraft, so 15.1 rad/s
    must not be the answer. The flight is as it was when that mistake was found, with an autopilot
    whose sensors have no noise.
    """
    rng = np.random.default_rng([SEED, 2])
    plan = FlightPlan(
        aircraft="t6texan2", speed_kt=138.0, altitude_ft=5000.0, seconds=120.0, manoeuvre="none",
        true_feedback=True,
    )  # fmt: skip
    hands = Hands(rudder=by_hand(rng, plan.seconds, amplitude=0.12, unit_s=1.5))
    made = fly(plan, Link(attitude_hz=25.0, servo_hz=25.0), hands, group="line", line_hz=2.4)
    return Made(with_line(made.log, 2.4, 0.17, rng), made.truth)
