"""A CSV file as a table of texts; its separator, header, units and decimal sign are detected.

It is recognised by its first lines: names with a separator between them, then as many numbers.
Also understood are comments (``#``, ``%``, ``//``), a title line, a second line of the header with
units, any line end, a byte order mark, quotes, and a decimal comma with another separator.
"""

import codecs
import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Final

from yawid.blocks import Floats, Ints
from yawid.errors import SourceError
from yawid.quantities.units import unit_of
from yawid.sources.records.csv_column import MISSING, NUMBER, CsvColumn, NotUnderstoodError
from yawid.sources.records.headers import NOTHING, header_of, is_column

COMMENTS: Final = ("#", "%", "//")
MOST_HEADER_LINES: Final = 200
PIECE: Final = 8192
"""The rows that are kept as texts at a time: a text takes eight times the memory of its number."""
BYTES, MOST_LINE = 1 << 20, 1 << 22
_BOMS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_EXCEL: Final = re.compile(r"sep=(.)\s*")
_DATE: Final = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:.*")
Row = Sequence[str]


def looks_like_csv(head: bytes) -> bool:
    """Return whether a file with these first bytes is a table of texts: names, then numbers."""
    try:
        text = _decoded(head, partial=True)
    except UnicodeError:
        return False
    if any(ord(c) < 32 and c not in "\t\r\n\f" for c in text):
        return False
    lines = _lines_of(text)
    lines = lines[:-1] if len(lines) > 2 else lines  # the last one may be cut
    used = [line for line in lines if line.strip() and not _is_comment(line)]
    separator = _separator(used)
    try:
        rows = [_split(line, separator) for line in used]
    except csv.Error:
        return False
    found = _layout(rows)
    if found is None or len(rows[found[0]]) < 2:
        return False
    names, first = found
    return first > names or len(used) < len(lines)


