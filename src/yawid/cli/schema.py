"""The command line of ``yawid schema``: what ``--json`` prints, and what the exit codes mean."""

import argparse
import json
from importlib.resources import files
from typing import Any

from yawid.cli.options import add_command
from yawid.sinks.door import tell_whole

COMMANDS = ("replay", "live", "inspect", "orders", "step", "regress", "trend", "diff", "fleet")
Schema = dict[str, Any]


def add_schema(commands: Any) -> None:
    """Add the command to the parser's."""
    schema = add_command(
        commands, "schema", "[COMMAND]",
        "print the JSON Schema of what --json prints, and the exit codes",
        "yawid schema replay\nyawid schema | jq '.[\"x-exit-codes\"]'",
    )  # fmt: skip
    schema.add_argument(
        "command",
        metavar="COMMAND",
        nargs="?",
        choices=COMMANDS,
        help=f"of one alone: {', '.join(COMMANDS)} (all)",
    )
    schema.set_defaults(run=_schema)


def _schema(arguments: argparse.Namespace) -> int:
    text = (files("yawid.cli") / "schema.json").read_text(encoding="utf-8")
    if arguments.command is not None:
        schema = of_command(json.loads(text), arguments.command)
        text = json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
    tell_whole(text)
    return 0


def of_command(schema: Schema, command: str) -> Schema:
    """Return the schema of what one command prints, with the definitions that it needs."""
    needed: set[str] = set()
    _collect(schema["$defs"], command, needed)
    defs = {name: each for name, each in schema["$defs"].items() if name in needed - {command}}
    kept = {name: each for name, each in schema.items() if name not in ("anyOf", "$defs")}
    return {
        **kept,
        "title": f"yawid {command} --json",
        "description": f"{schema['$defs'][command]['description']}. {schema['description']}",
        **{k: v for k, v in schema["$defs"][command].items() if k != "description"},
        "$defs": defs,
    }


def _collect(defs: Schema, name: str, needed: set[str]) -> None:
    """Add a definition and all that it refers to."""
    if name in needed:
        return
    needed.add(name)
    waiting: list[Any] = [defs[name]]
    while waiting:
        each = waiting.pop()
        if isinstance(each, dict):
            if isinstance(ref := each.get("$ref"), str):
                _collect(defs, ref.removeprefix("#/$defs/"), needed)
            waiting += each.values()
        elif isinstance(each, list):
            waiting += each
