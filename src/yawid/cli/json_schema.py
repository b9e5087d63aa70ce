"""The JSON Schema of everything that ``--json`` prints, made from the types that are printed.

The words and the unit of a key come from the table of quantities. Keys that are not quantities, or
mean more in one type, have theirs in ``json_keys.toml``.
"""

import json
import re
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from importlib.resources import files
from typing import Any, Final

import msgspec

from yawid.answers.damper_report import DamperReport
from yawid.answers.identified_model import ModelFile
from yawid.answers.inspection import Inspection
from yawid.answers.ordinary import GATES, ORDINARY
from yawid.answers.reasons import KINDS
from yawid.answers.reports import OrdersReport, StepReport
from yawid.answers.run_summary import RunSummary
from yawid.damper.refusals import OF_DAMPER
from yawid.errors import EXIT_CODES
from yawid.estimation.methods import METHODS
from yawid.quantities.airspeed import Kind
from yawid.quantities.table import QUANTITIES, REDUCTION_ERROR, RUDDER, YAW_CHANNEL, quantity
from yawid.trend import SEVERAL

Schema = dict[str, Any]
_PRINTED: Final = {
    "replay": RunSummary, "live": RunSummary, "inspect": Inspection, "orders": OrdersReport,
    "step": StepReport, "damper": DamperReport,
    "export": ModelFile,
}  # fmt: skip
"""The type that each command prints; those of trend and diff take long to import."""
_ENDS: Final = {
    "_rad_s": "rad/s", "_m_s": "m/s", "_rad_m": "rad/m", "_hz": "Hz", "_us": "us", "_ms": "ms",
    "_pct": "%", "_s": "s", "_m": "m", "_deg": "deg",
}  # fmt: skip
"""The unit of a key by the key's end."""


class _Keys:
    """The words and units of keys: by Type.key, by key, or from the table of quantities."""

    def __init__(self) -> None:
        text = (files("yawid.cli") / "json_keys.toml").read_text(encoding="utf-8")
        self.all: Schema = tomllib.loads(text)
        self.all["entries"]["estimates"] = {row.name: row.words for row in METHODS.values()} | {
            "ct": "continuous-time fit"
        }
        self.all["values"] |= {
            "method": [*METHODS, "ct", ORDINARY],
            "airspeed_kind": [kind.name.lower() for kind in Kind],
        }  # fmt: skip

    def find(self, table: str, owner: str, key: str) -> Any:
        """Return the entry of a key in one of the tables of the TOML file, None if it has none."""
        found = self.all[table]
        return found.get(f"{owner}.{key}", found.get(key))

    def says(self, owner: str, key: str) -> str:
        """Return the words of a key.

        Raises:
            KeyError: the key has no words.
        """
        return str(self.find("says", owner, key) or quantity(key).words)

    def unit(self, owner: str, key: str) -> str | None:
        """Return the unit of a key's number, None where it has none, such as a count."""
        if (own := self.find("units", owner, key)) is not None:
            return str(own)
        with suppress(KeyError):
            if unit := quantity(key).unit:
                return unit.replace(RUDDER, "unit of rudder")
        return next((unit for end, unit in _ENDS.items() if key.endswith(end)), None)

    def key(self, owner: str, key: str, schema: Schema) -> Schema:
        """Return the schema of one key, without null where the key is left out instead."""
        if schema.pop("default", ...) is None:
            kinds = [kind for kind in schema["anyOf"] if kind != {"type": "null"}]
            schema = kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
        found = {"description": self.says(owner, key)}
        if (unit := self.unit(owner, key)) is not None and _is_number(schema):
            found["x-unit"] = unit
        if (values := self.find("values", owner, key)) is not None:
            schema = {"enum": values}
        elif key == "id":
            schema = {"enum": [*dict.fromkeys([*KINDS, *OF_DAMPER, SEVERAL, *GATES])]}
        elif key == "physics":
            schema = _physics()
        elif "additionalProperties" in schema:
            schema = self.alike(owner, key, schema["additionalProperties"])
        return found | schema

    def alike(self, owner: str, key: str, value: Schema) -> Schema:
        """Return the schema of an object whose values all have the same type."""
        if (inner := self.find("within", owner, key)) is not None:
            value = _closed(
                {name: {"description": self.says("", name)} | kind for name, kind in inner.items()}
            )
        if (pattern := self.find("patterns", owner, key)) is not None:
            return _closed({pattern: value}, "patternProperties")
        said = self.find("entries", owner, key).items()
        return _closed({name: {"description": says} | value for name, says in said})


