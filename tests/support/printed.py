"""Reads the output of ``--json``, and checks it by the schema that ``yawid schema`` prints."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from yawid.cli.json_schema import document

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
