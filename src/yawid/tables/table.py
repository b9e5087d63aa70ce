"""Tables of columns with units, and their conversion to pandas, polars and xarray."""

import importlib
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from textwrap import fill
from typing import Any, Final, NamedTuple, overload

import numpy as np

from yawid.blocks import Array
from yawid.errors import ConfigError
from yawid.sinks.door import plain

SHOWN: Final = 10
"""The number of rows of a table that a notebook shows: half of them the first, half the last."""


class Column(NamedTuple):
    """One column: values (n,), their unit (``1`` without one, "" for texts), their meaning.

    Texts are objects, None where unknown; unknown numbers are NaN, unknown times NaT.
    """

    name: str
    values: Array
    unit: str = ""
    says: str = ""


class Table:
    """Columns of one length, each a NumPy array (n,): ``table.wn`` or ``table["wn"]``.

    ``units`` and ``says`` hold unit and meaning by name, ``columns`` the names, ``title`` says what
    the rows are. ``table[10:20]``, or a mask or indices (m,), gives the table of these rows.
    """

    __slots__ = ("_values", "says", "title", "units")

    def __init__(self, title: str, columns: Sequence[Column]) -> None:
        self.title = title
        self._values = {column.name: column.values for column in columns}
        self.units = {column.name: column.unit for column in columns}
        self.says = {column.name: column.says for column in columns}

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns, in order."""
        return tuple(self._values)

    @property
    def counted(self) -> str:
        """What the rows are, and their number, in words."""
        return f"{self.title}, {len(self)} row{'' if len(self) == 1 else 's'}"

    def keys(self) -> tuple[str, ...]:
        """Return the names of the columns, so that ``dict(table)`` gives the arrays by name."""
        return self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __len__(self) -> int:
        return next((len(values) for values in self._values.values()), 0)

    @overload
    def __getitem__(self, key: str) -> Array: ...
    @overload
    def __getitem__(self, key: slice | Array) -> "Table": ...
    def __getitem__(self, key: str | slice | Array) -> "Array | Table":
        if isinstance(key, str):
            if key not in self._values:
                raise KeyError(f"{self.title} have no column {key!r}: {', '.join(self)}")
            return self._values[key]
        if not isinstance(key, slice | np.ndarray):
            raise TypeError(f"rows are chosen by a slice, a mask or indices, not by {key!r}")
        return Table(self.title, [c._replace(values=c.values[key]) for c in self.each()])

    def __getattr__(self, name: str) -> Array:
        if name.startswith("_") or name in Table.__slots__:  # not set yet, as while unpickling
            raise AttributeError(name)
        if name not in self._values:
            raise AttributeError(f"{self.title} have no column {name!r}: {', '.join(self)}")
        return self._values[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def _ipython_key_completions_(self) -> list[str]:
        return list(self._values)

    def each(self) -> Iterator[Column]:
        """Yield each column with its name, unit and meaning."""
        for name, values in self._values.items():
            yield Column(name, values, self.units[name], self.says[name])

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame; ``attrs["units"]`` has the units by name.

        Raises:
            ConfigError: pandas is not installed.
        """
        frame = library("pandas").DataFrame(dict(self))
        frame.attrs |= {"title": self.title, "units": dict(self.units)}
        return frame

    def to_polars(self) -> Any:
        """Return a polars.DataFrame with unknown numbers as null; polars cannot keep units.

        Raises:
            ConfigError: polars is not installed.
        """
        columns = {name: _plain(values) for name, values in self._values.items()}
        return library("polars").DataFrame(columns, nan_to_null=True)

    def to_xarray(self) -> Any:
        """Return an xarray.Dataset over ``t`` (or ``n``), each variable with ``attrs["units"]``.

        Raises:
            ConfigError: xarray is not installed.
        """
        along = self.columns[0] if self.columns else "row"
        variables = {c.name: (along, filled(c.values), _described(c)) for c in self.each()}
        over = {name: variables.pop(name) for name in (along, "time") if name in variables}
        return library("xarray").Dataset(variables, over, {"title": self.title})

    def __repr__(self) -> str:
        units = {name: f" [{unit}]" for name, unit in self.units.items() if unit not in ("", "1")}
        named = ", ".join(name + units.get(name, "") for name in self)
        text = plain(f"{self.counted}: {named}")
        return fill(text, 100, subsequent_indent="    ", break_on_hyphens=False)

    def _repr_html_(self) -> str:
        half = SHOWN // 2
        rows = [*range(len(self))]
        is_cut = len(rows) > SHOWN
        rows = [*rows[:half], *rows[-half:]] if is_cut else rows
        heads = "".join(
            f'<th title="{escape(c.says)}">{escape(c.name)}<br><small>{escape(c.unit)}</small></th>'
            for c in self.each()
        )
        lines = [
            "".join(f"<td>{escape(cell(values[row]))}</td>" for values in self._values.values())
            for row in rows
        ]
        if is_cut:
            lines.insert(half, f'<td>…</td><td colspan="{len(self.columns) - 1}"></td>')
        body = "".join(f"<tr>{line}</tr>" for line in lines)
        return (
            f'<div style="overflow-x:auto;white-space:nowrap"><p>{escape(self.counted)}</p>'
            f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>"
        )


def cell(value: object) -> str:
    """Return a value as text for a person, "" where it is unknown."""
    if value is None or value != value:  # NaN and NaT
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)


def library(name: str) -> Any:
    """Import an optional library.

    Raises:
        ConfigError: it is not installed; the message names it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ConfigError(f"to_{name} needs {name}: pip install {name} ({error})") from error


def filled(values: Array) -> Array:
    """Return texts (n,) as a NumPy array of strings, "" where unknown; numbers as they are."""
    if values.dtype != object:
        return values
    return np.array(["" if each is None else each for each in values], np.str_)


def _plain(values: Array) -> Any:
    """Return objects as a list, from whose values polars finds the type."""
    return values.tolist() if values.dtype == object else values


def _described(column: Column) -> Mapping[str, str]:
    known = {"units": column.unit, "long_name": column.says}
    return {name: text for name, text in known.items() if text}
