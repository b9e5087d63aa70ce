"""A measured step response from a CSV file with the columns t and y."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from yawid.blocks import Floats
from yawid.errors import ConfigError, SourceError


def step_from_csv(path: Path) -> tuple[Floats, Floats]:
    """Return t (n,) in s and y (n,) of a CSV file whose first line names the columns.

    Other columns are ignored, empty lines too; an empty y is NaN.

    Raises:
        SourceError: the file cannot be read or is not text.
        ConfigError: no column t or y, or a value that is no number, with its line.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return _columns(path.name, file)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SourceError(f"{path}: cannot be read: {error}") from error


def _columns(name: str, lines: Iterable[str]) -> tuple[Floats, Floats]:
    rows = csv.reader(lines)
    header = [column.strip().lower() for column in next(rows, [])]
    for column in ("t", "y"):
        if header.count(column) != 1:
            raise ConfigError(f"{name}: the first line must name one column t and one y: {header}")
    places = header.index("t"), header.index("y")
    found = []
    for row in rows:
        if not any(cell.strip() for cell in row):
            continue
        cells = [row[place].strip() if place < len(row) else "" for place in places]
        try:
            t, y = float(cells[0]), float(cells[1] or math.nan)
        except ValueError:
            raise ConfigError(f"{name}, line {rows.line_num}: no numbers: {cells}") from None
        found.append((t, y))
    table = np.array(found, dtype=np.float64).reshape(-1, 2)
    return table[:, 0], table[:, 1]
