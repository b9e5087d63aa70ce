"""Who takes the samples: the compiled recursion where there is one, else the same as plain Python.

Both work on one packed state and give the same bits, so that a run changes over at any sample.
"""

import ctypes
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.kernel import entry_points
from yawid.estimation.kernel.state import Unpacked
from yawid.estimation.machine import kept
from yawid.estimation.machine.object_code import RUN, loaded

PATIENCE_S = 6.0
"""A process that has interpreted for so long compiles: that takes about as long."""
LOOK_S = 1.0
"""How often a process that interprets looks whether another has compiled."""
PIECE = 1000
"""Samples between two looks."""
_BEHIND = "from yawid.estimation.machine.runner import compile_behind; compile_behind()"


def is_plain() -> bool:
    """Tell whether NUMBA_DISABLE_JIT asks for plain Python."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


class _Method(ctypes.Structure):
    """PyMethodDef: how Python is told of a function written in C."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_FASTCALL = 0x80
_METHODS: list[_Method] = []
"""Must outlive the functions that Python made of them."""


class Runner:
    """Takes samples by :meth:`run`, whose place the compiled function takes as soon as it can."""

    def __init__(self) -> None:
        self._interpreted_s = 0.0
        self._looked = -LOOK_S
        self._child: subprocess.Popen[bytes] | None = None
        self._is_compiled = False

    def run(self, packed: Floats, u: Floats, y: Floats, out: Floats, first: int) -> int:
        """Take samples as ``entry_points.run`` does: u (samples M,), y (samples,), out (rows, n).

        All are contiguous float64; the compiled function does not look.
        """
        if first == 0 and (np.isinf(u).any() or np.isinf(y).any()):
            return -1
        while not self._found():
            end = min(first + PIECE, len(y))
            rows = out[first:end] if len(out) == len(y) else out[: int(end == len(y))]
            start = time.perf_counter()
            done = first + _interpret(packed, u, y, rows, first, end)
            self._interpreted_s += time.perf_counter() - start
            if done < end or end == len(y):
                return done
            first = end
        return self.run(packed, u, y, out, first)

    def is_compiled(self) -> bool:
        """Tell whether compiled code is there, from now or from an earlier process."""
        return self._is_compiled or self._found()

    def compile(self) -> Path | None:
        """Compile, for this process and those to come; return the folder, None if it is not kept.

        Raises:
            RuntimeError: numba made what cannot stand alone.
        """
        from yawid.estimation.machine.compiler import compiled

        code = compiled()
        self._take(code)
        return kept.keep(RUN, code)

    def compile_behind(self) -> bool:
        """Have another process compile what is not compiled; tell whether there is one now.

        The last run's may be at it still: the new one sees that and ends.
        """
        if self.is_compiled():
            return False
        if self._child is None and not is_plain() and sys.executable:
            nowhere = subprocess.DEVNULL
            self._child = subprocess.Popen(
                [sys.executable, "-c", _BEHIND],
                stdin=nowhere, stdout=nowhere, stderr=nowhere, start_new_session=True,
            )  # fmt: skip
        return self._child is not None

    def _found(self) -> bool:
        """Look for compiled code now and then, or make it; tell whether it is there."""
        if is_plain() or time.monotonic() - self._looked < LOOK_S:
            return False
        self._looked = time.monotonic()
        if (code := kept.find(RUN)) is not None:
            self._take(code)
        elif self._interpreted_s > PATIENCE_S and not self._is_under_way():
            self._interpreted_s = 0.0
            with suppress(Exception):  # a numba that cannot: Python goes on
                self.compile()
        return self._is_compiled

    def _is_under_way(self) -> bool:
        return self._child is not None and self._child.poll() is None

    def _take(self, code: bytes) -> None:
        (address,) = loaded(code, RUN)
        method = _Method(RUN.encode(), address, _FASTCALL, None)
        _METHODS.append(method)
        make = ctypes.pythonapi.PyCFunction_NewEx
        make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p] * 3
        run: Any = make(ctypes.addressof(method), None, None)
        self.run = run  # type: ignore[method-assign] # from now on without a way round
        self._is_compiled = True


def _interpret(packed: Floats, u: Floats, y: Floats, out: Floats, first: int, end: int) -> int:
    """Take the samples from the first to before the end; return how many were taken."""
    inputs = len(u) // max(len(y), 1)
    samples = u[first * inputs : end * inputs].tolist(), y[first:end].tolist()
    state = Unpacked(packed)
    try:
        done = int(entry_points.run(state, *samples, out, 0))
    except ArithmeticError:  # Python raises where an array's float overflows
        with np.errstate(all="ignore"):
            return int(entry_points.run(packed, *samples, out, 0))
    state.pack()
    return done


RUNNER = Runner()


def compile_behind() -> None:
    """Be the process that compiles, unless another does or has done, or nothing can be kept."""
    os.nice(19)
    with kept.alone(RUN) as is_alone:
        if is_alone and not RUNNER.is_compiled():
            RUNNER.compile()
