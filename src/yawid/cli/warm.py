"""``yawid warm``: compile the estimators now, for an image, a fleet, or whoever will not wait."""

import argparse
import time
from typing import Any

from yawid.cli.options import add_command
from yawid.errors import SinkError
from yawid.sinks.door import tell


def add_warm(commands: Any) -> None:
    """Add the command to the parser's."""
    warm = add_command(
        commands, "warm", "", "compile the estimators, which the first replays would wait for",
        "yawid warm\nNUMBA_CACHE_DIR=/var/cache/yawid yawid warm",
    )  # fmt: skip
    warm.set_defaults(run=_warm)


def _warm(_: argparse.Namespace) -> int:
    from yawid.estimation.machine.kept import folders, passed_by
    from yawid.estimation.machine.runner import RUNNER, is_plain

    if is_plain():
        tell("nothing to do: NUMBA_DISABLE_JIT is set, the estimators run as plain Python")
        return 0
    if RUNNER.is_compiled():
        tell("nothing to do: the estimators are compiled")
        return 0
    start = time.perf_counter()
    folder = RUNNER.compile()
    why = passed_by()
    if folder is None:
        tried = ", ".join(map(str, folders())) or "none"
        raise SinkError(
            f"compiled code cannot be kept: {why + '; ' if why else ''}no folder can be written to "
            f"(tried: {tried}); set NUMBA_CACHE_DIR to a folder that you alone can write to"
        )
    tell(f"compiled the estimators in {time.perf_counter() - start:.1f} s: {folder}")
    if why:
        tell(why)
    return 0
