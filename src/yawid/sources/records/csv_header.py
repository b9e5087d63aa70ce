"""The header of a CSV file: its names and units, separator and decimal sign, and its first line.

It is recognised by its first lines: names with a separator between them, then as many numbers.
Also understood are comments (``#``, ``%``, ``//``) and a title above, a second line of the header
with units, any line end, a byte order mark, quotes, and a decimal comma with another separator.
"""

import codecs
import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from yawid.errors import SourceError
from yawid.quantities.units import unit_of
from yawid.sources.records.headers import NOTHING, header_of, is_column

COMMENTS: Final = ("#", "%", "//")
MOST_HEADER_LINES: Final = 200
HEAD: Final = 1 << 20
"""The bytes that hold the header and the first lines with data; no line of a table is longer."""
MISSING: Final = frozenset({"", "nan", "na", "n/a", "null", "none", "-nan", "#n/a"})
NUMBER: Final = re.compile(
    r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][-+]?\d+)?|nan|[-+]?inf(inity)?", re.I
)
_BOMS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_EXCEL: Final = re.compile(r"sep=(.)\s*")
_DATE: Final = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*")
_COMMA: Final = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
Row = Sequence[str]


class CsvHeader(NamedTuple):
    """What a file's first lines say.

    ``units`` are '' where there are none, ``first`` is the number of lines before the first one
    with data, and ``texts`` has the places of the columns whose first cells are no numbers.
    """

    names: list[str]
    units: list[str]
    separator: str
    decimal: str
    first: int
    texts: frozenset[int]


def looks_like_csv(head: bytes) -> bool:
    """Return whether a file with these first bytes is a table of texts: names, then numbers."""
    try:
        text = decoded(head)
        lines = lines_of(text)
        header = read_header(Path(), lines[:-1] if len(lines) > 2 else lines)  # one may be cut
    except (UnicodeError, SourceError):
        return False
    is_plain = all(ord(c) >= 32 or c in "\t\r\n\f" for c in text)
    return is_plain and len(header.names) >= 2


def read_header(path: Path, lines: Sequence[str]) -> CsvHeader:
    """Return what the first lines of a file say.

    Raises:
        SourceError: they have no names, or no values below them.
    """
    used = [(i, line) for i, line in enumerate(lines) if not is_passed_over(line)]
    used = used[:MOST_HEADER_LINES]
    separator = _separator([line for _, line in used])
    rows = [_split(line, separator) for _, line in used]
    found = _layout(rows)
    if found is None or found[1] >= len(rows):
        raise SourceError(f"{path}: it has no line of numbers below a line with names of columns")
    names, at = found
    heads, data, line = rows[names:at], rows[at:], used[at][0]
    if not heads:
        # numpy.savetxt and others write the header as a comment.
        comments = (_split(c.lstrip("#%/ "), separator) for c in lines[:line] if is_comment(c))
        heads = [row for row in comments if len(_trimmed(row)) == len(_trimmed(data[0]))][-2:]
    if not 1 <= len(heads) <= 2:
        raise SourceError(
            f"{path}, line {line + 1}: numbers below {len(heads)} lines of a header: one is needed "
            "with the names of the columns (t, rudder, r), and perhaps one with their units"
        )
    width = max(len(data[0]), len(_trimmed(heads[0])))  # a separator may end each line
    named, units = (
        [*(cell.strip() for cell in row), *[""] * width][:width] for row in (*heads, [])[:2]
    )
    cells = [
        [*column] for column in zip(*([*row, *[""] * width][:width] for row in data), strict=True)
    ]
    commas = separator != "," and any(_COMMA.fullmatch(c.strip()) for each in cells for c in each)
    texts = (i for i, each in enumerate(cells) if any(_is_text(cell) for cell in each))
    return CsvHeader(named, units, separator, "," if commas else ".", line, frozenset(texts))


def decoded(data: bytes) -> str:
    """Return the text of a file's first bytes; the last character may be cut.

    Raises:
        UnicodeError: it is no text.
    """
    encoding = encoding_of(data)
    try:
        return codecs.getincrementaldecoder(encoding)().decode(data)
    except UnicodeDecodeError:
        if encoding != "utf-8":
            raise
        return data.decode("cp1252")  # a degree sign, as Excel writes it


def encoding_of(data: bytes) -> str:
    """Return the encoding that a file's first bytes give, UTF-8 without a byte order mark."""
    return next((name for bom, name in _BOMS if data.startswith(bom)), "utf-8")


def lines_of(text: str) -> list[str]:
    """Return the lines of a text; Excel's name of the separator becomes a comment."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if said := _EXCEL.fullmatch(lines[0]):
        lines[0] = f"# the separator is {said.group(1)}"
    return lines


def is_comment(line: str) -> bool:
    """Return whether a line is a comment."""
    return line.lstrip().startswith(COMMENTS)


def is_passed_over(line: str) -> bool:
    """Return whether a line is empty or a comment."""
    return not line.strip() or is_comment(line)


def _is_text(cell: str) -> bool:
    return cell.strip().lower() not in MISSING and NUMBER.fullmatch(cell.strip()) is None


def _separator(lines: Sequence[str]) -> str:
    """Return the separator of cells: a tab, a semicolon, a comma, a bar, else spaces."""
    in_most = (s for s in "\t;,|" if 2 * sum(s in line for line in lines) > len(lines))
    return next(in_most, " ")


def _split(line: str, separator: str) -> Row:
    if separator == " ":
        return re.sub(r"\s+([\[(])", r"\1", line).split()
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        return []


def _trimmed(row: Row) -> Row:
    """Return a row without the empty cells at its end."""
    filled = (i for i, cell in enumerate(row) if cell.strip())
    return row[: max(filled, default=-1) + 1]


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
