"""Answers as JSON with its schema: a row for a manoeuvre or a flight, others as in ``--json``.

The schemas have only what all viewers understand: no references, no null, no list of lists.
"""

from typing import Any, Final

from msgspec.json import encode, schema_components

from yawid.answers.model_parts import flat, flat_answer
from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.part import Part
from yawid.answers.run_summary import Bare, Flight, Manoeuvre
from yawid.sinks.mcap.schemas import described

Shape = dict[str, Any]
ROW: Final = (
    "n", "from_s", "to_s", "duration_s", "date", "mode", "loop", "airspeed_m_s", "airspeed_std_m_s",
    "airspeed_source", "altitude_m", "inputs", "turn_removed", "method", "wn_rad_s", "wn_std",
    "zeta", "zeta_std", "K", "K_std", "yaw_acceleration", "yaw_acceleration_std", "simulation_pct",
    "usable", "reasons", "wn_std_noise", "zeta_std_noise", "airspeed_kind", "structure",
)  # fmt: skip
"""The names of a row, of which those that are not known are left out."""
NAMES: Final = {
    "/yawid/manoeuvre": "yawid.Manoeuvre", "/yawid/flight": "yawid.Flight",
    "/yawid/lateral": "yawid.Lateral", "/yawid/ordinary": "yawid.Ordinary",
}  # fmt: skip
"""The names of the schemas, by topic."""
MANOEUVRE, FLIGHT, LATERAL, ORDINARY = NAMES
WHOLE: Final[dict[str, type[Part]]] = {LATERAL: Bare, ORDINARY: OrdinaryAnswer}
"""The answers that are written as they are, and not as a row."""


def row_of(found: Manoeuvre | Flight) -> Shape:
    """Return an answer as one row: how it was flown, its numbers, its verdict."""
    # The answer of a manoeuvre is one of its methods', a flight is its own.
    known = flat(found) | flat_answer(getattr(found, "answer", found)) | found.verdict.to_json()
    return {name: known[name] for name in ROW if known.get(name) is not None}


def row_shapes() -> dict[str, Shape]:
    """Return the schema of each number or text of a row."""
    _, parts = schema_components([Manoeuvre])
    known = {
        name: _plain(shape, parts)
        for part in parts.values()
        for name, shape in part["properties"].items()
    }
    number = {"type": "number"}
    shapes = {name: known.get(name, number) for name in ROW}
    return {name: number if each["type"] == "object" else each for name, each in shapes.items()}


def schema_of(topic: str) -> bytes:
    """Return the JSON schema of the answers of a topic."""
    if topic not in WHOLE:
        texts = {name: {"description": described(name)} for name in ROW}
        shapes = {name: each | texts[name] for name, each in row_shapes().items()}
        return encode({"type": "object", "properties": shapes})
    [shape], parts = schema_components([WHOLE[topic]])
    return encode(_plain(shape, parts))


def _plain(shape: Shape, parts: dict[str, Shape]) -> Shape:
    """Return a schema without references and null, whose objects have no lists of lists."""
    if "anyOf" in shape:
        return _plain(shape["anyOf"][0], parts)
    if "$ref" in shape:
        return _plain(parts[shape["$ref"].rpartition("/")[2]], parts)
    if shape["type"] == "array":
        return {"type": "array", "items": _plain(shape["items"], parts)}
    if shape["type"] != "object":
        return {"type": shape["type"]}
    own = {name: _plain(each, parts) for name, each in shape.get("properties", {}).items()}
    own = {name: x for name, x in own.items() if x.get("items", {}).get("type") != "array"}
    return {"type": "object", "properties": own}
