"""The packed state: all that the recursion knows, in one contiguous float64 array.

First the header, whose numbers have names, then the parts that :func:`cut` cuts out, the window
last. One array makes a single-sample call cheap and saving exact.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats
from yawid.estimation.kernel.marks import hot

Indices = NDArray[np.uint64]

NUMBERS = (
    # The structure, fixed when the state is made; r is the length of the registers, depth their
    # earliest lag, warm the updates it takes to settle.
    "n", "na", "nc", "m", "r", "lags", "window", "depth", "bias", "filters",
    "scaled", "start_fit", "minimum", "P0", "d_max", "warm",
    "lam_start", "lam_end", "lam_rate", "floor",
    # The sample: y as given (the inputs have their own part) and what became of it, scaled.
    "y", "y_hat", "innovation", "residual", "status",
    # What moves.
    "phase", "count", "head", "broken", "filled", "updates", "held", "since", "next",
    "lam", "s1", "s2", "loss", "e2", "eps2", "y2", "fast_e2", "fast_y2",
    "diverged", "halved", "restarts",
)  # fmt: skip
INDICES = frozenset({"heads", "taps"})
HEADER: np.dtype[Any] = np.dtype((np.record, [(name, np.float64) for name in NUMBERS]))


class Parts(NamedTuple):
    """Views of the state, on scaled signals. Lags, covariance and echo may be empty.

    ``heads`` and ``taps`` count in their own bits: the index of an array may be negative unless its
    type says that it is not, and to ask each time would cost as much as what it finds.
    """

    packed: Floats  # the whole state
    theta: Floats  # (n,)
    d: Floats  # (n,) and
    upper: Floats  # (n (n - 1) / 2,) the columns above the diagonal: P = U D U'
    phi: Floats  # (n,)
    psi: Floats  # (n,)
    gain: Floats  # (n,)
    raw: Floats  # (r,) registers of y, the inputs, the residual and 1, the newest first
    filtered: Floats  # (r,) the same through 1/C(q)
    scratch: Floats  # (max(n, m + 3),)
    covariance: Floats  # (n n,) of theta
    echo: Floats  # (n,) what past innovations left in theta
    residuals: Floats  # (lags,)
    products: Floats  # (lags + 1,) running sums of eps(k) eps(k - l)
    heads: Indices  # (m + 4,) where the registers begin, and the end
    fresh: Floats  # (m + 3,) what enters them next
    taps: Indices  # (n,) where phi finds its entries
    factors: Floats  # (m + 1,) scale y and u
    units: Floats  # (n,) take theta to the user's units
    least: Floats  # (n,) the usual least of P[k, k]
    best: Floats  # (n,) that of all time
    c: Floats  # (nc,) filters psi, then tried for stability
    inputs: Floats  # (m,)
    samples: Floats  # (window (m + 2),) rows of break flag, y, u


# phase: fill the window, await its release, recurse, await a restart, recurse but for theta and P
GATHERING, FITTING, RUNNING, RESTARTING, FROZEN = 0.0, 1.0, 2.0, 3.0, 4.0
WARMING_UP, TRACKING, HOLDING, DIVERGING = 0.0, 1.0, 2.0, 3.0  # status, as blocks.Status
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
def lengths(s: Any) -> tuple[int, ...]:
    """Return the lengths of the parts between the whole and the samples, for the header s."""
    n, m, r, lags = int(s.n), int(s.m), int(s.r), int(s.lags)
    known = 1 if lags > 0 else 0
    return (
        n, n, n * (n - 1) // 2, n, n, n, r, r, max(n, m + 3),
        known * n * n, known * n, lags, known * (lags + 1), m + 4, m + 3, n,
        m + 1, n, n, n, int(s.nc), m,
    )  # fmt: skip


def named(packed: Floats) -> Any:
    """Return the header of a packed state: its numbers by name, in the state's own memory."""
    return packed[: len(NUMBERS)].view(HEADER)[0]


def cut(packed: Floats) -> Parts:
    """Return the parts of a packed state, which share its memory."""
    ends = np.cumsum([len(NUMBERS), *lengths(named(packed))])
    views: dict[str, Any] = {"packed": packed, "samples": packed[ends[-1] :]}
    for name, (start, end) in zip(Parts._fields[1:-1], pairwise(ends), strict=True):
        views[name] = packed[start:end].view(np.uint64 if name in INDICES else np.float64)
    return Parts(**views)


class Unpacked:
    """A packed state as Python's own floats and lists, on which plain Python is four times faster.

    It gives the bits of the array's; but where a float is divided by 0 Python raises.
    """

    def __init__(self, packed: Floats) -> None:
        self._packed, self._at = packed, cut(packed)
        self.header = SimpleNamespace(**dict(zip(NUMBERS, packed.tolist(), strict=False)))
        self.parts = Parts(self, *(part.tolist() for part in self._at[1:]))  # type: ignore[arg-type] # as lists

    def pack(self) -> None:
        """Write it back."""
        self._packed[: len(NUMBERS)] = list(vars(self.header).values())
        for name, part, values in zip(Parts._fields, self._at, self.parts, strict=True):
            if name != "packed" and name not in INDICES:  # these never change
                part[:] = values


# These two the compiler replaces by its own.


def header(state: Any) -> Any:
    """Return the numbers of a state, packed or not, by name."""
    return state.header if isinstance(state, Unpacked) else named(state)


def parts(state: Any) -> Any:
    """Return the parts of a state, packed or not."""
    return state.parts if isinstance(state, Unpacked) else cut(state)
