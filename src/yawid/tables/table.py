"""Tables of columns with units, in Arrow, and their conversion to pandas, polars and xarray."""

from collections.abc import Iterator, Sequence
from textwrap import fill
from typing import Any, Final, NamedTuple, overload

import numpy as np
import pyarrow as pa

from yawid.blocks import Array
from yawid.errors import library
from yawid.sinks.door import plain

SHOWN: Final = 10
"""The number of rows of a table that a notebook shows: half of them the first, half the last."""

TIME: Final = pa.timestamp("ns", tz="UTC")
HELD: Final = " nose-right held"
"""What a record says of a rudder in rad, next to its unit."""


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

    ``arrow`` is the pyarrow.Table in which they are, with null where a number is unknown; libraries
    that read Arrow take the table itself. ``units`` and ``says`` hold unit and meaning by name,
    ``columns`` the names, ``title`` says what the rows are. ``table[10:20]``, or a mask or indices
    (m,), gives the table of these rows.
    """

    __slots__ = ("arrow",)

    def __init__(self, arrow: pa.Table) -> None:
        self.arrow = arrow

    @classmethod
    def of(cls, title: str, columns: Sequence[Column]) -> "Table":
        """Return the table of columns."""
        return cls(arrow_table(columns, {"title": title}))

    @property
    def title(self) -> str:
        """What the rows are."""
        return str(self.arrow.schema.metadata[b"title"].decode())

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns, in order."""
        return tuple(self.arrow.column_names)

    def keys(self) -> tuple[str, ...]:
        """Return the names of the columns, so that ``dict(table)`` gives the arrays by name."""
        return self.columns

    @property
    def units(self) -> dict[str, str]:
        """The unit of each column: ``1`` without one, "" for texts."""
        return {name: unit.removesuffix(HELD) for name, unit in self._said(b"unit").items()}

    @property
    def says(self) -> dict[str, str]:
        """The meaning of each column."""
        return self._said(b"says")

    def _said(self, key: bytes) -> dict[str, str]:
        return {field.name: field.metadata[key].decode() for field in self.arrow.schema}

    @property
    def counted(self) -> str:
        """What the rows are, and their number, in words."""
        return f"{self.title}, {len(self)} row{'' if len(self) == 1 else 's'}"

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return int(self.arrow.num_rows)

    @overload
    def __getitem__(self, key: str) -> Array: ...
    @overload
    def __getitem__(self, key: slice | Array) -> "Table": ...
    def __getitem__(self, key: str | slice | Array) -> "Array | Table":
        if not isinstance(key, str):
            return Table(self.arrow.take(np.arange(len(self))[key]))
        if key not in self.columns:
            raise KeyError(f"{self.title} have no column {key!r}: {', '.join(self)}")
        return np.asarray(self.arrow.column(key).to_numpy())

    def __getattr__(self, name: str) -> Array:
        if name.startswith("_") or name == "arrow":  # not set yet, as while unpickling
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(*error.args) from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.columns]

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Give the table to another library, by Arrow's own interface."""
        return self.arrow.__arrow_c_stream__(requested_schema)

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame; ``attrs["units"]`` has the units by name.

        Raises:
            ConfigError: pandas is not installed.
        """
        frame = library("pandas").DataFrame(dict(self))
        frame.attrs |= {"title": self.title, "units": self.units}
        return frame

    def to_polars(self) -> Any:
        """Return a polars.DataFrame with unknown numbers as null; polars cannot keep units.

        Raises:
            ConfigError: polars is not installed.
        """
        return library("polars").from_arrow(self.arrow)

    def to_xarray(self) -> Any:
        """Return an xarray.Dataset over ``t`` (or ``n``), each variable with ``attrs["units"]``.

        Raises:
            ConfigError: xarray is not installed.
        """
        units, says, along = self.units, self.says, self.columns[0]
        variables = {
            name: (along, filled(self[name]), {"units": units[name], "long_name": says[name]})
            for name in self
        }
        over = {name: variables.pop(name) for name in (along, "time") if name in variables}
        return library("xarray").Dataset(variables, over, {"title": self.title})

    def __repr__(self) -> str:
        units = {name: f" [{unit}]" for name, unit in self.units.items() if unit not in ("", "1")}
        text = plain(f"{self.counted}: {', '.join(name + units.get(name, '') for name in self)}")
        return fill(text, 100, subsequent_indent="    ", break_on_hyphens=False)

    def _repr_html_(self) -> str:
        from yawid.sinks.pages import Grid, Note, to_html

        rows: list[int | None] = [*range(len(self))]
        if len(rows) > SHOWN:
            rows[SHOWN // 2 : -SHOWN // 2] = [None]
        values = [self[name] for name in self]
        cells = [["…" if row is None else cell(each[row]) for each in values] for row in rows]
        heads = [f"{name} {unit}".strip() for name, unit in self.units.items()]
        page = to_html([Note(self.counted), Grid(heads, cells)])
        return f'<div style="overflow-x:auto;white-space:nowrap">{page}</div>'


def arrow_table(columns: Sequence[Column], facts: dict[str, str]) -> pa.Table:
    """Return columns with their units as an Arrow table; what is unknown is null."""
    arrays = [_array(column) for column in columns]
    said = [{"unit": unit_of(column), "says": column.says} for column in columns]
    fields = [
        pa.field(column.name, array.type, metadata=each)
        for column, array, each in zip(columns, arrays, said, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=facts))


def unit_of(column: Column) -> str:
    """Return a column's unit; for a rudder in rad also its sign, and that it holds to the next row.

    A record whose rudder is an angle must give its sign, and is taken as measured if it does not
    say otherwise.
    """
    return f"rad{HELD}" if (column.name, column.unit) == ("rudder", "rad") else column.unit


def _array(column: Column) -> pa.Array:
    values = column.values
    if values.dtype == object:
        return pa.array(values, pa.string())
    if values.dtype.kind == "M":
        return pa.array(values).cast(TIME)
    return pa.array(values, from_pandas=True)


def cell(value: object) -> str:
    """Return a value as text for a person, "" where it is unknown."""
    if value is None or value != value:  # NaN and NaT
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def filled(values: Array) -> Array:
    """Return texts (n,) as a NumPy array of strings, "" where unknown; numbers as they are."""
    is_text = values.dtype == object
    return np.array([each or "" for each in values], np.str_) if is_text else values
