"""Reads what a command prints by ``--json``, checked by ``yawid schema``, and its exit code."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from yawid.cli.json_schema import document
from yawid.cli.main import main

WHOLE: dict[str, Any] = document()


@cache
def validator(command: str) -> Any:
    import jsonschema

    return jsonschema.Draft202012Validator(document(command))


def why_invalid(command: str, told: Any) -> str:
    """Return where and why an object violates the schema of a command; "" if it does not."""
    return "; ".join(
        f"{e.json_path}: {e.message[:200]}" for e in validator(command).iter_errors(told)
    )


def _refused(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON")


def printed(command: str, out: str) -> Any:
    """Return the object in a line that a command printed; assert that it is valid."""
    told = json.loads(out, parse_constant=_refused)
    assert why_invalid(command, told) == ""
    return told


def answered(capsys: Any, command: str, *words: object) -> tuple[int, Any]:
    """Return the exit code of a command and the object that it prints by ``--json``."""
    code = main([command, *map(str, words), "--json"])
    return code, printed(command, capsys.readouterr().out)


def ended(words: list[str]) -> object:
    """Return the exit code of a command line, also where its parser ends the process."""
    try:
        return main(words)
    except SystemExit as by_parser:
        return by_parser.code
