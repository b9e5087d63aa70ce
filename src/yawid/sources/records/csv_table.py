"""A CSV file as a table of texts: its separator, header, units and decimal sign found out.

Known by its first lines: names that a separator parts, then as many numbers. Comments (``#``,
``%``), a line of its title, a second line of the header with units, any line end, a byte order
mark, quotes, a decimal comma beside another separator are understood.
"""

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.errors import SourceError
from yawid.sources.records.units import NOTHING, header_of, is_column, unit_of

COMMENTS: Final = ("#", "%", "//")
MOST_HEADER_LINES: Final = 200
_BOMS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
NUMBER: Final = re.compile(
    r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][-+]?\d+)?|nan|[-+]?inf(inity)?", re.I
)
MISSING: Final = frozenset({"", "nan", "na", "n/a", "null", "none", "-nan", "#n/a"})
_EXCEL: Final = re.compile(r"sep=(.)\s*")
_DATE: Final = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:.*")
Row = Sequence[str]


def looks_like_csv(head: bytes) -> bool:
    """Tell by its first bytes whether a file is a table of texts: names, then numbers."""
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
    """The columns of a CSV file, texts until they are asked for as numbers.

    ``names`` and ``units`` are those of its header, '' where there is none; ``facts`` is empty: a
    CSV says nothing of itself.

    Raises:
        SourceError: its header or one of its lines is not understood.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.facts = path, dict[str, str]()
        try:
            self._read(_decoded(data))
        except UnicodeError as error:
            raise SourceError(f"{path}: no text in UTF-8 or UTF-16: {error}") from error
        except csv.Error as error:
            raise SourceError(f"{path}: no table of texts: {error}") from error

    def _read(self, text: str) -> None:
        """Take the file's lines apart."""
        lines = _lines_of(text)
        used = [i for i, line in enumerate(lines) if line.strip() and not _is_comment(line)]
        self._separator = _separator([lines[i] for i in used[:MOST_HEADER_LINES]])
        first = self._read_header(lines, used)
        self._lines = used[first:]
        rows = self._split_all([lines[i] for i in self._lines])
        self._columns = [list(column) for column in zip(*rows, strict=True)]
        self.rows = len(rows)

    def _read_header(self, lines: list[str], used: list[int]) -> int:
        """Find names and units; return which of the ``used`` lines is the first with data."""
        rows = [_split(lines[i], self._separator) for i in used[:MOST_HEADER_LINES]]
        found = _layout(rows)
        if found is None or found[1] >= len(rows):
            raise SourceError(
                f"{self.path}: no line with numbers below a line with the names of columns"
            )
        names, first = found
        heads = rows[names:first]
        if not heads:
            # numpy.savetxt and others write the header as a comment.
            comments = (line for line in lines[: used[first]] if _is_comment(line))
            split = (_split(line.lstrip("#%/ "), self._separator) for line in comments)
            width = len(_trimmed(rows[first]))
            heads = [row for row in split if len(_trimmed(row)) == width][-2:]
        if not 1 <= len(heads) <= 2:
            raise SourceError(
                f"{self.path}, line {used[first] + 1}: numbers below {len(heads)} lines of a "
                "header: one is needed with the names of the columns (t, rudder, r), and perhaps "
                "one with their units"
            )
        self.names = [cell.strip() for cell in _trimmed(heads[0])]
        below = [cell.strip() for cell in heads[1]] if len(heads) > 1 else []
        self.units = [*below, *[""] * len(self.names)][: len(self.names)]
        return first

    def _split_all(self, lines: list[str]) -> list[Row]:
        """Return the cells of every line with data, as many each as there are names."""
        width = len(self.names)
        rows: list[Row] = []
        for i, cells in enumerate(_reader(lines, self._separator)):
            row = cells if len(cells) <= width else _trimmed(cells, width)
            if len(row) != width:
                raise SourceError(
                    f"{self.path}, read as CSV, line {self._lines[i] + 1}: {len(row)} cells, the "
                    f"header has {width}: a line was cut short, or the separator "
                    f"{self._separator!r} stands in a number"
                )
            rows.append(row)
        return rows

    def texts(self, column: int) -> list[str] | None:
        """Return the texts of a column, missing ones empty; None where all are numbers."""
        kinds = {cell: cell.strip() for cell in set(self._columns[column])}
        missing = {cell for cell, text in kinds.items() if text.lower() in MISSING}
        if all(cell in missing or NUMBER.fullmatch(text) for cell, text in kinds.items()):
            return None
        return ["" if cell in missing else kinds[cell] for cell in self._columns[column]]

    def numbers(self, column: int) -> Floats:
        """Return the numbers of a column, NaN where a cell is empty.

        Raises:
            SourceError: a cell is no number; the text says which.
        """
        cells = self._columns[column]
        if self._separator != ",":
            cells = self._with_points(column, cells)
        try:
            return np.array([cell or "nan" for cell in cells]).astype(np.float64)
        except ValueError:
            pass
        numbers = np.full(len(cells), np.nan)
        for i, cell in enumerate(cells):
            text = cell.strip().lower().replace("d", "e")
            if text not in MISSING:
                if NUMBER.fullmatch(cell.strip()) is None or "," in text:
                    raise self._no_number(column, i)
                numbers[i] = float(text)
        return numbers

    def _with_points(self, column: int, cells: list[str]) -> list[str]:
        """Return cells with a decimal point in place of a comma."""
        commas = [i for i, cell in enumerate(cells) if "," in cell]
        if not commas:
            return cells
        pointed = next((i for i, cell in enumerate(cells) if "." in cell), None)
        if pointed is not None:
            i = min(pointed, commas[0])
            other = max(pointed, commas[0])
            raise SourceError(
                f"{self._place(column, i)}: {cells[i]!r}, and {cells[other]!r} in line "
                f"{self._lines[other] + 1}: one decimal sign is needed in all of it, and none that "
                "parts thousands"
            )
        return [cell.replace(",", ".") for cell in cells]

    def dates_ns(self, column: int) -> Ints | None:
        """Return None: a CSV has texts for dates."""
        return None

    def line(self, row: int) -> str:
        """Return the line at which a row of the data stands."""
        return f"line {self._lines[row] + 1}"

    def _no_number(self, column: int, row: int) -> SourceError:
        cell = self._columns[column][row]
        return SourceError(f"{self._place(column, row)}: {cell!r} is no number")

    def _place(self, column: int, row: int) -> str:
        line = self._lines[row] + 1
        return f"{self.path}, line {line}, column {column + 1} ({self.names[column]})"


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
    """Return what parts the cells: a tab, a semicolon, a comma, a bar, else spaces."""
    for separator in "\t;,|":
        if sum(separator in line for line in lines) * 2 > len(lines):
            return separator
    return " "


def _split(line: str, separator: str) -> Row:
    return next(_reader([line], separator), [])


def _reader(lines: Sequence[str], separator: str) -> Iterator[list[str]]:
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
    """Return which row has the names and which the first values; the same where none has names."""
    names = next((i for i, row in enumerate(rows) if _names_time(row)), None)
    if names is not None:
        time = next(i for i, c in enumerate(rows[names]) if is_column(header_of(c).name) == "t")
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
    """Tell whether a line holds values: most of what it says are numbers."""
    said = [cell.strip() for cell in row if cell.strip().lower() not in MISSING]
    numbers = sum(bool(NUMBER.fullmatch(c) or _DATE.fullmatch(c)) for c in said)
    return len(row) >= 2 and 2 * numbers > len(said)


def _names_time(row: Row) -> bool:
    return any(is_column(header_of(cell).name) == "t" for cell in row)