class CsvTable:
    """The columns of a CSV file, read in pieces; ``load`` reads those that will be asked for.

    ``names`` and ``units`` are those of its header, units '' where there are none. ``facts`` is
    empty, because a CSV has no metadata. ``rows`` counts its lines, and once loaded its rows.

    Raises:
        SourceError: its header or one of its lines is not understood.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.facts = path, dict[str, str]()
        with self._understood():
            self._encoding, self.rows = _surveyed(path)
            self._read_header()
        self._columns: dict[int, CsvColumn] = {}

    def _lines(self) -> Iterator[tuple[int, str]]:
        with self.path.open(encoding=self._encoding) as file:
            for i, line in enumerate(file):
                said = _EXCEL.fullmatch(line) if i == 0 else None
                yield i, f"# the separator is {said.group(1)}" if said else line.rstrip("\n")

    def _used(self) -> Iterator[tuple[int, str]]:
        return ((i, line) for i, line in self._lines() if line.strip() and not _is_comment(line))

    def _read_header(self) -> None:
        """Find names and units, and which line (of those used) is the first with data."""
        used = list(islice(self._used(), MOST_HEADER_LINES))
        self._separator = _separator([line for _, line in used])
        rows = [_split(line, self._separator) for _, line in used]
        found = _layout(rows)
        if found is None or found[1] >= len(rows):
            raise SourceError(
                f"{self.path}: it has no line of numbers below a line with the names of columns"
            )
        names, self._first = found
        heads, line = rows[names : self._first], used[self._first][0]
        if not heads:
            # numpy.savetxt and others write the header as a comment.
            comments = (text for _, text in islice(self._lines(), line) if _is_comment(text))
            split = (_split(text.lstrip("#%/ "), self._separator) for text in comments)
            width = len(_trimmed(rows[self._first]))
            heads = [row for row in split if len(_trimmed(row)) == width][-2:]
        if not 1 <= len(heads) <= 2:
            raise SourceError(
                f"{self.path}, line {line + 1}: numbers below {len(heads)} lines of a "
                "header: one is needed with the names of the columns (t, rudder, r), and perhaps "
                "one with their units"
            )
        self.names = [cell.strip() for cell in _trimmed(heads[0])]
        below = [cell.strip() for cell in heads[1]] if len(heads) > 1 else []
        self.units = [*below, *[""] * len(self.names)][: len(self.names)]

    def load(self, columns: Iterable[int]) -> None:
        """Read columns by their places as numbers, dates or texts; drop what was read before.

        Raises:
            SourceError: a line has not as many cells as the header, or a column is not understood.
        """
        places = sorted(set(columns))
        self._columns = {place: CsvColumn(self._separator) for place in places}
        if not places:
            return
        self.rows = 0
        with self._understood():
            for rows in self._pieces():
                for place in places:
                    try:
                        self._columns[place].add([row[place] for row in rows])
                    except NotUnderstoodError as error:
                        where = self._place(place, error.row)
                        also = "" if error.other is None else f" in {self.line(error.other)}"
                        raise SourceError(f"{where}: {str(error).format(also)}") from error
                self.rows += len(rows)

    def _pieces(self) -> Iterator[list[Row]]:
        """Yield the cells of all lines with data in pieces; each line has a cell for each name."""
        width, rows = len(self.names), list[Row]()
        at = [0]
        for cells in _reader(self._data(at), self._separator):
            row = cells if len(cells) <= width else _trimmed(cells, width)
            if len(row) != width:
                raise SourceError(
                    f"{self.path}, read as CSV, line {at[0] + 1}: {len(row)} cells, the "
                    f"header has {width}: a line was cut off, or the separator "
                    f"{self._separator!r} is part of a number"
                )
            rows.append(row)
            if len(rows) == PIECE:
                yield rows
                rows = []
        yield rows

    def _data(self, at: list[int]) -> Iterator[str]:
        """Yield the lines with data, and write the number of the newest into ``at``."""
        for at[0], line in islice(self._used(), self._first, None):
            yield line

    def texts(self, column: int) -> list[str] | None:
        """Return a column's texts, missing ones empty; None where all are numbers or dates."""
        return self._loaded(column).texts()

    def numbers(self, column: int) -> Floats:
        """Return the numbers of a column (n,), NaN where a cell is empty.

        Raises:
            SourceError: a cell is not a number; the error names it.
        """
        found = self._loaded(column)
        if found.wrong is not None:
            row, cell = found.wrong
            raise SourceError(f"{self._place(column, row)}: {cell!r} is not a number")
        del self._columns[column]  # the table need not keep them
        return found.numbers()

    def dates_ns(self, column: int) -> Ints | None:
        """Return the Unix time in ns (n,), ``NO_DATE`` where a cell is empty; None if not dates."""
        return self._loaded(column).dates_ns()

    def _loaded(self, column: int) -> CsvColumn:
        if column not in self._columns:
            self.load([*self._columns, column])
        return self._columns[column]

    def line(self, row: int) -> str:
        """Return in words the line of a row of the data."""
        at, _ = next(islice(self._used(), self._first + row, None))
        return f"line {at + 1}"

    def _place(self, column: int, row: int) -> str:
        return f"{self.path}, {self.line(row)}, column {column + 1} ({self.names[column]})"

    @contextmanager
    def _understood(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise SourceError(f"cannot read {self.path}: {error.strerror}") from error
        except UnicodeError as error:
            raise SourceError(f"{self.path}: it is not text in UTF-8 or UTF-16: {error}") from error
        except csv.Error as error:
            raise SourceError(f"{self.path}: it is not a table of texts: {error}") from error


def _surveyed(path: Path) -> tuple[str, int]:
    """Return the encoding of a file's text, and how many lines it has at most.

    Raises:
        SourceError: a line is longer than any table's.
    """
    lines = since = 0
    with path.open("rb") as file:
        head = file.read(len(codecs.BOM_UTF8))
        encoding = next((name for bom, name in _BOMS if head.startswith(bom)), "utf-8")
        file.seek(0)
        decoder = codecs.getincrementaldecoder(encoding)()
        while data := file.read(BYTES):
            if encoding == "utf-8":
                try:
                    decoder.decode(data)
                except UnicodeDecodeError:
                    encoding = "cp1252"  # a degree sign, as Excel writes it
            ends = max(data.count(b"\n"), data.count(b"\r"))
            lines, since = lines + ends, 0 if ends else since + len(data)
            if since > MOST_LINE:
                raise SourceError(
                    f"{path}: it has a line of more than {MOST_LINE} bytes, so it is not a CSV"
                )
    return encoding, lines + 1


def _decoded(data: bytes, *, partial: bool = False) -> str:
    for bom, encoding in _BOMS:
        if data.startswith(bom):
            return codecs.getincrementaldecoder(encoding)().decode(data, final=not partial)
    try:
        return codecs.getincrementaldecoder("utf-8")().decode(data, final=not partial)
    except UnicodeDecodeError:
        return data.decode("cp1252")  # a degree sign, as Excel writes it


def _lines_of(text: str) -> list[str]:
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if said := _EXCEL.fullmatch(lines[0]):
        lines[0] = f"# the separator is {said.group(1)}"
    return lines


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _separator(lines: Sequence[str]) -> str:
    """Return the separator of cells: a tab, a semicolon, a comma, a bar, else spaces."""
    for separator in "\t;,|":
        if sum(separator in line for line in lines) * 2 > len(lines):
            return separator
    return " "


def _split(line: str, separator: str) -> Row:
    return next(_reader([line], separator), [])


def _reader(lines: Iterable[str], separator: str) -> Iterator[list[str]]:
    if separator == " ":
        return map(str.split, (re.sub(r"\s+([\[(])", r"\1", line) for line in lines))
    return csv.reader(lines, delimiter=separator, skipinitialspace=True)


def _trimmed(row: Row, least: int = 0) -> Row:
    """Return a row without the empty cells at its end."""
    end = len(row)
    while end > least and not row[end - 1].strip():
        end -= 1
    return row[:end]


def _layout(rows: Sequence[Row]) -> tuple[int, int] | None:
    """Return the row with names and the first row with values, the same row if there are no names.

    None where no row has values.
    """
    cells = ((i, k, cell) for i, row in enumerate(rows) for k, cell in enumerate(row))
    named = next(((i, k) for i, k, cell in cells if is_column(header_of(cell).name) == "t"), None)
    if named is not None:
        names, time = named
        if len(rows) == names + 1:
            return names, names + 1
        below = rows[names + 1][time].strip() if time < len(rows[names + 1]) else ""
        is_units = not any(c.isdigit() for c in below)  # no unit of time has any
        is_units = is_units and (bool(below) or _are_units(_trimmed(rows[names + 1])))
        return names, names + 1 + is_units
    first = next((i for i, row in enumerate(rows) if _is_data(row)), None)
    if first is None:
        return None
    heads = [i for i, row in enumerate(rows[:first]) if len(_trimmed(row)) > 1]
    if not heads:
        return first, first
    is_units = len(heads) > 1 and _are_units(rows[heads[-1]])
    return heads[-1 - is_units], first


def _are_units(row: Row) -> bool:
    known = sum(unit_of(cell) is not None or cell.strip().lower() in NOTHING for cell in row)
    return 2 * known >= len(row) > 0


def _is_data(row: Row) -> bool:
    """Return whether a line has values: most of its cells that are not empty are numbers."""
    said = [cell.strip() for cell in row if cell.strip().lower() not in MISSING]
    numbers = sum(bool(NUMBER.fullmatch(c) or _DATE.fullmatch(c)) for c in said)
    return len(row) >= 2 and 2 * numbers > len(said)
