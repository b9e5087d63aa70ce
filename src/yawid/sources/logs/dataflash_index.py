"""The index of a dataflash log: where its messages are, and their columns in SI units.

A dataflash message is A3 95, its type, and a payload whose length and columns an earlier FMT
message reported; there is no checksum. So a message is believed only if it ends at the next A3 95,
or at the end of the file: nothing in a damaged stretch counts as data, and reading goes on after
it.

The meaning of the format characters comes from pymavlink. Its own index of the messages is not
used: it prints a line for every byte of a damaged stretch, believes a message whatever follows it,
and gives up the whole log for one FMT that it cannot read. Measured on a log of 102 000 messages:
0.04 s for this index, 1.4 s for pymavlink to return the messages one by one.
"""

import mmap
import struct
from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import Array, Floats, Ints
from yawid.errors import SourceError
from yawid.sources.logs.as_mavlink import PlacedFields, quiet, steady

MAGIC = b"\xa3\x95"
_HEADER = 3
_FMT = 0x80
_FMT_STRUCT = struct.Struct("<BB4s16s64s")
_TABLES = ("UNIT", "MULT", "FMTU")
_TEXT = frozenset({"Name", "Message", "Label", "UnitIds", "MultIds"})
_DEGREES = ("deg", "deg/s", "degheading")
_IN_DEGREES = ("ATT", "RATE")  # in logs without FMTU, which reports the units in newer ones


@dataclass(frozen=True, slots=True)
class Format:
    """One FMT message: the name, the columns, and the factors that their characters imply."""

    name: str
    dtype: np.dtype[Any]
    implied: dict[str, float]


