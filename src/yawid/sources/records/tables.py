"""The columns of a CSV or Parquet file, read by pyarrow: numbers, texts and dates.

In a CSV each line has one cell for each name, numbers have one decimal sign and exponents with E,
and dates are ISO 8601. In a Parquet file units are metadata of its fields, ``unit`` or ``units``.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from pyarrow import csv

from yawid.blocks import Floats, Ints
from yawid.errors import SourceError
from yawid.sources.records.csv_header import (
    HEAD,
    MISSING,
    NUMBER,
    decoded,
    encoding_of,
    is_passed_over,
    lines_of,
    read_header,
)

PIECE: Final = 1 << 18
MAGIC: Final = b"PAR1"
_PER_S: Final = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_NULLS: Final = sorted(
    {spelt for each in MISSING for spelt in (each, each.upper(), each.title())} | {"NaN"}
)
_IN_UTC: Final = r"(Z|z|\+00:?00| UTC)$"
_DATE: Final = r"^\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d{1,9})?)?([+-]\d\d:?\d\d)?)?$"
_NAN: Final = np.float64(np.nan)
_IN_COLUMN: Final = re.compile(r"In CSV column #(\d+):")
_CELLS: Final = re.compile(r"columns, got (\d+): (.{0,60})")
_NO_TIME: Final = "is not a time: seconds, Unix time or ISO 8601 with a date is needed"
UNIX_S: Final = 1e9
"""The least number of seconds that counts as Unix time (2001): no boot lasts as long."""
LATEST_S: Final = 4.2e9
"""The greatest number of seconds that counts as Unix time (2103)."""
NO_DATE: Final = np.iinfo(np.int64).min
"""The Unix time in ns that stands for an unknown date."""
FIRST_YEAR, LAST_YEAR = 1970, 2199
_AFTER_LAST_YEAR_S: Final = int(datetime(LAST_YEAR + 1, 1, 1, tzinfo=UTC).timestamp())


class Table(ABC):
    """A file's columns by their places; ``facts`` holds the file's metadata.

    ``rows`` is the number of rows; before :meth:`load` it may be too large.
    """

    decimal = "."

    def __init__(
        self, path: Path, names: list[str], units: list[str], facts: dict[str, str], rows: int
    ) -> None:
        self.path, self.names, self.units, self.facts, self.rows = path, names, units, facts, rows
        self._columns: dict[int, Any] = {}

    @abstractmethod
    def load(self, columns: Iterable[int]) -> None:
        """Read columns, so that they can be returned; drop what was read before."""

    @abstractmethod
    def line(self, row: int) -> str:
        """Return the place of a row in words."""

    def words(self, column: int) -> tuple[list[str], Ints] | None:
        """Return the different texts of a column, and which of them each row (n,) has.

        A missing text is empty; None where the column has no texts.
        """
        values = self._text(column)
        if values is None:
            return None
        coded = values.fill_null("").dictionary_encode().combine_chunks()
        return coded.dictionary.to_pylist(), coded.indices.to_numpy().astype(np.int64)

    def numbers(self, column: int) -> Floats:
        """Return a column's numbers (n,), NaN where one is missing, durations in s.

        Raises:
            SourceError: it has no numbers, or a text among them.
        """
        text, values, scale = self._text(column), self._columns.pop(column), 1.0
        if isinstance(values, np.ndarray):
            return np.asarray(values, np.float64)
        values = values if text is None else self._parsed(column, text)
        if pa.types.is_duration(values.type):
            values, scale = values.cast(pa.duration("ns")).cast(pa.int64()), 1e9
        try:
            found: Floats = _plain(values.cast("float64"), _NAN)
        except (pa.ArrowException, ValueError, TypeError) as error:
            said = f"{self._place(column)}: {values.type} is not a number"
            raise SourceError(said) from error
        return found if scale == 1.0 else found / scale

    def dates_ns(self, column: int) -> Ints | None:
        """Return a column's dates in ns of Unix time (n,), ``NO_DATE`` where one is missing.

        A time without a zone is UTC. None where the column begins with numbers.

        Raises:
            SourceError: a text is no date, or a date is impossible for a flight.
        """
        values, text = None, self._text(column)
        if text is None:
            values = self._columns[column]
        elif not NUMBER.fullmatch(str(next((t for t in text if t.is_valid), "")).strip()):
            values = self._dated(column, text)
        if not (isinstance(values, pa.ChunkedArray) and pa.types.is_timestamp(values.type)):
            return None
        # A cast to ns would fail for the year 1500.
        found: Ints = _plain(values.cast(pa.int64()), np.int64(NO_DATE))
        scale = 10**9 // _PER_S[values.type.unit]
        wrong = (found != NO_DATE) & ((found < 0) | (found >= _AFTER_LAST_YEAR_S * 10**9 // scale))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise SourceError(
                f"{self._place(column, row)}: {values[row]} is not a time of a flight: a date from "
                f"{FIRST_YEAR} to {LAST_YEAR} is needed"
            )
        return np.where(found == NO_DATE, NO_DATE, found * scale)

    def _text(self, column: int) -> Any:
        """Read a column, and return its texts (n,), null where one is missing, None without any."""
        if column not in self._columns:
            self.load([column])
        values = self._columns[column]
        if isinstance(values, np.ndarray):
            return None
        kind = values.type.value_type if pa.types.is_dictionary(values.type) else values.type
        is_text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
        return values.cast(pa.string()) if is_text else None

    def _parsed(self, column: int, values: Any) -> Any:
        """Return the texts of a column as numbers."""
        sign = re.escape(self.decimal)
        number = rf"(?i)^\s*([-+]?(\d+({sign}\d*)?|{sign}\d+)(e[-+]?\d+)?|nan|[-+]?inf(inity)?)\s*$"
        self._check(column, values, number, (
            f"is not a number: the decimal sign is {self.decimal!r}, an exponent has an E, and a "
            "missing cell is empty"
        ))  # fmt: skip
        import pyarrow.compute as pc  # takes 10 MB, and most records are numbers

        plain = pc.replace_substring(pc.utf8_trim_whitespace(values), self.decimal, ".")
        return plain.cast(pa.float64())

    def _dated(self, column: int, values: Any) -> Any:
        """Return the texts of a column as timestamps."""
        import pyarrow.compute as pc

        plain = pc.replace_substring_regex(pc.utf8_trim_whitespace(values), _IN_UTC, "")
        self._check(column, plain, _DATE, _NO_TIME)
        has_zone = pc.any(pc.match_substring_regex(plain, r"[+-]\d\d:?\d\d$")).as_py()
        try:
            return plain.cast(pa.timestamp("ns", "UTC" if has_zone else None))
        except pa.ArrowInvalid as error:
            raise SourceError(
                f"{self._place(column)}: {str(error).partition(':')[2].strip()}; all its times "
                "need one spelling, such as 2024-05-01T12:00:00.5Z"
            ) from error

    def _check(self, column: int, values: Any, pattern: str, wrong: str) -> None:
        """Refuse the first text of a column that does not have this form."""
        import pyarrow.compute as pc

        row = pc.match_substring_regex(values, pattern).index(False).as_py()
        if row >= 0:
            raise SourceError(f"{self._place(column, row)}: {values[row].as_py()!r} {wrong}")

    def _place(self, column: int, row: int | None = None) -> str:
        line = "" if row is None else f"{self.line(row)}, "
        return f"{self.path}, {line}column {column + 1} ({self.names[column]})"


def _plain(values: Any, missing: np.generic) -> Any:
    """Return numbers of 8 bytes as an array (n,); pyarrow's own way there imports pandas."""
    parts = [np.empty(0, missing.dtype)]
    for chunk in values.chunks:
        known, numbers = chunk.buffers()
        own = np.frombuffer(numbers, missing.dtype, len(chunk), 8 * chunk.offset)
        if chunk.null_count:
            bits = np.unpackbits(np.frombuffer(known, np.uint8), bitorder="little")[chunk.offset :]
            own = np.where(bits[: len(own)], own, missing)
        parts.append(own)
    return np.concatenate(parts)


