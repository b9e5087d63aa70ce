"""Who takes the samples: the compiled recursion where there is one, else the same as plain Python.

Both work on one packed state and give the same bits, so that a run changes over at any sample.
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
from yawid.estimation.machine.object_code import ADD_PRODUCTS, RUN, loaded

PATIENCE_S = 6.0
"""A process that has interpreted for so long compiles: that takes about as long."""
LOOK_S = 1.0
"""How often a process that interprets looks whether another has compiled."""
PIECE = 1000
"""Samples between two looks."""
MOST_OF_A_REASON = 200
"""Characters of another library's message that a line of ours takes."""
TIMES_SLOWER = 50
"""The samples of a plain run take about as many times as long as those of a compiled one."""
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
        self._child: subprocess.Popen[str] | None = None
        self._is_compiled = False
        self._is_hopeless = False
        self._add_products: Callable[..., None] | None = None

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

    def add_products(self) -> Callable[..., None] | None:
        """Return the compiled ``records.add_products``; None where there is no compiled code.

        Its three arrays are contiguous float64; it does not look.
        """
        return self._add_products if self.is_compiled() else None

    def compile(self) -> Path | None:
        """Compile, for this process and those to come; return the folder, None if it is not kept.

        Raises:
            CompilerError: numba or llvmlite cannot, for whatever reason.
        """
        try:
            from yawid.estimation.machine.compiler import compiled

            code = compiled()
            self._take(code)
        except Exception as error:
            raise CompilerError(_why(error)) from error
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
                [sys.executable, "-W", "ignore", "-c", _BEHIND], text=True,
                stdin=nowhere, stdout=subprocess.PIPE, stderr=nowhere, start_new_session=True,
            )  # fmt: skip
        return self._child is not None

    def _found(self) -> bool:
        """Look for compiled code now and then, or make it; tell whether it is there."""
        if is_plain() or time.monotonic() - self._looked < LOOK_S:
            return False
        self._looked = time.monotonic()
        try:
            if (code := kept.find(RUN)) is not None:
                self._take(code)
            elif self._is_hopeless or self._is_under_way():
                return False
            elif self._interpreted_s > PATIENCE_S:
                self.compile()
        except CompilerError as error:
            self._give_up(str(error))
        except Exception as error:  # whatever llvmlite raises
            self._give_up(_why(error))
        return self._is_compiled

    def _is_under_way(self) -> bool:
        """Tell whether the other process compiles.

        Raises:
            CompilerError: it cannot, and has said why.
        """
        if self._child is None or self._child.poll() is None:
            return self._child is not None
        assert self._child.stdout is not None
        with self._child.stdout as said:
            self._child, why = None, said.read().strip()
        if why:
            raise CompilerError(why)
        return False

    def _give_up(self, why: str) -> None:
        """Say once why this process goes on as plain Python, and do not try again."""
        if self._is_hopeless:
            return
        self._is_hopeless = True
        # Without any handler logging writes this line to stderr.
        logging.getLogger(__name__).warning("yawid: %s", why)

    def _take(self, code: bytes) -> None:
        address, add_products = loaded(code, RUN, ADD_PRODUCTS)
        self._add_products = ctypes.CFUNCTYPE(None, *[ctypes.py_object] * 3)(add_products)
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
    """Be the process that compiles, unless another does or has done, or nothing can be kept.

    Where it cannot, its one line says why to the process that started it.
    """
    os.nice(19)
    with kept.alone(RUN) as is_alone:
        if is_alone and not RUNNER.is_compiled():
            try:
                RUNNER.compile()
            except CompilerError as error:
                with suppress(OSError):  # nobody listens any more
                    os.write(1, str(error).encode())


def _why(error: Exception) -> str:
    """Return in one line why there is no compiled code, and what can be done."""
    line = (str(error).strip().splitlines() or [""])[0][:MOST_OF_A_REASON]
    shown = "".join(each if each.isprintable() else "?" for each in line)
    text = f"{type(error).__name__}: {shown}".removesuffix(": ")
    return (
        f"the estimators cannot be compiled ({text}): "
        f"they run as plain Python, some {TIMES_SLOWER} times slower; "
        "install numba and llvmlite as yawid requires them"
    )
