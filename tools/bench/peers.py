"""Recursive least squares to compare with: a plain NumPy loop, and filterpy's Kalman filter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from yawid.blocks import Floats

FORGETTING = 0.998


def _shift(phi: Floats, order: int, *newest: float) -> None:
    """Shift the three parts of the regressor by one sample."""
    for first, value in zip(range(0, 3 * order, order), newest, strict=True):
        phi[first + 1 : first + order] = phi[first : first + order - 1]
        phi[first] = value


def numpy_els(u: Floats, y: Floats, order: int, samples: int) -> None:
    """Run ELS as one would first write it: with the a posteriori residual, P as a full matrix."""
    n = 3 * order
    theta, P, phi = np.zeros(n), 100.0 * np.eye(n), np.zeros(n)
    for k in range(samples):
        e = y[k] - phi @ theta
        P_phi = P @ phi
        gain = P_phi / (FORGETTING + phi @ P_phi)
        theta = theta + gain * e
        P = (P - np.outer(gain, P_phi)) / FORGETTING
        residual = y[k] - phi @ theta
        _shift(phi, order, -y[k], u[k], residual)


def filterpy_els(u: Floats, y: Floats, order: int, samples: int) -> None:
    """Run ELS on filterpy's KalmanFilter with fading memory, F = I and H = phi'."""
    from filterpy.kalman import KalmanFilter

    n = 3 * order
    kalman = KalmanFilter(dim_x=n, dim_z=1)
    kalman.P *= 100.0
    kalman.Q[:] = 0.0
    kalman.alpha = FORGETTING**-0.5
    phi = np.zeros(n)
    for k in range(samples):
        kalman.predict()
        kalman.update(y[k], H=phi.reshape(1, -1))
        residual = y[k] - phi @ kalman.x[:, 0]
        _shift(phi, order, -y[k], u[k], residual)


PEERS: dict[str, tuple[Callable[[Floats, Floats, int, int], None], int]] = {
    "plain NumPy loop": (numpy_els, 300),
    "filterpy KalmanFilter": (filterpy_els, 150),
}
"""The functions of u, y, order and samples by name, each with its samples in one measurement."""
