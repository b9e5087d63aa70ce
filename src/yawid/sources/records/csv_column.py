"""A column of a CSV file, read in pieces: numbers, dates, or a few texts that are repeated."""

import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.sources.records.times import NO_DATE, NO_TIME, dates_ns_of

NUMBER: Final = re.compile(
    r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][-+]?\d+)?|nan|[-+]?inf(inity)?", re.I
)
MISSING: Final = frozenset({"", "nan", "na", "n/a", "null", "none", "-nan", "#n/a"})
MOST_TEXTS: Final = 10_000
"""The most different texts in a column; flight modes and reasons are a few dozen."""


class NotUnderstoodError(ValueError):
    """A cell that cannot be read, in ``row``; ``{}`` in the text is for the place of ``other``."""

    def __init__(self, text: str, row: int, other: int | None = None) -> None:
        super().__init__(text)
        self.row, self.other = row, other


class CsvColumn:
    """The cells of one column, which ``add`` takes in order.

    ``wrong`` is the row and the text of the first cell that is no number, None where all are.
    """

    def __init__(self, separator: str) -> None:
        self.wrong: tuple[int, str] | None = None
        self._separator = separator
        self._rows = 0
        self._signs: dict[str, tuple[int, str]] = {}  # where a decimal sign stood first
        self._numbers: list[Floats] = []
        self._dates: list[Ints] = []
        self._codes: list[Ints] = []
        self._texts: dict[str, int] = {}

    def add(self, cells: Sequence[str]) -> None:
        """Take in the next cells.

        Raises:
            NotUnderstoodError: they are neither numbers nor dates nor a few texts.
        """
        found = None if self._dates or self._codes else self._as_numbers(cells)
        if found is not None:
            self._numbers.append(found)
        else:
            self._add_texts([_known(cell) for cell in cells])
        self._rows += len(cells)

    def _as_numbers(self, cells: Sequence[str]) -> Floats | None:
        if self._separator != ",":
            cells = self._with_points(cells)
        try:
            return np.array([cell or "nan" for cell in cells]).astype(np.float64)
        except ValueError:
            pass
        numbers = np.full(len(cells), np.nan)
        for i, cell in enumerate(cells):
            text = cell.strip().lower().replace("d", "e")
            if text not in MISSING:
                if NUMBER.fullmatch(cell.strip()) is None or "," in text:
                    self.wrong = self._rows + i, cell
                    return None
                numbers[i] = float(text)
        return numbers

    def _with_points(self, cells: Sequence[str]) -> Sequence[str]:
        """Return the cells with a decimal point in place of a comma, if all are numbers."""
        together = "".join(cells)
        if "," not in together and "," not in self._signs:
            if "." in together and "." not in self._signs:
                self._signs["."] = next(
                    (self._rows + i, c) for i, c in enumerate(cells) if "." in c
                )
            return cells
        if not all(NUMBER.fullmatch(_known(cell)) for cell in cells if _known(cell)):
            return cells
        for sign in ".,":
            if sign in together and sign not in self._signs:
                first = next((self._rows + i, c) for i, c in enumerate(cells) if sign in c)
                self._signs[sign] = first
        if len(self._signs) == 2:
            (row, cell), (other, also) = sorted(self._signs.values())
            raise NotUnderstoodError(
                f"{cell!r}, and {also!r}{{}}: one decimal sign is needed in all of it, and none "
                "that parts thousands",
                row,
                other,
            )
        return [cell.replace(",", ".") for cell in cells]

    def _add_texts(self, texts: list[str]) -> None:
        if not self._codes:
            try:
                self._dates.append(dates_ns_of(texts))
            except ValueError as error:
                if self._dates:
                    row = self._rows + texts.index(str(error))
                    raise NotUnderstoodError(f"{str(error)!r} {NO_TIME}", row) from None
            else:
                if all(np.isnan(piece).all() for piece in self._numbers):
                    missing = [np.full(len(piece), NO_DATE) for piece in self._numbers]
                    self._dates[:0], self._numbers = missing, []
                    return
                self._dates.clear()
            for piece in self._numbers:  # the earlier cells count as texts too
                self._code(["" if np.isnan(each) else f"{each:.9g}" for each in piece.tolist()])
            self._numbers.clear()
        self._code(texts)

    def _code(self, texts: list[str]) -> None:
        known = self._texts
        self._codes.append(np.array([known.setdefault(t, len(known)) for t in texts], np.int32))
        if len(known) > MOST_TEXTS:
            row, cell = self.wrong or (self._rows, texts[0])
            raise NotUnderstoodError(
                f"{cell!r} is not a number, and there are more than {MOST_TEXTS} such texts", row
            )

    def numbers(self) -> Floats:
        """Return the numbers (n,), NaN where a cell is empty."""
        self._numbers = [_joined(self._numbers, np.float64)]
        return self._numbers[0]

    def dates_ns(self) -> Ints | None:
        """Return the Unix time in ns (n,), None where there are no dates."""
        self._dates = [_joined(self._dates, np.int64)] if self._dates else []
        return self._dates[0] if self._dates else None

    def texts(self) -> list[str] | None:
        """Return the texts (n,), missing ones empty; None where the column has no texts."""
        known = list(self._texts)
        return [known[code] for piece in self._codes for code in piece.tolist()] or None


def _known(cell: str) -> str:
    text = cell.strip()
    return "" if text.lower() in MISSING else text


def _joined(pieces: list[Any], kind: type) -> Any:
    """Return the pieces as one array; each piece's memory is freed once it is copied."""
    whole: Any = np.empty(sum(map(len, pieces)), kind)
    at = 0
    pieces.reverse()
    while pieces:
        piece = pieces.pop()
        whole[at : at + len(piece)] = piece
        at += len(piece)
    return whole
