"""The JSON Schema of everything that ``--json`` prints, made from the types that are printed.

The words and the unit of a key stand on its field (:func:`yawid.answers.part.says`); where they do
not, they are those of the quantity of its name.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, Final

import msgspec

from yawid.answers.damper_report import DamperReport
from yawid.answers.identified_model import ModelFile
from yawid.answers.inspection import Inspection
from yawid.answers.ordinary import GATES, ORDINARY
from yawid.answers.reasons import KINDS
from yawid.answers.reports import OrdersReport, StepReport
from yawid.answers.run_summary import CT, RunSummary
from yawid.damper.refusals import OF_DAMPER
from yawid.errors import EXIT_CODES
from yawid.estimation.methods import METHODS
from yawid.quantities.airspeed import Kind
from yawid.quantities.table import QUANTITIES, RUDDER, quantity
from yawid.trend import SEVERAL

Schema = dict[str, Any]
ALL: Final = (
    "What yawid prints on stdout with --json. A key that does not apply is absent; no number is NaN"
    " or infinite. Units are SI and stand in x-unit (1: a ratio); a key *_std is one sigma, the"
    " total of noise, structure and, of a flight, the scatter of manoeuvres, *_std_noise the part"
    " of it that noise explains. Times since boot are the vehicle's own."
)
_A_LINE: Final = "with exit code 2 or 6 there is none, but a line on stderr"
_CHANGED: Final = "one object; exit code 7 where anything changed"
_FLEET: Final = (
    "a row of a data set's tables, as duckdb or pandas turn it into JSON: there what does not apply"
    " is null; yawid fleet itself prints no JSON"
)
_PRINTED: Final = {
    "replay": (RunSummary, f"one object per log on a line; {_A_LINE}"),
    "live": (RunSummary, "one object per vehicle on a line, when the session ends"),
    "inspect": (Inspection, f"one object; {_A_LINE}"),
    "orders": (OrdersReport, "one object; where nothing can be compared a line on stderr"),
    "step": (StepReport, "one object; with exit code 2, 5 or 6 a line on stderr"),
    "damper": (
        DamperReport,
        "one object, also with exit code 5 and where something must be given (exit code 2)",
    ),
    "export": (
        ModelFile,
        "the file that --what model writes with a name in .json; the command itself prints the "
        "file's path",
    ),
}
"""The type that each command prints, and when; those of trend and diff take long to import."""
_LATER: Final[dict[str, Schema]] = {
    "id": {"enum": [*dict.fromkeys([*KINDS, *OF_DAMPER, SEVERAL, *GATES])]},
    "method": {"enum": [*METHODS, CT, ORDINARY]},
    "airspeed_kind": {"enum": [kind.name.lower() for kind in Kind]},
    "estimates": {"propertyNames": {"enum": [*METHODS, CT]}},
}
"""What keys may hold by tables that the types themselves do not know."""


def document(only: str | None = None) -> Schema:
    """Return the whole schema, or that of the output of one command, with the types it needs.

    Raises:
        KeyError: a key has no words.
    """
    from yawid.dataset.schema import json_schema
    from yawid.trend.diff import Diff
    from yawid.trend.trend import Trend

    printed = {**_PRINTED, "trend": (Trend, _CHANGED), "diff": (Diff, _CHANGED)}
    asked = [each for each in (*printed, "fleet") if only in (None, each)]
    defs = _objects([printed[each][0] for each in asked if each in printed])
    commands: Schema = {
        name: {"description": says, "$ref": f"#/$defs/{kind.__name__}"}
        for name, (kind, says) in printed.items()
        if name in asked
    }
    if "fleet" in asked:
        tables = {f"{name}_row": table for name, table in json_schema()["$defs"].items()}
        rows = [{"$ref": f"#/$defs/{name}"} for name in tables]
        commands["fleet"] = {"description": _FLEET, "anyOf": rows}
        defs |= tables
    said = {"title": "yawid --json", "description": ALL}
    shown: Schema = {"anyOf": [{"$ref": f"#/$defs/{name}"} for name in commands]}
    if only is not None:
        shown, commands = commands[only], {}
        how = "-o MODEL.json" if only == "export" else "--json"
        shown |= {"title": f"yawid {only} {how}", "description": f"{shown['description']}. {ALL}"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **said,
        "x-exit-codes": {str(code): each for code, each in EXIT_CODES.items()},
        "x-reasons": {
            kind.id: {"weight": kind.weight, "exit_code": kind.exit_code, "what_to_do": kind.now}
            for kind in KINDS.values()
        },
        **shown,
        "$defs": commands | defs,
    }


def key_words() -> Iterator[tuple[str, list[str]]]:
    """Yield each quantity and each key of ``--json``, and in lines what it says in which type."""
    lines = {
        row.name: [
            _said(row.words, row.unit_for()),
            *([f"Symbol: {row.symbol}."] * bool(row.symbol)),
        ]
        for row in QUANTITIES.values()
    }
    kinds: list[Any] = [kind for kind, _ in _PRINTED.values()]
    with suppress(ModuleNotFoundError):  # what reads a data set needs pyarrow
        from yawid.trend.diff import Diff
        from yawid.trend.trend import Trend

        kinds += [Trend, Diff]
    owners = defaultdict[tuple[str, str], list[str]](list)
    for name, each in _objects(kinds).items():
        for key, schema in each.get("properties", {}).items():
            if schema["description"] != getattr(QUANTITIES.get(key), "words", None):
                said = _said(schema["description"], schema.get("x-unit"))
                owners[key, said].append(name)
    for (key, said), names in owners.items():
        lines.setdefault(key, []).append(f"In {', '.join(names)}: {said[0].lower()}{said[1:]}")
    yield from lines.items()


def _said(words: str, unit: str | None) -> str:
    unit = "none, a ratio" if unit == "1" else unit
    return words[0].upper() + words[1:] + (f"; unit: {unit}." if unit else ".")


def _objects(kinds: Sequence[Any]) -> dict[str, Schema]:
    """Return the schemas of types and of those they hold, by name."""
    _, defs = msgspec.json.schema_components(kinds)
    return {name: _object(schema) for name, schema in defs.items()}


def _object(schema: Schema) -> Schema:
    """Return one type's schema, with the words of each of its keys."""
    return {
        "description": " ".join(schema.get("description", "").replace("``", "").split()),
        "type": "object",
        "additionalProperties": False,
        "required": schema["required"],
        "properties": {key: _key(key, each) for key, each in schema["properties"].items()},
    }


def _key(key: str, schema: Schema) -> Schema:
    """Return the schema of one key, without null where the key is left out instead."""
    if schema.pop("default", ...) is None:
        kinds = [kind for kind in schema.pop("anyOf") if kind != {"type": "null"}]
        schema |= kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    if "description" not in schema:
        row = quantity(key)
        unit = row.unit.replace(RUDDER, "unit of rudder")
        schema = {"description": row.words} | ({"x-unit": unit} if unit else {}) | schema
    return schema | _LATER.get(key, {})
