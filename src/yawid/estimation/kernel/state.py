"""The packed state: everything the recursion knows, in one contiguous float64 array.

First comes the header, whose numbers have names (NUMBERS), then the parts that :func:`cut` returns
(Parts), the window last. One array makes a call with a single sample cheap and saving exact.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from collections.abc import Callable
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.methods import METHODS
from yawid.estimation.polynomials import lag_depth

MARKS: dict[Any, dict[str, Any]] = {}
"""Options of numba's ``njit`` by marked function of the kernel; plain Python ignores them."""


def _marked(**options: Any) -> Callable[[Any], Any]:
    def mark(function: Any) -> Any:
        MARKS[function] = options
        return function

    return mark


hot = _marked(forceinline=True)
"""Compile the function into each caller: for what runs at every sample, where calls cost."""
merged = _marked(inline="always")
"""Let numba copy the function into its only caller: for long ones, else compiled twice."""
called = _marked()
"""Compile the function on its own: for what does not run at every sample of the recursion."""

Indices = NDArray[np.uint64]

NUMBERS = (
    # Fixed when the state is made: r is the length of all registers, depth the largest lag of y
    # and u in phi, warm the number of updates during which the status is WARMING_UP.
    "n", "na", "nc", "m", "r", "lags", "window", "depth", "bias", "filters",
    "scaled", "minimum", "P0", "d_max", "warm",
    "lam_start", "lam_end", "lam_rate", "floor",
    # The sample: y as given (the inputs are a part of their own), and its results, scaled.
    "y", "y_hat", "innovation", "residual", "status",
    # What changes with the samples. count: samples in the window; head: place of its oldest one;
    # broken: 1 if the next sample follows a break; filled: samples since the registers were
    # emptied; since: updates since the start or a restart; next: the parameter whose turn it is at
    # the information floor; lam: lambda; s1, s2, loss as on the page in armax.py; e2, eps2, y2: the
    # same sums of squares; fast_e2, fast_y2: means of squares over about 100 updates.
    "phase", "count", "head", "broken", "filled", "updates", "held", "since", "next",
    "lam", "s1", "s2", "loss", "e2", "eps2", "y2", "fast_e2", "fast_y2",
    "diverged", "halved", "restarts",
)  # fmt: skip
INDICES = frozenset({"heads", "taps"})
HEADER: np.dtype[Any] = np.dtype((np.record, [(name, np.float64) for name in NUMBERS]))


class Parts(NamedTuple):
    """Views of the state, on scaled signals; n parameters, m inputs, ``lags`` of the residual.

    Without lags ``covariance``, ``echo``, ``residuals`` and ``products`` are empty. ``heads`` and
    ``taps`` are unsigned integers in the same memory: compiled code tests a signed index for being
    negative at each access, which would cost as much as the access.
    """

    packed: Floats  # the whole state
    theta: Floats  # (n,)
    d: Floats  # (n,) and
    upper: Floats  # (n (n - 1) / 2,) the columns above the diagonal: P = U D U'
    phi: Floats  # (n,)
    psi: Floats  # (n,)
    gain: Floats  # (n,)
    raw: Floats  # (r,) registers of -y, the inputs, the residual and 1, the newest first
    filtered: Floats  # (r,) the same registers filtered by 1/C(q)
    scratch: Floats  # (max(n, m + 3),) working space
    covariance: Floats  # (n n,) of theta
    echo: Floats  # (n,) what past innovations left in theta
    residuals: Floats  # (lags,) the newest first
    products: Floats  # (lags + 1,) running sums of eps(k) eps(k - l)
    heads: Indices  # (m + 4,) where each register begins, and where the last one ends
    fresh: Floats  # (m + 3,) the values that enter the registers next
    taps: Indices  # (n,) places of the entries of phi in the registers
    factors: Floats  # (m + 1,) that scale y and u
    units: Floats  # (n,) theta in the user's units is theta * units
    least: Floats  # (n,) the usual least of P[k, k], for the information floor
    best: Floats  # (n,) the smallest value that ``least`` has had
    c: Floats  # (nc,) C(q) that filters psi; then a trial C(q) in the test of stability
    inputs: Floats  # (m,) of the sample, as given
    samples: Floats  # (window (m + 2),) rows of break flag, y, u, as given


# phase: fill the window, await its release, recurse, await a restart
GATHERING, FULL, RUNNING, RESTARTING = 0.0, 1.0, 2.0, 3.0
WARMING_UP, TRACKING, HOLDING, DIVERGING = 0.0, 1.0, 2.0, 3.0  # status, as in blocks.Status


@hot
def lengths(s: Any) -> tuple[int, ...]:
    """Return the lengths of the parts from ``theta`` to ``inputs``, for the header s."""
    n, m, r, lags = int(s.n), int(s.m), int(s.r), int(s.lags)
    known = 1 if lags > 0 else 0
    return (
        n, n, n * (n - 1) // 2, n, n, n, r, r, max(n, m + 3),
        known * n * n, known * n, lags, known * (lags + 1), m + 4, m + 3, n,
        m + 1, n, n, n, int(s.nc), m,
    )  # fmt: skip


def named(packed: Floats) -> Any:
    """Return the header of a packed state: its numbers by name, which share its memory."""
    return packed[: len(NUMBERS)].view(HEADER)[0]


