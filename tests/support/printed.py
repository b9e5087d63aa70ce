"""What a command prints with ``--json``, held to the schema that ``yawid schema`` prints of it."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from yawid.cli.json_schema import document, of_command

WHOLE: dict[str, Any] = document()


@cache
def validator(command: str) -> Any:
    import jsonschema

    return jsonschema.Draft202012Validator(of_command(WHOLE, command))


def why_invalid(command: str, told: Any) -> str:
    """Return where and why an object is not of the schema, nothing where it is."""
    return "; ".join(
        f"{e.json_path}: {e.message[:200]}" for e in validator(command).iter_errors(told)
    )


def _refused(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON")


def printed(command: str, out: str) -> Any:
    """Return the object in a line that a command printed, which is of its schema."""
    told = json.loads(out, parse_constant=_refused)
    assert why_invalid(command, told) == ""
    return told
