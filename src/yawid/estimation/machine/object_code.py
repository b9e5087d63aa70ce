"""Machine code with llvmlite: from LLVM assembly to object code, from that to an address.

Code that numba compiled loads without numba, whose import takes longer than a short replay.
"""

import os
from functools import cache
from threading import Lock
from typing import Any

import llvmlite.binding as llvm

RUN = "yawid_run"
"""Name of the compiled recursion in the object code."""
_LOADING = Lock()


def processor() -> tuple[str, str]:
    """Return the name and features of the processor to compile for, as numba reads them."""
    name = os.environ.get("NUMBA_CPU_NAME")
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        features = "" if name else llvm.get_host_cpu_features().flatten()
    return name or llvm.get_host_cpu_name(), features


@cache
def _target() -> Any:
    for begin in (
        llvm.initialize,
        llvm.initialize_native_target,
        llvm.initialize_native_asmprinter,
    ):
        try:
            begin()
        except RuntimeError:  # newer versions initialise themselves and refuse this call
            continue
    name, features = processor()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=name, features=features, opt=3, jit=True)


def module_of(*texts: str, kept: tuple[str, ...]) -> Any:
    """Return one optimised module of texts in LLVM assembly: ``kept`` and what they call."""
    module = llvm.parse_assembly(texts[0])
    for text in texts[1:]:
        module.link_in(llvm.parse_assembly(text))
    for function in module.functions:
        if not function.is_declaration and function.name not in kept:
            function.linkage = "internal"
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = True
    passes = llvm.create_pass_builder(_target(), options)
    passes.getModulePassManager().run(module, passes)
    return module


def object_of(module: Any) -> bytes:
    """Return the object code of a module."""
    code: bytes = _target().emit_object(module)
    return code


@cache
def _engine() -> Any:
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target())


def loaded(code: bytes, *names: str) -> list[int]:
    """Load object code for the rest of the process; return the addresses of the named functions.

    Raises:
        RuntimeError: the object code has no function of one of these names.
    """
    with _LOADING:
        engine = _engine()
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        found = [engine.get_function_address(name) for name in names]
    if not all(found):
        raise RuntimeError(f"the object code lacks some of {', '.join(names)}")
    return found
