"""The arithmetic of the recursion, compiled by numba: the one file that imports it.

The functions run as plain Python under ``NUMBA_DISABLE_JIT=1``; without fastmath both give the
same bits.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import hashlib
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
from llvmlite.binding import get_host_cpu_name
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from yawid.blocks import INNOVATION, NOISE_STD, RESIDUAL, SCALARS, STATUS, Y_HAT

settings: Any = numba.config  # it makes its attributes as it goes
_BLAS = "scipy.linalg.cython_blas"
COMPILED = ("linear_algebra.py", "state.py", "forgetting.py", "recursion.py", "entry_points.py")


def _cache_folder() -> str:
    """Name a folder by what is compiled: numba sees changes of a function's own file only."""
    here = Path(__file__).parent
    digest = hashlib.sha256(b"".join((here / name).read_bytes() for name in COMPILED))
    # Versions side by side, and machines that share the folder, keep apart.
    machine = (numba.__version__, settings.CPU_NAME or get_host_cpu_name(), settings.CPU_FEATURES)
    digest.update(repr(machine).encode())
    digest.update(repr((Y_HAT, INNOVATION, RESIDUAL, NOISE_STD, STATUS, SCALARS)).encode())
    base = Path(settings.CACHE_DIR or here / "__pycache__")
    return str(base / digest.hexdigest()[:16])


def _look_for_blas() -> None:
    """Have numba find SciPy's BLAS without its import, which takes 0.07 s.

    numba only looks whether it is there, and imports it itself when code needs it; none here does.
    """
    if _BLAS not in sys.modules:
        sys.modules[_BLAS] = ModuleType(_BLAS)
        import_module("numba.np.arraymath")
        del sys.modules[_BLAS]


def jit(function: Callable[..., Any]) -> Any:
    """Compile with numba's cache, or without where it finds no directory to write to."""
    if settings.DISABLE_JIT:  # compiled code does not warn of an overflow either
        return np.errstate(all="ignore")(function)
    return _compile(function)


def unlocked(function: Callable[..., Any]) -> Any:
    """Compile what goes over a whole record: without the lock that would keep other threads."""
    if settings.DISABLE_JIT:
        return jit(function)
    return _compile(function, nogil=True)


def hot(function: Callable[..., Any]) -> Any:
    """Compile into each caller: for what runs at every sample, where calls cost most."""
    return _compile(function, forceinline=True, no_cpython_wrapper=True)


def merged(function: Callable[..., Any]) -> Any:
    """Let numba write it into its one caller, for what is long and would else be compiled twice.

    For what is short :func:`hot` costs less: numba copies the caller for each.
    """
    return _compile(function, inline="always")


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    if function.__name__.startswith("_"):  # not called from Python
        options["no_cpython_wrapper"] = True
    options |= {"error_model": "numpy", "no_cfunc_wrapper": True}
    given, settings.CACHE_DIR = settings.CACHE_DIR, FOLDER
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:
        return numba.njit(**options)(function)
    finally:
        settings.CACHE_DIR = given


FOLDER = _cache_folder()
_look_for_blas()


def cutter(header: np.dtype[Any], parts: Any, indices: frozenset[str]) -> tuple[Any, Any]:
    """Return what reads the header of a packed state by name, and what cuts it into its parts.

    The first takes the state, the second the state and the lengths of the parts between the whole,
    which comes first, and the rest, which comes last. Views are unchecked and not counted: the
    caller keeps the state alive; a slice's checks and counts cost more than the arithmetic.
    """
    first = header.itemsize // 8
    record: Any = numba.from_dtype(header)

    @intrinsic
    def named(_context, packed):
        def generate(context, builder, _signature, values):
            whole = context.make_array(packed)(context, builder, values[0])
            return builder.bitcast(whole.data, context.get_value_type(record))

        return record(packed), generate

    @intrinsic
    def cut(_context, packed, lengths):
        whole_numbers = packed.copy(dtype=types.uint64)
        kinds = [whole_numbers if name in indices else packed for name in parts._fields]
        made = types.NamedTuple(kinds, parts)

        def generate(context, builder, _signature, values):
            whole = context.make_array(packed)(context, builder, values[0])
            sizes = cgutils.unpack_tuple(builder, values[1])
            starts, at = [whole.nitems.type(0)], whole.nitems.type(first)
            for size in sizes:
                starts.append(at)
                at = builder.add(at, size)
            sizes = [whole.nitems, *sizes, builder.sub(whole.nitems, at)]
            views = []
            for kind, start, size in zip(kinds, [*starts, at], sizes, strict=True):
                view = context.make_array(kind)(context, builder)
                data = builder.bitcast(builder.gep(whole.data, [start]), view.data.type)
                populate_array(view, data, [size], [whole.itemsize], whole.itemsize, None)
                views.append(view._getvalue())
            return context.make_tuple(builder, made, views)

        return made(packed, lengths), generate

    return named, cut


@hot
def clear(part):
    """Set all of it to zero: a loop compiles in a fraction of what numba's slices take."""
    for i in range(len(part)):
        part[i] = 0.0


@hot
def push(register, start, length, x):
    """Shift x into the register's part, newest first; swapping beats a call of memmove."""
    for i in range(start, start + length):
        x, register[i] = register[i], x


