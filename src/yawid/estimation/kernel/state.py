"""The packed state: all that the recursion knows, in one contiguous float64 array.

First the header slots named here, then the parts that :func:`views` cuts out, the window last.
One array makes a single-sample call cheap and saving exact.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.kernel.linear_algebra import hot, part

# The structure, fixed when the state is made.
N, NA, NC, M, R, LAGS, WINDOW, DEPTH, BIAS, RML = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
SCALED, START_FIT, MINIMUM, DRIFTS, P0, D_MAX, WARM = 10, 11, 12, 13, 14, 15, 16
LAMBDA_START, LAMBDA_END, LAMBDA_RATE, FLOOR = 17, 18, 19, 20
# The sample: y as given (the inputs have their own part) and what became of it, scaled.
Y, Y_HAT, INNOVATION, RESIDUAL, STATUS = 21, 22, 23, 24, 25
# What moves.
PHASE, COUNT, HEAD, BROKEN, FILL, UPDATES, HELD, SINCE, NEXT = 26, 27, 28, 29, 30, 31, 32, 33, 34
LAMBDA, S1, S2, LOSS, E2, EPS2, Y2, FAST_E2, FAST_Y2 = 35, 36, 37, 38, 39, 40, 41, 42, 43
DIVERGED, HALVED, RESTARTS, HEADER = 44, 45, 46, 47

# The parts, as views() returns them.
THETA, D, UPPER, PHI, PSI, GAIN, RAW, FILTERED, SCRATCH = range(9)
COVARIANCE, ECHO, RESIDUALS, PRODUCTS, HEADS, FRESH, TAPS = range(9, 16)
FACTORS, UNITS, DRIFT, LEAST, BEST, C, INPUTS, SAMPLES = range(16, 24)

GATHERING, FITTING, RUNNING = 0.0, 1.0, 2.0  # PHASE: fill the window, await the start fit, recurse
WARMING_UP, TRACKING, HOLDING, DIVERGING = 0.0, 1.0, 2.0, 3.0  # STATUS, as blocks.Status
PSI_FROM = 150  # rml: updates with psi = phi, until C is good enough to filter by
HALVINGS = 12  # of a step that would make C unstable; then it is not taken at all
FAST = 0.99  # forgetting of the test for divergence
FEW = 25.0  # samples it takes to follow the residual's correlation over one lag
SLACK = 0.03  # the share by which P[k, k] may exceed its usual least, times the floor
SETTLING = 1000  # updates during which the least of P[k, k] is simply the least
FAST_FALL = 0.98  # later, how fast that least may fall at a visit
SLOW_RISE = 1e-3  # how fast it rises, per memory
MOST_RISE = 10.0  # and how far, over the least of all time


@hot
def places(s):
    """Return where each part of the state begins, and where the last one ends (25 ints).

    On scaled signals: theta, D (N,), U (N(N-1)/2,) the columns above the diagonal, phi, psi, gain
    (N,), raw and filtered registers (R,), scratch. Where LAGS > 0: covariance (N N,) of theta, echo
    (N,) of past innovations in it, residuals (LAGS,), products (LAGS + 1,) of them. heads (M + 4,):
    where the registers of y, inputs, residual and 1 begin, and the end; fresh (M + 3,) what enters
    them next, taps (N,) where phi finds its entries. factors (M + 1,) scale y and u, units (N,)
    take theta to the user's units, drift (N,) is added to P, least (N,) is the usual least of
    P[k, k], best (N,) that of all time, c (NC,) filters psi. inputs (M,). samples: WINDOW rows of
    break flag, y, u.
    """
    n, m, r, lags = int(s[N]), int(s[M]), int(s[R]), int(s[LAGS])
    theta = HEADER
    upper = theta + 2 * n
    phi = upper + n * (n - 1) // 2
    raw = phi + 3 * n
    scratch = raw + 2 * r
    covariance = scratch + max(n, m + 3)
    echo = covariance + (n * n if lags > 0 else 0)
    residuals = echo + (n if lags > 0 else 0)
    products = residuals + lags
    heads = products + (lags + 1 if lags > 0 else 0)
    fresh = heads + m + 4
    taps = fresh + m + 3
    factors = taps + n
    units = factors + m + 1
    c = units + 4 * n
    inputs = c + int(s[NC])
    return (
        theta, theta + n, upper, phi, phi + n, phi + 2 * n, raw, raw + r, scratch, covariance,
        echo, residuals, products, heads, fresh, taps, factors, units, units + n,
        units + 2 * n, units + 3 * n, c, inputs, inputs + m, len(s),
    )  # fmt: skip


def views(s: Floats) -> tuple[Floats, ...]:
    """Cut the packed state into its parts, which share its memory."""
    at = places(s)
    return tuple(s[at[i] : at[i + 1]] for i in range(len(at) - 1))


@hot
def parts(s):
    """Cut it for the recursion, once per block; heads and taps count in their own bits.

    The index of an array may be negative unless its type says that it is not: to ask each time
    would cost as much as what it finds.
    """
    at = places(s)
    return (
        part(s, at[0], at[1]), part(s, at[1], at[2]), part(s, at[2], at[3]),
        part(s, at[3], at[4]), part(s, at[4], at[5]), part(s, at[5], at[6]),
        part(s, at[6], at[7]), part(s, at[7], at[8]), part(s, at[8], at[9]),
        part(s, at[9], at[10]), part(s, at[10], at[11]), part(s, at[11], at[12]),
        part(s, at[12], at[13]), part(s, at[13], at[14]).view(np.uint64),
        part(s, at[14], at[15]), part(s, at[15], at[16]).view(np.uint64),
        part(s, at[16], at[17]), part(s, at[17], at[18]), part(s, at[18], at[19]),
        part(s, at[19], at[20]), part(s, at[20], at[21]), part(s, at[21], at[22]),
        part(s, at[22], at[23]), part(s, at[23], at[24]),
    )  # fmt: skip
