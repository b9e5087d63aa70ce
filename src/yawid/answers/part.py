"""The base of every object of an answer, a struct that is an object in JSON, and its numbers."""

from operator import methodcaller
from typing import Annotated, Any, Final

import msgspec
from msgspec import Meta, Struct

from yawid.quantities.table import quantity

LARGEST: Final = 1e300
"""The largest number in a summary: an estimate that diverged is still shown, infinity is not."""
Number = Annotated[float, Meta(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Meta(gt=0.0, le=LARGEST)]
Count = Annotated[int, Meta(ge=0, le=2**63 - 1)]


def says(words: str = "", unit: str | None = None, **more: Any) -> Meta:
    """Return what a field means, its unit, and ``more`` of JSON Schema, as ``yawid schema`` has it.

    Without words or unit they are those of the quantity of the field's name.
    """
    return Meta(
        description=words or None, extra_json_schema=({"x-unit": unit} if unit else {}) | more
    )


def named(*quantities: str, **words: str) -> dict[str, Any]:
    """Return, for :func:`says`, which keys a dict may have, with words or those of a quantity."""
    rows = (quantity(name) for name in quantities)
    words |= {row.name: ", ".join(filter(None, (row.words, row.unit_for()))) for row in rows}
    return {"propertyNames": {"enum": [*words]}, "x-names": words}


class Part(Struct, frozen=True, omit_defaults=True):
    """A part of a summary: an object in JSON."""

    def to_json(self) -> dict[str, Any]:
        """Return it for ``json.dumps``, as dicts, lists, texts and numbers."""
        # NumPy's scalars become numbers.
        found: dict[str, Any] = msgspec.to_builtins(self, enc_hook=methodcaller("item"))
        return found
