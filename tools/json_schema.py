"""Writes src/yawid/cli/schema.json, what ``yawid schema`` prints: JSON Schema of every ``--json``.

It is made of the types that are printed and of tools/json_keys.py: what a new key says stands
there. A test holds the file to it.

    python tools/json_schema.py
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import msgspec
from json_keys import ENTRIES, PATTERNS, SAYS, SUFFIXES, UNITS, VALUES, WITHIN

from yawid.config.run import RunConfig
from yawid.dataset.schema import PHYSICS, json_schema
from yawid.errors import EXIT_CODES
from yawid.quantities.table import REDUCTION_ERROR
from yawid.results.inspection import Inspection
from yawid.results.reasons import KINDS
from yawid.results.reports import OrdersReport, RegressReport, StepReport
from yawid.results.run_summary import RunSummary
from yawid.trend.diff import Diff
from yawid.trend.trend import Trend

Schema = dict[str, Any]
FILE = Path(__file__).parents[1] / "src" / "yawid" / "cli" / "schema.json"
PER_LOG = "one object per log on a line; with exit code 2 or 6 there is none, but a line on stderr"
COMMANDS = {
    "replay": (RunSummary, PER_LOG),
    "live": (RunSummary, "one object per vehicle on a line, when the session ends"),
    "inspect": (Inspection, "one object; with exit code 2 or 6 none, but a line on stderr"),
    "orders": (
        OrdersReport,
        "one object; where nothing can be compared none, but a line on stderr",
    ),
    "step": (StepReport, "one object; with exit code 2, 5 or 6 none, but a line on stderr"),
    "regress": (RegressReport, "one object of all cases"),
    "trend": (Trend, "one object; exit code 7 where anything changed"),
    "diff": (Diff, "one object; exit code 7 where anything changed"),
}
"""Command to the type that it prints, and what of it comes when."""
HEAD = (
    "What yawid prints on stdout with --json. A key that does not apply is absent; no number is "
    "NaN or infinite. Units are SI and stand in x-unit (1: a ratio); a key *_std is one sigma, the "
    "total of noise, scatter and structure, *_std_noise the part of it that noise explains. Times "
    "since boot are the vehicle's own."
)


def document() -> Schema:
    """Return the whole schema.

    Raises:
        KeyError: a key of which tools/json_keys.py says nothing.
    """
    _, defs = msgspec.json.schema_components([kind for kind, _ in COMMANDS.values()])
    found = {name: _object(name, schema) for name, schema in defs.items()}
    tables = {f"{name}_row": table for name, table in json_schema()["$defs"].items()}
    commands: Schema = {
        name: {"description": says, "$ref": f"#/$defs/{kind.__name__}"}
        for name, (kind, says) in COMMANDS.items()
    }
    commands["fleet"] = {
        "description": "a row of a data set's tables, as duckdb or pandas turn it into JSON: there "
        "what does not apply is null; yawid fleet itself prints no JSON",
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in tables],
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "yawid --json",
        "description": HEAD,
        "x-exit-codes": {str(code): says for code, says in EXIT_CODES.items()},
        "x-reasons": {
            kind.id: {"weight": kind.weight, "exit_code": kind.exit_code, "what_to_do": kind.now}
            for kind in KINDS.values()
        },
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in commands],
        "$defs": commands | found | tables,
    }


def _object(name: str, schema: Schema) -> Schema:
    """Return one type's schema, with what each of its keys says."""
    return {
        "description": " ".join(schema.get("description", "").replace("``", "").split()),
        "type": "object",
        "additionalProperties": False,
        "required": schema["required"],
        "properties": {key: _key(name, key, each) for key, each in schema["properties"].items()},
    }


def _key(owner: str, key: str, schema: Schema) -> Schema:
    """Return the schema of one key: without null where that is what has no key."""
    if schema.pop("default", ...) is None:
        kinds = [kind for kind in schema["anyOf"] if kind != {"type": "null"}]
        schema = kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    found = {"description": _of(owner, key, SAYS)}
    if (unit := _unit(owner, key)) is not None and _is_number(schema):
        found["x-unit"] = unit
    if (values := _of(owner, key, VALUES, None)) is not None:
        schema = {"enum": list(values)}
    elif key == "id":
        schema = {"enum": list(KINDS)}
    elif key == "recommend":
        schema = _options()
    elif key == "physics":
        schema = _physics()
    elif "additionalProperties" in schema:
        schema = _alike(owner, key, schema["additionalProperties"])
    return found | schema


def _of(owner: str, key: str, table: Any, *default: Any) -> Any:
    own = f"{owner}.{key}"
    return table[own] if own in table else table.get(key, *default) if default else table[key]


def _unit(owner: str, key: str) -> str | None:
    said: str | None = _of(owner, key, UNITS, None)
    return said or next((unit for end, unit in SUFFIXES.items() if key.endswith(end)), None)


def _is_number(schema: Schema) -> bool:
    if "additionalProperties" in schema:
        return _is_number(schema["additionalProperties"])
    return schema.get("type") in ("number", "integer") or schema.get("$ref", "").endswith(
        ("Value", "Told")
    )


def _alike(owner: str, key: str, value: Schema) -> Schema:
    """Return the schema of an object whose values are alike."""
    if (inner := _of(owner, key, WITHIN, None)) is not None:
        entries = {name: {"description": SAYS[name]} | kind for name, kind in inner.items()}
        value = _closed(entries)
    if (pattern := _of(owner, key, PATTERNS, None)) is not None:
        return _closed({pattern: value}, "patternProperties")
    said = _of(owner, key, ENTRIES).items()
    return _closed({name: {"description": says} | value for name, says in said})


def _physics() -> Schema:
    value = {"$ref": "#/$defs/Value"}
    says = {name: {"description": f"of eq. 22-23, {unit}"} for name, unit in PHYSICS}
    says[REDUCTION_ERROR] = {"description": "how badly eq. 23 tells the model's response, a ratio"}
    return _closed({name: said | value for name, said in says.items()})


def _closed(properties: Schema, which: str = "properties") -> Schema:
    return {"type": "object", "additionalProperties": False, which: properties}


def _options() -> Schema:
    """Return the schema of ``recommend``: options of a replay by their names, lists as texts."""
    names = {"from_s": "from", "to_s": "to"}
    found: Schema = {}
    for option in dataclasses.fields(RunConfig):
        if option.name != "given":
            name = names.get(option.name, option.name.replace("_", "-"))
            kind = next((k for t, k in _KINDS.items() if str(option.type).startswith(t)), "string")
            found[name] = {"description": f"as yawid replay --{name}", "type": kind}
    found["record"] = {
        "description": SAYS["record"], "type": "array", "items": {"type": "string"},
    }  # fmt: skip
    return _closed(found)


_KINDS = {"float": "number", "int": "integer", "<class 'float'>": "number"}


def text_of(schema: Schema) -> str:
    """Return it as the file has it."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    FILE.write_text(text_of(document()), encoding="utf-8")
    print(f"{FILE}: {FILE.stat().st_size} bytes")