class ParquetTable(Table):
    """The columns of a Parquet file, each read when it is asked for.

    Raises:
        SourceError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        from pyarrow import parquet

        try:
            self._file = parquet.ParquetFile(path)
            schema = self._file.schema_arrow
        except (pa.ArrowException, OSError, ValueError) as error:
            raise SourceError(f"{path}: Parquet that cannot be read: {error}") from error
        fields = [_texts(field.metadata) for field in schema]
        units = [each.get("unit") or each.get("units") or "" for each in fields]
        rows = int(self._file.metadata.num_rows)
        super().__init__(path, list(schema.names), units, _texts(schema.metadata), rows)

    def load(self, columns: Iterable[int]) -> None:
        """Read one column; of several each is read when it is asked for."""
        self._columns = {}
        if len(places := list(columns)) == 1:
            try:
                read = self._file.read(columns=[self.names[places[0]]])
                self._columns = {places[0]: read.column(0)}
            except (pa.ArrowException, OSError, ValueError, IndexError) as error:
                raise SourceError(
                    f"{self._place(places[0])}: it cannot be read: {error}"
                ) from error

    def line(self, row: int) -> str:
        """Return the number of a row, from 1."""
        return f"row {row + 1}"


def _texts(metadata: Any) -> dict[str, str]:
    known = {k: v for k, v in (metadata or {}).items() if k != b"ARROW:schema"}
    return {k.decode("utf-8", "replace"): v.decode("utf-8", "replace") for k, v in known.items()}


class CsvTable(Table):
    """The columns of a CSV file; ``load`` reads in one pass all that will be asked for.

    Raises:
        SourceError: its header or one of its lines is not understood.
    """

    def __init__(self, path: Path) -> None:
        try:
            with path.open("rb") as file:
                head = file.read(HEAD)
            lines = lines_of(decoded(head))
        except OSError as error:
            raise SourceError(f"cannot read {path}: {error.strerror}") from error
        except UnicodeError as error:
            raise SourceError(f"{path}: it is not text in UTF-8 or UTF-16: {error}") from error
        self._header, self._encoding = read_header(path, lines), encoding_of(head)
        self.decimal = self._header.decimal
        rows = len(lines) * path.stat().st_size // len(head) + 1
        super().__init__(path, self._header.names, self._header.units, {}, rows)

    def load(self, columns: Iterable[int]) -> None:
        """Read columns as numbers, or as texts where one of their first cells is a text.

        Raises:
            SourceError: a line has not as many cells as the header.
        """
        places, texts = sorted(set(columns)), {*self._header.texts}
        self._columns = {}
        while len(self._columns) < len(places):
            try:
                self._columns = self._read(places, texts)
            except UnicodeDecodeError as error:
                if self._encoding != "utf-8":
                    raise SourceError(f"{self.path}: it is not text in UTF-16: {error}") from error
                self._encoding = "cp1252"  # a degree sign, as Excel writes it
            except (pa.ArrowException, OSError) as error:
                later = _IN_COLUMN.match(str(error))  # its first cells are numbers, this one not
                if later is None:
                    raise SourceError(f"{self.path}: {self._refusal(str(error))}") from error
                texts.add(int(later[1]))

    def _read(self, places: list[int], texts: Collection[int]) -> dict[int, Any]:
        names = [str(place) for place in range(len(self.names))]
        types = {names[i]: pa.string() if i in texts else pa.float64() for i in places}
        options = (
            csv.ReadOptions(use_threads=False, block_size=4 * HEAD, column_names=names),
            csv.ParseOptions(
                delimiter=self._header.separator,
                invalid_row_handler=lambda row: "skip" if is_passed_over(row.text) else "error",
            ),
            csv.ConvertOptions(
                column_types=types, include_columns=list(types), decimal_point=self.decimal,
                null_values=_NULLS, strings_can_be_null=True,
            ),
            pa.system_memory_pool(),  # which gives back what is freed
        )  # fmt: skip
        found: dict[int, list[Any]] = {place: [] for place in places}
        for piece in self._pieces():
            table = csv.read_csv(pa.BufferReader(piece), *options)
            for place, values in zip(places, table.columns, strict=True):
                found[place] += values.chunks if place in texts else [_plain(values, _NAN)]
        joined = {i: pa.chunked_array(found[i], pa.string()) for i in places if i in texts}
        for i in (each for each in places if each not in texts):
            joined[i] = np.concatenate(found.pop(i))  # its pieces are freed before the next one's
        self.rows = len(joined[places[0]])
        return joined

    def _pieces(self) -> Iterator[bytes]:
        """Yield the lines with data in UTF-8, in pieces: pyarrow would read far ahead."""
        with self.path.open(encoding=self._encoding) as file:
            for _ in range(self._header.first):
                file.readline()
            rest = ""
            while text := file.read(PIECE):
                lines, end, rest = (rest + text).rpartition("\n")
                if len(rest) > HEAD:
                    raise SourceError(
                        f"{self.path}: it has a line of more than {HEAD} characters, so it is not "
                        "a CSV"
                    )
                if lines.strip():
                    yield (lines + end).encode()
            if rest.strip():
                yield rest.encode()

    def _refusal(self, error: str) -> str:
        found = _CELLS.search(error)
        if found is None:
            return f"it is not a table of texts: {error.splitlines()[0]}"
        at = next((at for at, line in self._data() if line.startswith(found[2])), 0)
        return (
            f"read as CSV, line {at + 1}: {found[1]} cells, the header has {len(self.names)}: a "
            f"line was cut off, or the separator {self._header.separator!r} is part of a number; "
            "one separator, such as a comma, is needed between two cells"
        )

    def _data(self) -> Iterator[tuple[int, str]]:
        """Yield number and text of each line with data."""
        with self.path.open(encoding=self._encoding) as file:
            for at, line in islice(enumerate(file), self._header.first, None):
                if not is_passed_over(line):
                    yield at, line

    def line(self, row: int) -> str:
        """Return in words the line of a row of the data."""
        at, _ = next(islice(self._data(), row, None))
        return f"line {at + 1}"


def is_unix(t_s: Floats) -> bool:
    """Return whether times in s (n,), of which at least one is known, count from 1970."""
    known = t_s[np.isfinite(t_s)]
    return bool(known.min() >= UNIX_S and known.max() < LATEST_S)


def offsets_us(t_us: Ints, unix_ns: Ints) -> Ints:
    """Return Unix minus boot time in us (n,) from known dates (n,), each held to the next one.

    It is 0 if all dates are unknown.
    """
    known = unix_ns != NO_DATE
    if not known.any():
        return np.zeros(len(t_us), np.int64)
    newest = np.maximum(np.cumsum(known) - 1, 0)
    return np.asarray((np.floor_divide(unix_ns[known] + 500, 1000) - t_us[known])[newest])
