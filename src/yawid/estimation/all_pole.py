"""A recursive filter on NumPy alone: what loads scipy.signal would cost a replay half a second."""

from __future__ import annotations

import numpy as np

from yawid.blocks import Floats

BLOCK = 64
"""Samples that one matrix product advances."""


def all_pole(a: Floats, drive: Floats, past: Floats) -> Floats:
    """Return x (n,) of x(k) + a1 x(k-1) + ... = drive(k), by blocks instead of by samples.

    ``a`` (na,) without its leading 1, ``drive`` (n,), ``past`` (na,) the x before, newest first.
    A filter that is not stable overflows to values that are not finite, as any would.
    """
    n, na = len(drive), len(a)
    if na == 0 or n == 0:
        return drive.copy()
    size = max(BLOCK, na)
    blocks = np.zeros((-(-n // size), size))
    blocks.reshape(-1)[:n] = drive
    with np.errstate(over="ignore", invalid="ignore"):
        free = _free_responses(a, size)
        impulse = np.concatenate([[1.0], free[:-1, 0]])
        lag = np.arange(size)[:, None] - np.arange(size)
        forced = blocks @ np.where(lag >= 0, impulse[np.maximum(lag, 0)], 0.0).T
        # From block to block only the newest na values go on.
        pasts = np.empty((len(blocks), na))
        for row, newest in enumerate(forced[:, : -na - 1 : -1]):
            pasts[row] = past
            past = newest + free[: -na - 1 : -1] @ past
        x: Floats = (forced + pasts @ free.T).reshape(-1)[:n]
    return x


def _free_responses(a: Floats, steps: int) -> Floats:
    """Return x (steps, na) without drive; column m follows a past of 1 at m + 1 samples before."""
    na = len(a)
    rows = np.zeros((na + steps, na))
    rows[:na] = np.eye(na)[::-1]
    for k in range(na, na + steps):
        rows[k] = -a @ rows[k - na : k][::-1]
    return rows[na:]
