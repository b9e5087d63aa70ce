"""Compile the kernel with numba: the only file that imports it.

The kernel's functions are copied with other globals, so that what they call is compiled as well and
the state's header and parts are read in place. The result is object code that does not need numba.
Its recursion is called as a C function that Python knows (METH_FASTCALL), because numba's own call
from Python takes longer than a sample. The loops over a record are called with the addresses of
three arrays and run without Python's lock.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import re
from types import FunctionType
from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from yawid.estimation.kernel import entry_points, state
from yawid.estimation.kernel.entry_points import LOOPS
from yawid.estimation.kernel.state import MARKS
from yawid.estimation.machine.object_code import RUN, module_of, object_of

_WRAPPER = """
declare i64 @PyLong_AsLongLong(ptr)
declare ptr @PyLong_FromLongLong(i64)
declare i32 @RUN_AT(ptr, ptr, i64, i64, i64, i64, i64)
define ptr @yawid_run(ptr %self, ptr %arguments, i64 %count) {
  %result = alloca i64
  %error = alloca ptr
  %place1 = getelementptr i64, ptr %arguments, i64 1
  %place2 = getelementptr i64, ptr %arguments, i64 2
  %place3 = getelementptr i64, ptr %arguments, i64 3
  %place4 = getelementptr ptr, ptr %arguments, i64 4
  %packed = load i64, ptr %arguments
  %u = load i64, ptr %place1
  %y = load i64, ptr %place2
  %out = load i64, ptr %place3
  %first = load ptr, ptr %place4
  %k = call i64 @PyLong_AsLongLong(ptr %first)
  %status = call i32 @RUN_AT(ptr %result, ptr %error, i64 %packed, i64 %u, i64 %y, i64 %out, i64 %k)
  %done = load i64, ptr %result
  %taken = call ptr @PyLong_FromLongLong(i64 %done)
  ret ptr %taken
}
"""
_LOOP = """
declare i32 @LOOP_AT(ptr, ptr, i64, i64, i64)
define void @NAME(i64 %a, i64 %b, i64 %c) {
  %result = alloca ptr
  %error = alloca ptr
  %status = call i32 @LOOP_AT(ptr %result, ptr %error, i64 %a, i64 %b, i64 %c)
  ret void
}
"""
OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
_HEAD = object.__basicsize__
"""Size of the head of every Python object; in a NumPy array its data, ndim and shape follow."""
_COUNTING = re.compile(r"^define linkonce_odr void @(NRT_\w+)\(.*?^\}", re.DOTALL | re.MULTILINE)
_UNCOUNTED = r"define internal void @\1(ptr %array) alwaysinline { ret void }"
"""Replaces numba's counting of references: the arrays belong to Python and outlive the call."""
_KNOWN = re.compile(r"llvm\..*|Py\w+|log2|exp2|pow|floor|sqrt|mem\w+")
"""The functions that the object code may call: LLVM's own, Python's and C's mathematics."""


@intrinsic
def _named(_context, packed):
    """Return the header of a packed state as a record, whose numbers have names."""
    record: Any = numba.from_dtype(state.HEADER)

    def generate(context, builder, _signature, values):
        whole = context.make_array(packed)(context, builder, values[0])
        return builder.bitcast(whole.data, context.get_value_type(record))

    return record(packed), generate


@intrinsic
def _cut(_context, packed, lengths):
    """Return the parts of the state: the whole first, the window's samples last.

    The views have no checks and no reference counts, which would cost more than the arithmetic:
    the caller keeps the state alive.
    """
    whole_numbers = packed.copy(dtype=types.uint64)
    names = state.Parts._fields
    kinds = [whole_numbers if name in state.INDICES else packed for name in names]
    made = types.NamedTuple(kinds, state.Parts)

    def generate(context, builder, _signature, values):
        whole = context.make_array(packed)(context, builder, values[0])
        sizes = cgutils.unpack_tuple(builder, values[1])
        starts, at = [whole.nitems.type(0)], whole.nitems.type(len(state.NUMBERS))
        for size in sizes:
            starts.append(at)
            at = builder.add(at, size)
        sizes = [whole.nitems, *sizes, builder.sub(whole.nitems, at)]
        views = []
        for kind, start, size in zip(kinds, [*starts, at], sizes, strict=True):
            data = builder.gep(whole.data, [start])
            views.append(_view(context, builder, kind, data, [size], whole.itemsize))
        return context.make_tuple(builder, made, views)

    return made(packed, lengths), generate