def cut(packed: Floats) -> Parts:
    """Return the parts of a packed state, which share its memory."""
    ends = np.cumsum([len(NUMBERS), *lengths(named(packed))])
    views: dict[str, Any] = {"packed": packed, "samples": packed[ends[-1] :]}
    for name, (start, end) in zip(Parts._fields[1:-1], pairwise(ends), strict=True):
        views[name] = packed[start:end].view(np.uint64 if name in INDICES else np.float64)
    return Parts(**views)


class Unpacked:
    """A packed state as Python floats and lists, with which plain Python is four times faster.

    The results have the same bits as with arrays, but Python raises where a float is divided by 0.
    """

    def __init__(self, packed: Floats) -> None:
        self._packed, self._at = packed, cut(packed)
        self.header = SimpleNamespace(**dict(zip(NUMBERS, packed.tolist(), strict=False)))
        self.parts = Parts(self, *(part.tolist() for part in self._at[1:]))  # type: ignore[arg-type] # as lists

    def pack(self) -> None:
        """Write the numbers and parts back to the packed state."""
        self._packed[: len(NUMBERS)] = list(vars(self.header).values())
        for name, part, values in zip(Parts._fields, self._at, self.parts, strict=True):
            if name != "packed" and name not in INDICES:  # these never change
                part[:] = values


# The compiler replaces the next two functions by its own.


def header(state: Any) -> Any:
    """Return the numbers of a state, packed or not, by name."""
    return state.header if isinstance(state, Unpacked) else named(state)


def parts(state: Any) -> Any:
    """Return the parts of a state, packed or not."""
    return state.parts if isinstance(state, Unpacked) else cut(state)


WARM_UPDATES_PER_PARAMETER = 10
"""The status is WARMING_UP for this many updates times the number of parameters."""
D_CAP = 1e6
"""Upper limit of the entries of D in P = U D U', on scaled signals; P0 where that is larger."""


def registers(config: EstimatorConfig) -> tuple[list[int], list[int]]:
    """Return ``heads`` (m + 4), where each register begins and the last ends, and ``taps`` (n).

    There is a register for -y, each of the m inputs, the residual and the constant 1 of the bias,
    the newest value first: -y(k-1), u(k), eps(k-1) when phi(k) is formed. ``taps`` are the places
    of the entries of phi in the registers.
    """
    orders = config.orders
    rows = [(0, orders.na)]
    rows += [(nk, nb) for nb, nk in zip(orders.nb, orders.nk, strict=True)]
    rows += [(0, orders.nc), (0, int(config.bias))]
    heads, taps = [0], list[int]()
    for first, count in rows:
        taps += range(heads[-1] + first, heads[-1] + first + count)
        # The filter 1/C(q) needs nc lags of each signal.
        heads.append(heads[-1] + (max(first + count, orders.nc) if count else 0))
    return heads, taps


def new_state(config: EstimatorConfig) -> Floats:
    """Return the packed state of an estimator that has seen no sample."""
    orders, n, lags = config.orders, config.n_theta, config.residual_lags
    window = max(config.scale_window, config.start_buffer)
    heads, taps = registers(config)
    header: dict[str, float | None] = {  # the configuration has replaced its None
        "n": n, "na": orders.na, "nc": orders.nc, "m": orders.n_inputs,
        "r": heads[-1] + max(1, orders.nc),  # a spare place for signals without a register
        "lags": lags, "window": window, "depth": lag_depth(config.orders),
        "bias": config.bias, "filters": METHODS[config.method].filters,
        "scaled": config.scale_window > 0, "minimum": config.scale_minimum,
        "P0": config.P0, "d_max": max(D_CAP, config.P0),
        "warm": WARM_UPDATES_PER_PARAMETER * n,
        "lam_start": config.forgetting_start, "lam_end": config.forgetting_factor,
        "lam_rate": config.forgetting_rate, "floor": config.information_floor,
        "lam": config.forgetting_start,
        "phase": GATHERING if window else RUNNING, "broken": 1.0,
    }  # fmt: skip
    blank = np.zeros(1, HEADER)
    for name, value in header.items():
        blank[name] = value
    samples = (orders.n_inputs + 2) * window
    rest = np.zeros(sum(lengths(blank[0])) + samples)
    state: Floats = np.concatenate([blank.view(np.float64), rest])
    at = cut(state)
    for part in (at.d, at.least, at.best):
        part[:] = config.P0
    at.covariance[:: n + 1] = config.P0
    at.heads[:], at.taps[:] = heads, taps
    at.factors[:] = 1.0
    at.units[:] = 1.0
    return state


def restart(packed: Floats) -> None:
    """Set theta, P and the statistics to their start values, after a result that is not finite."""
    s, at = named(packed), cut(packed)
    for forgotten in (at.theta, at.upper, at.covariance, at.products):
        forgotten[:] = 0.0
    for known in (at.d, at.least, at.best, at.covariance[:: int(s.n) + 1]):
        known[:] = s.P0
    s.lam = s.lam_start
    s.s1 = s.s2 = s.loss = s.e2 = s.eps2 = s.y2 = s.fast_e2 = s.fast_y2 = 0.0
    s.since, s.broken = 0.0, 1.0
    s.diverged = 1.0
    s.restarts += 1.0
    s.phase, s.status = RUNNING, DIVERGING
