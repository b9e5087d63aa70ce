"""The commands about the program itself: ``yawid schema`` and ``warm``."""

import argparse
import json
import time

from yawid.cli.options import Commands, add_command
from yawid.errors import SinkError
from yawid.sinks.door import tell, tell_whole

PRINTING = ("replay", "live", "inspect", "orders", "step", "regress", "trend", "diff", "fleet")
"""The commands whose output has a schema."""


def add_schema(commands: Commands) -> None:
    """Add ``schema`` to the parser."""
    schema = add_command(
        commands, "schema", "[COMMAND]",
        "print the JSON Schema of what --json prints, and the exit codes",
        "yawid schema replay\nyawid schema | jq '.[\"x-exit-codes\"]'",
    )  # fmt: skip
    schema.add_argument(
        "command",
        metavar="COMMAND",
        nargs="?",
        choices=PRINTING,
        help=f"only of one command: {', '.join(PRINTING)} (default: all)",
    )
    schema.set_defaults(run=_schema)


def _schema(arguments: argparse.Namespace) -> int:
    from yawid.cli.json_schema import document, of_command

    schema = document()
    if arguments.command is not None:
        schema = of_command(schema, arguments.command)
    tell_whole(json.dumps(schema, indent=1, ensure_ascii=False) + "\n")
    return 0


def add_warm(commands: Commands) -> None:
    """Add ``warm`` to the parser."""
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
            f"compiled code cannot be saved: {why + '; ' if why else ''}no folder can be written "
            f"to (tried: {tried}); set NUMBA_CACHE_DIR to a folder that you alone can write to"
        )
    tell(f"compiled the estimators in {time.perf_counter() - start:.1f} s: {folder}")
    if why:
        tell(why)
    return 0
