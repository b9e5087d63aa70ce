"""A Parquet file as a table; the units are in its fields' metadata, as ``unit`` or ``units``.

pyarrow is loaded only when such a file is read, because that takes a fifth of a second.
"""

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.errors import SourceError
from yawid.sources.records.times import FIRST_YEAR, LAST_YEAR, NO_DATE

MAGIC: Final = b"PAR1"
PER_S: Final = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
AFTER_LAST_YEAR_S: Final = int(datetime(LAST_YEAR + 1, 1, 1, tzinfo=UTC).timestamp())


class ParquetTable:
    """The columns of a Parquet file; ``facts`` holds the file's metadata as texts.

    Raises:
        SourceError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        self.path, self._arrow = path, pa
        try:
            self._file = pq.ParquetFile(path)
            schema = self._file.schema_arrow
        except (pa.ArrowException, OSError, ValueError) as error:
            raise SourceError(f"{path}: Parquet that cannot be read: {error}") from error
        self.names = list(schema.names)
        self.units = [_unit(schema.field(i).metadata or {}) for i in range(len(self.names))]
        said = {k: v for k, v in (schema.metadata or {}).items() if k != b"ARROW:schema"}
        self.facts = {k.decode("utf-8", "replace"): v.decode("utf-8", "replace")
                      for k, v in said.items()}  # fmt: skip
        self.rows = int(self._file.metadata.num_rows)

    def load(self, columns: Iterable[int]) -> None:
        """Do nothing: a column is read when it is asked for."""

    def texts(self, column: int) -> list[str] | None:
        """Return a column's texts, missing ones empty; None where it has no texts."""
        values = self._read(column)
        kind = values.type
        if self._arrow.types.is_dictionary(kind):
            values = values.cast(kind.value_type)
            kind = kind.value_type
        if not (self._arrow.types.is_string(kind) or self._arrow.types.is_large_string(kind)):
            return None
        return [each or "" for each in values.to_pylist()]

    def numbers(self, column: int) -> Floats:
        """Return the numbers of a column (n,), NaN where it is null, durations in s.

        Raises:
            SourceError: it has no numbers.
        """
        values, types = self._read(column), self._arrow.types
        try:
            if types.is_duration(values.type):
                whole = values.cast(self._arrow.duration("ns")).cast(self._arrow.int64())
                return _with_nan(whole) / 1e9
            return _with_nan(values)
        except (self._arrow.ArrowException, ValueError, TypeError) as error:
            raise SourceError(
                f"{self.path}, column {self.names[column]}: {values.type} is not a number"
            ) from error

    def dates_ns(self, column: int) -> Ints | None:
        """Return the Unix time in ns (n,), ``NO_DATE`` where it is null; None for other types.

        Raises:
            SourceError: a date is impossible for a flight.
        """
        values = self._read(column)
        if not self._arrow.types.is_timestamp(values.type):
            return None
        # A cast to ns would fail for the year 1500.
        whole = values.cast(self._arrow.int64()).fill_null(int(NO_DATE))
        found: Ints = whole.to_numpy(zero_copy_only=False)
        scale = 10**9 // PER_S[values.type.unit]
        wrong = (found != NO_DATE) & ((found < 0) | (found >= AFTER_LAST_YEAR_S * 10**9 // scale))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise SourceError(
                f"{self.path}, column {self.names[column]}, {self.line(row)}: {values[row]} is not "
                f"a time of a flight: a date from {FIRST_YEAR} to {LAST_YEAR} is needed"
            )
        return np.where(found == NO_DATE, NO_DATE, found * scale)

    def line(self, row: int) -> str:
        """Return the number of a row, from 1."""
        return f"row {row + 1}"

    def _read(self, column: int) -> Any:
        try:
            read = self._file.read(columns=[self.names[column]])
            return read.column(0).combine_chunks()
        except (self._arrow.ArrowException, OSError, ValueError, IndexError) as error:
            raise SourceError(
                f"{self.path}, column {self.names[column]}: it cannot be read: {error}"
            ) from error


def _with_nan(values: Any) -> Floats:
    return np.asarray(values.cast("float64").to_numpy(zero_copy_only=False), np.float64)


def _unit(metadata: dict[bytes, bytes]) -> str:
    found = metadata.get(b"unit") or metadata.get(b"units") or b""
    return found.decode("utf-8", "replace")