class DataflashIndex:
    """The index of the messages of a log by name.

    ``offsets`` holds, by name, the bytes at which the ``wanted`` messages start; ``messages``
    counts the messages believed, of all names, and ``message_bytes`` their bytes.

    Raises:
        SourceError: the file cannot be read, or holds no message.
    """

    def __init__(self, path: Path, wanted: Iterable[str]) -> None:
        self.data = _mapped(path)
        self.messages = self.message_bytes = 0
        self._wanted = frozenset(wanted) | frozenset(_TABLES)
        self._types: dict[int, Format] = {}
        self._formats: dict[str, Format] = {}
        self._buffer = np.frombuffer(self.data, np.uint8)
        self.offsets = self._walk()
        if not self._formats:
            raise SourceError(
                f"{path} begins as a dataflash log but holds no readable message: copy it again"
            )
        self._factors = self._reported_factors()

    def _walk(self) -> dict[str, Ints]:
        """Step from message to message; return where the wanted ones start."""
        data, size = self.data, len(self.data)
        lengths, places = [0] * 256, [array("q") for _ in range(256)]
        lengths[_FMT] = _HEADER + _FMT_STRUCT.size
        keep = [False] * 256
        at = data.find(MAGIC)
        while 0 <= at < size - _HEADER:
            kind = data[at + 2]
            end = at + lengths[kind]
            if end == at or end > size or (data[end : end + 2] != MAGIC and end < size):
                at = data.find(MAGIC, at + 1)
                continue
            if kind == _FMT:
                self._define(data[at + _HEADER : end], lengths, keep)
            elif keep[kind]:
                places[kind].append(at)
            self.messages += 1
            self.message_bytes += end - at
            at = end
        found: dict[str, Ints] = {}
        for kind, reported in self._types.items():
            if reported.name in self._wanted:
                found.setdefault(reported.name, np.array(places[kind], np.int64))
        return found

    def _define(self, body: bytes, lengths: list[int], keep: list[bool]) -> None:
        """Take an FMT in; of each type the first sound one counts."""
        kind, length, name, characters, columns = _FMT_STRUCT.unpack(body)
        if kind == _FMT or kind in self._types:
            return
        found = _format(*(_text(part) for part in (name, characters, columns)))
        if found is not None and found.dtype.itemsize + _HEADER == length:
            self._types[kind] = found
            self._formats.setdefault(found.name, found)
            lengths[kind] = length
            keep[kind] = found.name in self._wanted

    def has(self, name: str, *columns: str) -> bool:
        """Return whether there are messages of this name with these columns.

        A column with text instead of numbers, or the other way round, does not count: an FMT may be
        damaged.
        """
        if len(self.offsets.get(name, ())) == 0:
            return False
        dtype = self._formats[name].dtype
        return all(
            column in (dtype.names or ()) and (dtype[column].kind == "S") == (column in _TEXT)
            for column in columns
        )

    def reported(self, name: str) -> PlacedFields:
        """Return where all messages of a name start (n,), n >= 1, and their payloads (n,)."""
        return self.offsets[name], self.rows(name, self.offsets[name])

    def found(self, name: str, *columns: str) -> PlacedFields:
        """Return :meth:`reported` where there are these columns, else no rows of them."""
        if self.has(name, *columns):
            return self.reported(name)
        kinds = [(column, "S1" if column in _TEXT else "f8") for column in columns]
        return np.zeros(0, np.int64), np.zeros(0, kinds)

    def rows(self, name: str, offsets: Ints) -> Array:
        """Return the payloads (n,) of the messages that start at ``offsets`` (n,)."""
        dtype = self._formats[name].dtype
        size = dtype.itemsize
        starts = max(len(self._buffer) - size + 1, 0)
        row_at = np.ndarray((starts,), f"V{size}", self._buffer, 0, (1,))
        return row_at[offsets + _HEADER].view(dtype)

    def si(self, name: str, rows: Array, column: str) -> Floats:
        """Return a column (n,) in SI units, angles in rad."""
        with quiet():
            return np.asarray(rows[column], float) * self._factors.get(name, {}).get(column, 1.0)

    def times(self, name: str, offsets: Ints) -> Ints:
        """Return when the messages (n,) were logged, in microseconds since boot."""
        rows = self.rows(name, offsets)
        if "TimeUS" in (rows.dtype.names or ()):
            return rows["TimeUS"].astype(np.int64)
        return rows["TimeMS"].astype(np.int64) * 1000

    def keep_timed(self, names: Iterable[str]) -> None:
        """Remove from the index the messages of these names whose time is damaged or missing."""
        for name in names:
            if self.has(name, "TimeUS") or self.has(name, "TimeMS"):
                offsets = self.offsets[name]
                self.offsets[name] = offsets[steady(self.times(name, offsets))]
            else:
                self.offsets.pop(name, None)

    def _reported_factors(self) -> dict[str, dict[str, float]]:
        """Return every column's factor to SI, from MULT and UNIT where FMTU names them.

        A multiplier applies to the raw number: it includes the factor of the format character.
        """
        units = self._table("UNIT", "Label")
        multipliers = self._table("MULT", "Mult")
        factors = {name: dict(f.implied) for name, f in self._formats.items()}
        for name in set(_IN_DEGREES) & factors.keys():
            factors[name] = {c: np.deg2rad(v) for c, v in factors[name].items()}
        if not self.has("FMTU", "FmtType", "UnitIds", "MultIds"):
            return factors
        for row in self.reported("FMTU")[1]:
            reported = self._types.get(int(row["FmtType"]))
            if reported is None:
                continue
            for column, unit, multiplier in zip(
                reported.implied, _text(row["UnitIds"]), _text(row["MultIds"]), strict=False
            ):
                scale = float(multipliers.get(multiplier, 0.0)) or reported.implied[column]
                in_degrees = _text(units.get(unit, b"")) in _DEGREES
                factors[reported.name][column] = np.deg2rad(scale) if in_degrees else scale
        return factors

    def _table(self, name: str, column: str) -> dict[str, Any]:
        """Return UNIT or MULT as values by their ids, one character each."""
        _, rows = self.found(name, "Id", column)
        return {chr(int(i) & 0x7F): v for i, v in zip(rows["Id"], rows[column], strict=True)}


def _mapped(path: Path) -> mmap.mmap:
    try:
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except (OSError, ValueError) as error:
        raise SourceError(f"{path} cannot be read ({error}): copy the log and try again") from error


def _format(name: str, characters: str, columns: str) -> Format | None:
    """Return the contents of an FMT, None where it is damaged."""
    names = columns.split(",")
    known = _characters()
    if not name or len(names) != len(characters) or len(set(names)) != len(names):
        return None
    if not all(names) or not known.keys() >= set(characters):
        return None
    dtype = np.dtype([(n, known[c][0]) for n, c in zip(names, characters, strict=True)])
    return Format(name, dtype, {n: known[c][1] for n, c in zip(names, characters, strict=True)})


@cache
def _characters() -> dict[str, tuple[str, float]]:
    """Return the meaning of each format character: NumPy's type, and the factor it implies."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT  # this takes 0.1 s, only for such a log

    return {
        character: (f"S{code[:-1]}" if code.endswith("s") else f"<{code}", multiplier or 1.0)
        for character, (code, multiplier, _) in FORMAT_TO_STRUCT.items()
    }


def _text(raw: bytes) -> str:
    return raw.split(b"\0", 1)[0].decode("ascii", "replace")
