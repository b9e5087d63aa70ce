"""Run the recursion: compiled where there is machine code, else the same in plain Python.

Both work on one packed state and give the same bits, so that a run can change over at any sample.
"""

import ctypes
import logging
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import Floats
from yawid.errors import CompilerError
from yawid.estimation.kernel import entry_points
from yawid.estimation.kernel.state import Unpacked
from yawid.estimation.machine import kept
from yawid.estimation.machine.object_code import RUN, loaded
from yawid.system.processes import OWN_GROUP, run_last

PATIENCE_S = 6.0
"""A process compiles after this much time in plain Python: compiling takes about as long."""
LOOK_S = 1.0
"""Time between two searches for code that another process has compiled."""
PIECE = 1000
"""Samples taken in plain Python before the next search, if one is due."""
MOST_OF_A_REASON = 200
"""Characters of another library's message that are quoted in a line of output."""
TIMES_SLOWER = 50
"""A sample in plain Python takes about this many times as long as in compiled code."""
BEHIND = "from yawid.estimation.machine.runner import compile_behind; compile_behind()"
"""What a process of its own runs to compile."""


def is_plain() -> bool:
    """Return whether NUMBA_DISABLE_JIT asks for plain Python."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


class _Method(ctypes.Structure):
    """PyMethodDef of Python's C interface, which describes a function written in C."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_FASTCALL = 0x80
_METHODS: list[_Method] = []
"""The descriptions in use: they must outlive the functions that Python made of them."""


class Runner:
    """Takes samples by :meth:`run`, which the compiled function replaces as soon as it exists."""

    def __init__(self) -> None:
        self._interpreted_s = 0.0
        self._looked = -LOOK_S
        self._child: subprocess.Popen[bytes] | None = None
        self._is_compiled = False
        self._is_hopeless = False
        self._loops: dict[Callable[..., None], Callable[..., None]] = {}

    def run(self, packed: Floats, u: Floats, y: Floats, out: Floats, first: int) -> int:
        """Take samples as ``entry_points.run``: u (samples m,), y (samples,), out (rows, columns).

        All are contiguous float64; the compiled function does not check that.
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
        """Return whether there is compiled code, from this or from an earlier process."""
        return self._is_compiled or self._found()

    def loop(self, of: Callable[..., None]) -> Callable[..., None] | None:
        """Return a function of ``kernel/entry_points.py`` compiled; None where there is no code.

        Its three arrays must be contiguous float64; it does not check that.
        """
        return self._loops.get(of) if self.is_compiled() else None

    def compile(self) -> Path | None:
        """Compile for this and later processes; return the folder of the code, None if not kept.

        Raises:
            CompilerError: numba or llvmlite failed, for whatever reason.
        """
        try:
            from yawid.estimation.machine.compiler import compiled

            code = compiled()
            self._take(code)
        except Exception as error:
            raise CompilerError(_why(error)) from error
        return kept.keep(RUN, code)

    def compile_behind(self) -> bool:
        """Start a process that compiles, if there is no code; return whether one runs.

        Where that process fails, this one compiles itself after ``PATIENCE_S``, and says why it
        cannot.
        """
        if self.is_compiled():
            return False
        if self._child is None and not is_plain() and sys.executable:
            nowhere = subprocess.DEVNULL
            with suppress(OSError):  # no further process may be started: this one compiles later
                self._child = subprocess.Popen(
                    [sys.executable, "-W", "ignore", "-c", BEHIND],
                    stdin=nowhere, stdout=nowhere, stderr=nowhere, start_new_session=True,
                    creationflags=OWN_GROUP,
                )  # fmt: skip
        return self._child is not None

    def _found(self) -> bool:
        """Look for compiled code at times, or compile; return whether there is compiled code."""
        if is_plain() or self._is_hopeless or time.monotonic() - self._looked < LOOK_S:
            return False
        self._looked = time.monotonic()
        try:
            if (code := kept.find(RUN)) is not None:
                self._take(code)
            elif self._child is not None and self._child.poll() is None:
                return False
            elif self._interpreted_s > PATIENCE_S:
                self.compile()
        except Exception as error:  # whatever llvmlite raises
            self._is_hopeless = True
            why = error if isinstance(error, CompilerError) else _why(error)
            # Without any handler logging writes this line to stderr.
            logging.getLogger(__name__).warning("yawid: %s", why)
        return self._is_compiled

    def _take(self, code: bytes) -> None:
        address, *loops = loaded(code, RUN, *(each.__name__ for each in entry_points.LOOPS))
        called = ctypes.CFUNCTYPE(None, *[ctypes.py_object] * 3)
        self._loops = dict(zip(entry_points.LOOPS, map(called, loops), strict=True))
        method = _Method(RUN.encode(), address, _FASTCALL, None)
        _METHODS.append(method)
        make = ctypes.pythonapi.PyCFunction_NewEx
        make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p] * 3
        run: Any = make(ctypes.addressof(method), None, None)
        self.run = run  # type: ignore[method-assign] # later calls go straight to the machine code
        self._is_compiled = True


def _interpret(packed: Floats, u: Floats, y: Floats, out: Floats, first: int, end: int) -> int:
    """Take the samples from index ``first`` to ``end`` - 1; return how many were taken."""
    inputs = len(u) // max(len(y), 1)
    samples = u[first * inputs : end * inputs].tolist(), y[first:end].tolist()
    state = Unpacked(packed)
    try:
        done = int(entry_points.run(state, *samples, out, 0))
    except ArithmeticError:  # Python raises where an array gives inf or NaN
        with np.errstate(all="ignore"):
            return int(entry_points.run(packed, *samples, out, 0))
    state.pack()
    return done


RUNNER = Runner()


def compile_behind() -> None:
    """Compile, in a process of its own, if there is no code yet."""
    run_last()
    if not RUNNER.is_compiled():
        RUNNER.compile()


def _why(error: Exception) -> str:
    """Return one line: why there is no compiled code, and what to do."""
    line = (str(error).strip().splitlines() or [""])[0][:MOST_OF_A_REASON]
    shown = "".join(each if each.isprintable() else "?" for each in line)
    text = f"{type(error).__name__}: {shown}".removesuffix(": ")
    return (
        f"the estimators cannot be compiled ({text}): they run as plain Python, about "
        f"{TIMES_SLOWER} times slower; install the numba and llvmlite that yawid requires"
    )
