"""A record opened for reading: rows of the channels, after the meaning of its columns is settled.

Nothing is guessed: if neither the file nor an option gives a unit, an error of one line asks for
it, unless a column has a name of the table and its values fit the unit of the table.
"""

import tomllib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from yawid.blocks import Floats, RecordBlock
from yawid.errors import ChannelError, SourceError
from yawid.quantities.link import LinkStats
from yawid.quantities.table import CHANNELS
from yawid.quantities.units import HALF_TRAVEL, UNITS
from yawid.sources.logs.as_mavlink import in_pieces
from yawid.sources.records.airspeeds import airspeed_of
from yawid.sources.records.column_values import (
    Settled,
    aileron_of,
    flown_stroke_rad,
    held_of,
    in_its_unit,
    kind_of,
    modes_of,
    place_of,
    possible,
    rudder_of,
    times_of,
)
from yawid.sources.records.find_columns import (
    LATERAL,
    Asked,
    Found,
    LackingError,
    find_columns,
    gathered,
    raise_all,
)
from yawid.sources.records.headers import ANGLES
from yawid.sources.records.rows import Rows, same
from yawid.sources.records.tables import MAGIC, CsvTable, ParquetTable, Table, offsets_us

SHORTEST: Final = 3
"""The least number of rows, and of columns: t, rudder, r."""
MOST_NUMBERS: Final = 10**8
"""The most numbers read: a day of 20 columns at 57 rows a second, which needs up to 4 GB."""
MEASURED: Final = frozenset(
    name for name, row in CHANNELS.items() if row.kind in ("linear", "held") and row.unit
)
"""The columns that are numbers with a unit and need no conversion but that of the unit."""


class Record:
    """A record: ``settle`` finds out what its columns mean, then ``read`` yields its rows.

    Raises:
        SourceError: it cannot be read, or is not understood.
    """

    vehicle_id = None

    def __init__(self, path: Path) -> None:
        self.path = path
        is_parquet = False  # of an unreadable file, too: the table of texts says what is wrong
        with suppress(OSError), path.open("rb") as file:
            is_parquet = file.read(len(MAGIC)) == MAGIC
        self._table: Table = ParquetTable(path) if is_parquet else CsvTable(path)
        self._rows: Rows | None = None
        self.link = LinkStats()
        """The times of the first and the last row; a record has no other counts of a link."""

    def settle(self, asked: Asked) -> Settled:
        """Find the columns and their units by the file and the options; return what is settled.

        Raises:
            ConfigError: an option is missing, or contradicts the file.
            ChannelError: time, rudder, yaw rate, or another column that is needed, is missing.
            SourceError: a cell is not understood.
        """
        table, found = self._table, self._find_columns(asked)
        t_us, unix_ns = times_of(table, found)
        own, nothing = _own_facts(table.facts), same(np.nan, table.rows)
        if "held" in found:  # a run's export, whose deflections are means over a sample
            own["kind"] = "commanded"
        held = held_of(table, found["held"]) if "held" in found else same(-1, table.rows)
        lacking, have = list[LackingError](), dict[str, Floats]()
        with gathered(lacking):
            rudder, settled = rudder_of(table, found["rudder"], asked, own, t_us)
        wanted = MEASURED.union(LATERAL if asked.lateral else ()) & found.keys()
        for name in (each for each in CHANNELS if each in wanted):
            with gathered(lacking):
                have[name] = in_its_unit(table, name, found[name])
        raise_all(self.path, lacking, asked.columns)
        airspeed = airspeed_of(table, found, have, has_held="held" in found)
        mode, whose = _modes(table, found, own.get("autopilot"))
        measured = MEASURED.union(LATERAL) & {*RecordBlock.__slots__} - airspeed.keys()
        self._rows = Rows(
            RecordBlock(
                called={name: each.label for name, each in found.items()}
                | {"rudder": f"{found['rudder'].header.name} [{settled.rudder_unit}]"},
                modes_of=whose,
                assumed=_assumed(found),
                measured=_measured(found, settled, own),
                order=same(0, table.rows),  # each row gets its own order in Rows.piece
                received_us=t_us if unix_ns is None else t_us + offsets_us(t_us, unix_ns),
                t_us=t_us,
                has_yaw=same(True, table.rows),
                has_surfaces=same(True, table.rows),
                held=held,
                rudder=rudder,
                aileron=aileron_of(table, found["aileron"], t_us)
                if "aileron" in found
                else nothing,
                **airspeed,
                mode=mode,
                **{name: have.get(name, nothing) for name in measured},
            )
        )
        table.load(())  # the table need not keep its columns any longer
        rows = self._rows.block
        if settled.stroke_rad is not None and "rudder_stroke_rad" not in own:
            settled = replace(settled, stroke_rad=flown_stroke_rad(rows))
        for name, has in (("rudder", rows.has_surfaces), ("r", rows.has_yaw)):
            if not has.any():
                raise ChannelError(f"{place_of(table, found[name])}: it holds no value at all")
        times = [each.received_us for _, each in self.read() if each is not None]
        first_us, last_us = min(each.min() for each in times), max(each.max() for each in times)
        self.link = LinkStats(first_us=int(first_us), last_us=int(last_us))
        return settled

    def _find_columns(self, asked: Asked) -> dict[str, Found]:
        """Return the columns found, after they were read."""
        self._check_size(SHORTEST)
        found = find_columns(self._table, asked)
        self._check_size(len(found))
        self._table.load(each.place for each in found.values())
        if (rows := self._table.rows) < SHORTEST:
            raise SourceError(f"{self.path}: {rows} rows of data are too few for a record")
        return found

    def _check_size(self, columns: int) -> None:
        rows = self._table.rows
        if rows * columns > MOST_NUMBERS:
            raise SourceError(
                f"{self.path}: {rows} rows of {columns} columns are more than the "
                f"{MOST_NUMBERS:.0e} numbers that are read at a time, {MOST_NUMBERS / 1.25e8:.1f} "
                "GB of them: split it into flights"
            )

    def read(self) -> Iterator[tuple[int, RecordBlock | None]]:
        """Yield (bytes, rows) from the start."""
        assert self._rows is not None, "a record is settled before it is read"
        for size, low, high in in_pieces(self.path, len(self._rows)):
            yield size, self._rows.piece(low, high) if high > low else None