@hot
def bierman(d, upper, psi, lam, gain, most):
    """Update P = U D U' by the row psi; return 1 / alpha, alpha = lambda + psi' P psi.

    ``gain`` becomes P psi: the Kalman gain times alpha (Bierman 1977). P then grows by 1 / lambda,
    its D no further than ``most``.
    """
    over = 1.0 / lam
    alpha, inverse, column = lam, over, 0
    for j in range(len(psi)):
        f = psi[j]
        for i in range(j):
            f += upper[column + i] * psi[i]
        v = d[j] * f
        mu = -f * inverse
        grown = d[j] * over * alpha
        alpha += f * v
        inverse = 1.0 / alpha
        d[j] = min(grown * inverse, most)
        gain[j] = v
        for i in range(j):
            old = upper[column + i]
            upper[column + i] = old + gain[i] * mu
            gain[i] += old * v
        column += j
    return inverse


@hot
def floor(d, upper, k, weight, gain):
    """Add the row "theta[k] is what it is", of the given weight: P shrinks, theta stays."""
    alpha, inverse, column = 1.0, 1.0, k * (k - 1) // 2
    for i in range(k):
        gain[i] = 0.0
    for j in range(k, len(d)):
        f = 1.0 if j == k else upper[column + k]
        v = weight * d[j] * f
        mu = -f * inverse
        before = alpha
        alpha += f * v
        inverse = 1.0 / alpha
        d[j] *= before * inverse
        gain[j] = v
        for i in range(j):
            old = upper[column + i]
            upper[column + i] = old + gain[i] * mu
            gain[i] += old * v
        column += j


@hot
def drift_entry(d, upper, k, q, a):
    """Add q to P[k, k] (Agee and Turner's rank-one update)."""
    clear(a)
    a[k] = 1.0
    for j in range(k, -1, -1):
        column = j * (j - 1) // 2
        old = d[j]
        d[j] = old + q * a[j] * a[j]
        share = q * a[j] / d[j]
        q *= old / d[j]
        for i in range(j):
            a[i] -= a[j] * upper[column + i]
            upper[column + i] += share * a[i]


@hot
def stable(a):
    """Tell whether all zeros of z^n + a1 z^(n-1) + ... lie inside the unit circle; destroys a.

    Jury's test, as a step-down of reflection coefficients.
    """
    if len(a) == 2:
        return abs(a[1]) < 1.0 and abs(a[0]) < 1.0 + a[1]
    for m in range(len(a) - 1, -1, -1):
        k = a[m]
        if not abs(k) < 1.0:
            return False
        rest = 1.0 / (1.0 - k * k)
        for i in range((m + 1) // 2):
            low, high = a[i], a[m - 1 - i]
            a[i] = (low - k * high) * rest
            a[m - 1 - i] = (high - k * low) * rest
    return True


@unlocked
def over_a(a, rows):
    """Filter each column of the rows (na + n, m) by 1/A(q) in place; the first na rows are past."""
    for k in range(len(a), rows.shape[0]):
        for j in range(rows.shape[1]):
            x = rows[k, j]
            for i in range(len(a)):
                x -= a[i] * rows[k - 1 - i, j]
            rows[k, j] = x


@unlocked
def add_products(a, b, out):
    """Add a' b (m, l) of a (n, m) and b (n, l) to out, row after row."""
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            x = a[k, i]
            for j in range(b.shape[1]):
                out[i, j] += x * b[k, j]


@hot
def follow_covariance(covariance, echo, psi, gain, h, inverse, e, memory):
    """Follow the covariance of theta from the innovations as they come, white or coloured.

    With K = inverse * gain and F = I - K psi', theta's error moves by F and is driven by K e, so
    cov <- F cov F' + K e e K' + F h e K' + K e h' F', where h = memory * echo is what earlier
    innovations left in theta, weighted by memory^lag: the residual's autocorrelation, summed as it
    comes (after Grauer and Morelli 2016, with the weights of a geometric window). Any lambda(t)
    and step counts as it was; a floor row moves P but not theta, and so not this.
    """
    n = len(psi)
    quadratic, cross, dot = e * e, 0.0, 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += covariance[j * n + i] * psi[j]
        quadratic += psi[i] * row
        gain[i] *= inverse
        dot += psi[i] * echo[i]
        h[i] = memory * e * echo[i] - row
    cross = memory * e * dot
    for i in range(n):
        h[i] += gain[i] * (0.5 * quadratic - cross)
        echo[i] = memory * (echo[i] - gain[i] * dot) + gain[i] * e
    for i in range(n):
        for j in range(n):
            covariance[i * n + j] += gain[i] * h[j] + h[i] * gain[j]


@hot
def correlate(residuals, products, eps, lam):
    """Keep the running sums of eps(k) eps(k - l), l = 0..LAGS."""
    products[0] = lam * products[0] + eps * eps
    for i in range(len(residuals)):
        products[i + 1] = lam * products[i + 1] + eps * residuals[i]
    push(residuals, 0, len(residuals), eps)


def p_entry(d: Any, upper: Any, i: int, j: int) -> Any:
    """P[i, j] of P = U D U', i <= j."""
    total = d[j] if i == j else upper[j * (j - 1) // 2 + i] * d[j]
    for k in range(j + 1, len(d)):
        column = k * (k - 1) // 2
        total += upper[column + i] * d[k] * upper[column + j]
    return total


entry_of_p = hot(p_entry)
