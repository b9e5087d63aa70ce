"""Closed forms of the paper's step responses, and the numbers that follow from them: eq. 4-16, 23.

Printed slips: the limit of eq. 8 is s -> 0; eq. 15 repeats the letters of eq. 12, Delta h/k, and
means Delta y/(k u0).
"""

import math

import numpy as np

from yawid.blocks import Floats
from yawid.errors import NotIdentifiable


def first_order_response(t: Floats, K: float, T: float) -> Floats:
    """Return c(t) = K (1 - exp(-t/T)) of eq. 4 at t (n,) in s, 0 before t = 0."""
    return np.asarray(-K * np.expm1(-np.maximum(t, 0.0) / T))


def first_order_settling(T: float, tolerance: float) -> float:
    """Return the settling time T ln(1/tolerance) of eq. 6 in s; the tolerance is 0.02 or 0.05."""
    return T * math.log(1.0 / tolerance)


def second_order_response(t: Floats, k: float, D: float, q: float) -> Floats:
    """Return h(t) of eq. 7, k q^2 / (s^2 + 2 q D s + q^2), at t (n,) in s; 0 before t = 0."""
    t, root = np.maximum(t, 0.0), math.sqrt(1.0 - D * D)
    ring = np.exp(-D * q * t) / root * np.sin(q * root * t + math.acos(D))
    return np.asarray(k * (1.0 - ring))


def second_order_settling(D: float, q: float, tolerance: float) -> float:
    """Return the time in s at which exp(-D q t)/sqrt(1 - D^2), the envelope, is the tolerance."""
    return -math.log(tolerance * math.sqrt(1.0 - D * D)) / (D * q)


def yaw_response(t: Floats, K: float, T: float, xi: float, omega: float) -> Floats:
    """Return the yaw rate of eq. 23, K (T s + 1) w^2 / (s^2 + 2 xi w s + w^2), after a unit step.

    ``t`` (n,) in s, T in s, omega in rad/s, 0 <= xi < 1; 0 before t = 0. With T = 0 it is eq. 7.
    """
    t, root = np.maximum(t, 0.0), math.sqrt(1.0 - xi * xi)
    swing = np.exp(-xi * omega * t) * np.sin(omega * root * t)
    return second_order_response(t, K, xi, omega) + K * T * omega / root * swing


def yaw_settling(T: float, xi: float, omega: float, tolerance: float) -> float:
    """Return the time in s at which the envelope of eq. 23's transient is tolerance times K."""
    root = math.sqrt(1.0 - xi * xi)
    height = math.hypot(1.0, (xi - T * omega) / root)
    return max(math.log(height / tolerance), 0.0) / (xi * omega)


def overshoot(D: float) -> float:
    """Return the overshoot Delta h / k = exp(-pi D / sqrt(1 - D^2)) of eq. 10-11."""
    return math.exp(-math.pi * D / math.sqrt(1.0 - D * D))


def second_order_from_peak(
    y_end: float, y_max: float, t1: float, u0: float = 1.0
) -> tuple[float, float, float]:
    """Return k, D, q by eq. 8, 12 and 13, or 14-16 for a step of height u0.

    ``y_end`` is the steady state and ``y_max`` the first extremum, both from the value at the step;
    ``t1`` is the time in s from the step to that extremum; k is in y per u, q in rad/s.

    Raises:
        NotIdentifiable: the overshoot is not between 0 and 100 %, or t1 is not > 0: not eq. 7.
    """
    share = (y_max - y_end) / y_end if y_end else math.nan
    if not 0.0 < share < 1.0 or not t1 > 0.0:
        raise NotIdentifiable(
            f"not the form of eq. 7: from the start, {y_max:g} at {t1:g} s and {y_end:g} at last "
            "show no overshoot between 0 and 100 %"
        )
    D = 1.0 / math.sqrt(1.0 + math.pi**2 / math.log(share) ** 2)
    return y_end / u0, D, math.pi / (t1 * math.sqrt(1.0 - D * D))