def _assumed(found: dict[str, Found]) -> tuple[str, ...]:
    """Return the names of the used columns that are assumed to be in rad or rad/s."""
    used = (name for name in CHANNELS if name in MEASURED & found.keys())
    return tuple(
        found[name].header.name
        for name in used
        if found[name].unit is None and CHANNELS[name].unit in ANGLES
    )


def _measured(found: dict[str, Found], settled: Settled, own: dict[str, str]) -> tuple[str, ...]:
    """Return the surfaces whose columns are measured deflections."""
    kinds = {"rudder": settled.rudder_is}
    if (aileron := found.get("aileron")) is not None:
        kinds["aileron"] = kind_of(aileron, aileron.unit or UNITS[HALF_TRAVEL], own)
    return tuple(name for name, kind in kinds.items() if kind == "measured")


def _modes(
    table: Table, found: dict[str, Found], autopilot: str | None
) -> tuple[Floats, tuple[int, int]]:
    """Return the flight modes (n,) as numbers, and the autopilot and vehicle type of the modes."""
    if "mode" not in found:
        return same(np.nan, table.rows), (0, 0)
    said = table.words(found["mode"].place)
    numbers, whose = modes_of([] if said is None else said[0], autopilot)
    if said is None:
        return possible("mode", table.numbers(found["mode"].place)), whose
    return numbers[said[1]], whose


def _own_facts(facts: dict[str, str]) -> dict[str, str]:
    """Return sign, travel or stroke, and autopilot from the metadata of an exported file."""
    try:
        settings = tomllib.loads(facts["configuration"])
    except (KeyError, tomllib.TOMLDecodeError, RecursionError):
        return {}
    own = {"rudder_sign": "nose-right", "autopilot": facts.get("autopilot", "")}
    sizes = {name: settings.get(name) for name in ("rudder_max_deg", "rudder_stroke_rad")}
    return own | {name: repr(size) for name, size in sizes.items() if isinstance(size, float | int)}