def document() -> Schema:
    """Return the whole schema.

    Raises:
        KeyError: a key has no words.
    """
    from yawid.dataset.schema import json_schema
    from yawid.trend.diff import Diff
    from yawid.trend.trend import Trend

    keys, printed = _Keys(), {**_PRINTED, "trend": Trend, "diff": Diff}
    _, defs = msgspec.json.schema_components(printed.values())
    found = {name: _object(name, schema, keys) for name, schema in defs.items()}
    tables = {f"{name}_row": table for name, table in json_schema()["$defs"].items()}
    says = keys.all["commands"]
    commands: Schema = {
        name: {"description": says[name], "$ref": f"#/$defs/{kind.__name__}"}
        for name, kind in printed.items()
    }
    rows = [{"$ref": f"#/$defs/{name}"} for name in tables]
    commands["fleet"] = {"description": says["fleet"], "anyOf": rows}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "yawid --json",
        "description": says["all"],
        "x-exit-codes": {str(code): each for code, each in EXIT_CODES.items()},
        "x-reasons": {
            kind.id: {"weight": kind.weight, "exit_code": kind.exit_code, "what_to_do": kind.now}
            for kind in KINDS.values()
        },
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in commands],
        "$defs": commands | found | tables,
    }


def key_words() -> Iterator[tuple[str, list[str]]]:
    """Yield each quantity and each key of ``--json``, and in lines what it says in which type."""
    keys = _Keys()
    lines = {
        row.name: [
            _said(row.words, row.unit_for()),
            *([f"Symbol: {row.symbol}."] * bool(row.symbol)),
        ]
        for row in QUANTITIES.values()
    }
    for said in keys.all["says"]:
        owner, _, key = said.rpartition(".")
        where = f"in {owner or '--json'}: " if owner or key in QUANTITIES else ""
        text = _said(where + keys.says(owner, key), keys.unit(owner, key))
        lines.setdefault(key, []).append(text)
    yield from lines.items()


def _said(words: str, unit: str | None) -> str:
    unit = "none, a ratio" if unit == "1" else unit
    return words[0].upper() + words[1:] + (f"; unit: {unit}." if unit else ".")


def _object(name: str, schema: Schema, keys: _Keys) -> Schema:
    """Return one type's schema, with the words of each of its keys."""
    return {
        "description": " ".join(schema.get("description", "").replace("``", "").split()),
        "type": "object",
        "additionalProperties": False,
        "required": schema["required"],
        "properties": {k: keys.key(name, k, each) for k, each in schema["properties"].items()},
    }


def _is_number(schema: Schema) -> bool:
    if "additionalProperties" in schema:
        return _is_number(schema["additionalProperties"])
    return schema.get("type") in ("number", "integer") or schema.get("$ref", "").endswith(
        ("Value", "Told")
    )


def _physics() -> Schema:
    value = {"$ref": "#/$defs/Value"}
    rows = (*YAW_CHANNEL.values(), QUANTITIES[REDUCTION_ERROR])
    says = {row.name: ", ".join(filter(None, (row.words, row.unit_for()))) for row in rows}
    return _closed({name: {"description": each} | value for name, each in says.items()})


def _closed(properties: Schema, which: str = "properties") -> Schema:
    return {"type": "object", "additionalProperties": False, which: properties}


def of_command(schema: Schema, command: str) -> Schema:
    """Return the schema of the output of one command, with the definitions that it needs."""
    needed: set[str] = set()
    _collect(schema["$defs"], command, needed)
    defs = {name: each for name, each in schema["$defs"].items() if name in needed - {command}}
    kept = {name: each for name, each in schema.items() if name not in ("anyOf", "$defs")}
    return {
        **kept,
        "title": f"yawid {command} {'-o MODEL.json' if command == 'export' else '--json'}",
        "description": f"{schema['$defs'][command]['description']}. {schema['description']}",
        **{k: v for k, v in schema["$defs"][command].items() if k != "description"},
        "$defs": defs,
    }


def _collect(defs: Schema, name: str, needed: set[str]) -> None:
    """Add the names of a definition and of all definitions it refers to."""
    if name not in needed:
        needed.add(name)
        for other in re.findall(r'"#/\$defs/(.+?)"', json.dumps(defs[name])):
            _collect(defs, other, needed)
