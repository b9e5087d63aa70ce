"""``yawid warm``: compile the estimators now, for an image, a fleet, or whoever will not wait."""

import argparse
import time
from typing import Any

from yawid.errors import SinkError


def add_warm(commands: Any) -> None:
    """Add the command to the parser's."""
    warm: argparse.ArgumentParser = commands.add_parser(
        "warm", help="compile the estimators, which the first replay would wait for"
    )
    warm.set_defaults(run=_warm)


def _warm(_: argparse.Namespace) -> int:
    from yawid.estimation.compiled import compile_all, is_switched_off

    if is_switched_off():
        print("nothing to do: NUMBA_DISABLE_JIT is set, the estimators run as plain Python")
        return 0
    start = time.perf_counter()
    compiled = compile_all()
    if compiled.folder is None:
        raise SinkError("compiled code cannot be kept: set NUMBA_CACHE_DIR to a folder to write to")
    if compiled.made:
        taken_s = time.perf_counter() - start
        print(f"compiled {compiled.made} functions in {taken_s:.1f} s: {compiled.folder}")
    else:
        print(f"nothing to do: {compiled.found} compiled functions are in {compiled.folder}")
    return 0
