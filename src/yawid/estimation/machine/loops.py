"""The two loops of a fit over a whole record, in LLVM's own language: compiled in 0.05 s.

NumPy has neither: sums row after row, whatever the number of columns, and a recursion over rows.
numba would need seconds, and whoever estimates for the first time would wait for it.
"""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any

from llvmlite import ir

from yawid.blocks import Floats
from yawid.estimation.machine import kept
from yawid.estimation.machine.object_code import loaded, module_of, object_of

_INT = ir.IntType(64)
_ARRAY = ir.DoubleType().as_pointer()
_0, _1 = _INT(0), _INT(1)
_MAKING = Lock()


@contextmanager
def _loop(b: Any, start: Any, end: Any) -> Iterator[Any]:
    """Build ``for i in range(start, end)``; what is built inside is its body."""
    before, body, after = b.block, b.append_basic_block(), b.append_basic_block()
    b.cbranch(b.icmp_signed("<", start, end), body, after)
    b.position_at_end(body)
    i = b.phi(_INT)
    i.add_incoming(start, before)
    yield i
    following = b.add(i, _1)
    i.add_incoming(following, b.block)
    b.cbranch(b.icmp_signed("<", following, end), body, after)
    b.position_at_end(after)


def _at(b: Any, array: Any, row: Any, columns: Any, column: Any) -> Any:
    """Return where array[row, column] stands."""
    return b.gep(array, [b.add(b.mul(row, columns), column)])


def _build_over_a(b: Any, a: Any, rows: Any, na: Any, n: Any, m: Any) -> None:
    with _loop(b, na, n) as k, _loop(b, _0, m) as j:
        x = _at(b, rows, k, m, j)
        with _loop(b, _0, na) as i:
            past = b.load(_at(b, rows, b.sub(b.sub(k, _1), i), m, j))
            b.store(b.fsub(b.load(x), b.fmul(b.load(b.gep(a, [i])), past)), x)


def _build_add_products(b: Any, a: Any, other: Any, out: Any, n: Any, m: Any, width: Any) -> None:
    with _loop(b, _0, n) as k, _loop(b, _0, m) as i:
        x = b.load(_at(b, a, k, m, i))
        with _loop(b, _0, width) as j:
            total = _at(b, out, i, width, j)
            product = b.fmul(x, b.load(_at(b, other, k, width, j)))
            b.store(b.fadd(b.load(total), product), total)


_BUILDERS: dict[str, tuple[Any, int]] = {
    "over_a": (_build_over_a, 2),
    "add_products": (_build_add_products, 3),
}
"""Name -> who builds it, and how many arrays it takes before its three lengths."""


def _built() -> bytes:
    module = ir.Module()
    for name, (build, arrays) in _BUILDERS.items():
        kinds = [_ARRAY] * arrays + [_INT] * 3
        function = ir.Function(module, ir.FunctionType(ir.VoidType(), kinds), name)
        for array in function.args[:arrays]:
            array.add_attribute("noalias")
        b = ir.IRBuilder(function.append_basic_block())
        build(b, *function.args)
        b.ret_void()
    return object_of(module_of(str(module), kept=tuple(_BUILDERS)))


@cache
def _functions() -> dict[str, Any]:
    """Return the two as functions of addresses and lengths, which run without Python's lock.

    A loop over a long record must not keep other threads.
    """
    if (code := kept.find("loops")) is None:
        code = _built()
        kept.keep("loops", code)
    found = {}
    for address, (name, (_, arrays)) in zip(
        loaded(code, *_BUILDERS), _BUILDERS.items(), strict=True
    ):
        types = [ctypes.c_void_p] * arrays + [ctypes.c_int64] * 3
        found[name] = ctypes.CFUNCTYPE(None, *types)(address)
    return found


def _function(name: str) -> Any:
    with _MAKING:
        return _functions()[name]


def _address(array: Floats) -> int:
    assert array.flags.c_contiguous
    address: int = array.__array_interface__["data"][0]
    return address


def over_a(a: Floats, rows: Floats) -> None:
    """Filter each column of the rows (na + n, m) by 1/A(q) in place; the first na rows are past.

    ``a`` (na,) is without its leading 1. Both are contiguous.
    """
    _function("over_a")(_address(a), _address(rows), len(a), *rows.shape)


def add_products(a: Floats, b: Floats, out: Floats) -> None:
    """Add a' b (m, l) of a (n, m) and b (n, l) to out, row after row. All are contiguous."""
    pointers = (_address(a), _address(b), _address(out))
    _function("add_products")(*pointers, *a.shape, b.shape[1])