def _array_at(ndim: int) -> Any:
    """Return a function that makes an array (float64, contiguous) of a NumPy array's address."""
    kind = types.Array(types.float64, ndim, "C")

    @intrinsic
    def array_at(_context, address):
        def generate(context, builder, _signature, values):
            def field(offset: int, of: Any) -> Any:
                place = builder.add(values[0], values[0].type(_HEAD + offset))
                return builder.load(builder.inttoptr(place, of.as_pointer()))

            shape = field(16, values[0].type.as_pointer())
            sizes = [builder.load(builder.gep(shape, [ir.IntType(32)(i)])) for i in range(ndim)]
            data = field(0, ir.DoubleType().as_pointer())
            return _view(context, builder, kind, data, sizes, values[0].type(8))

        return kind(address), generate

    return array_at


def _view(context: Any, builder: Any, kind: Any, data: Any, sizes: Any, itemsize: Any) -> Any:
    view = context.make_array(kind)(context, builder)
    strides = [itemsize]
    for size in reversed(sizes[1:]):
        strides.insert(0, builder.mul(strides[0], size))
    populate_array(view, builder.bitcast(data, view.data.type), sizes, strides, itemsize, None)
    return view._getvalue()


def _parts() -> Any:
    """Return the compiled ``state.parts``."""
    lengths = _Copies().of(state.lengths)

    @numba.njit(forceinline=True, **OPTIONS)
    def parts(packed):
        return _cut(packed, lengths(_named(packed)))  # type: ignore[call-arg] # numba adds its own

    return parts


class _Copies:
    """Compiled copies of the kernel's functions, one of each."""

    def __init__(self, **replaced: Any) -> None:
        self._replaced = replaced
        self._made: dict[Any, Any] = {}

    def of(self, function: Any) -> Any:
        """Return the compiled copy of a marked function and of all that it calls."""
        if function not in self._made:
            scope = dict(function.__globals__)
            for name in function.__code__.co_names:
                if name in self._replaced:
                    scope[name] = self._replaced[name]
                elif isinstance(known := scope.get(name), FunctionType) and known in MARKS:
                    scope[name] = self.of(known)
            copy = FunctionType(function.__code__, scope, function.__name__)
            self._made[function] = numba.njit(**OPTIONS, **MARKS[function])(copy)
        return self._made[function]


def compiled() -> bytes:
    """Return object code: ``entry_points.run`` as a Python function, and ``entry_points.LOOPS``.

    Raises:
        RuntimeError: the code would call a function that is missing without numba.
    """
    run = _Copies(header=_named, parts=_parts()).of(entry_points.run)
    flat, rows = _array_at(1), _array_at(2)

    @numba.njit(types.int64(*[types.int64] * 5), **OPTIONS)
    def run_at(packed, u, y, out, first):
        return run(flat(packed), flat(u), flat(y), rows(out), first)

    texts, names = [*_text(run_at, _WRAPPER, "RUN_AT")], [each.__name__ for each in LOOPS]
    for name, each in zip(names, LOOPS, strict=True):
        texts += _text(_loop_at(each, rows), _LOOP.replace("NAME", name), "LOOP_AT")
    module = module_of(*texts, kept=(RUN, *names))
    missing = {f.name for f in module.functions if f.is_declaration and not _KNOWN.match(f.name)}
    if missing:
        raise RuntimeError(f"the compiled recursion needs {', '.join(sorted(missing))}")
    return object_of(module)


def _loop_at(loop: Any, rows: Any) -> Any:
    """Return a compiled loop over a record that takes the addresses of its three arrays."""
    compiled_loop = _Copies().of(loop)

    @numba.njit(types.void(*[types.int64] * 3), **OPTIONS)
    def loop_at(a, b, c):
        compiled_loop(rows(a), rows(b), rows(c))

    return loop_at


def _text(compiled_at: Any, wrapper: str, name: str) -> tuple[str, str]:
    """Return a function as LLVM assembly, and the wrapper that calls it in place of ``name``."""
    (signature,) = compiled_at.signatures
    text = _COUNTING.sub(_UNCOUNTED, compiled_at.inspect_llvm(signature))
    return text, wrapper.replace(name, compiled_at.overloads[signature].fndesc.mangled_name)
