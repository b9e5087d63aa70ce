"""A data set on this machine: SQLite while a fleet runs, one Parquet file a table at its end.

    DATASET/fleet.sqlite                    each log's rows; only a fleet opens it
    DATASET/logs.parquet, flights.parquet   a file for each table of :mod:`yawid.dataset.schema`
    DATASET/SCHEMA.md                       its columns

A log's rows are one transaction, so that a kill loses no finished log. The Parquet files are all
written under ``.part`` names and then renamed: whoever reads them finds each as it was or as it is,
and no row twice. After a kill they are the last finished fleet's until the next fleet writes them.

A log has one outcome: a newer one replaces the older one with all its rows. Rows are dicts by
column name, with times in microseconds since 1970.
"""

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from yawid.dataset.schema import FORMAT, ID, TABLES, Table, schema_page
from yawid.dataset.values import Entry, ReadRow, plain
from yawid.errors import SinkError, SourceError
from yawid.system.part_file import os_errors_as_sink_error, write_whole, written_whole

DATABASE, COPIES = "fleet.sqlite", "fleet.copies"
"""What only a running fleet uses: its database, and the folder for copies of a store's logs."""
PAGE: Final = "SCHEMA.md"
"""The file that describes the columns; those of a Parquet file have the same words (``says``)."""
ROWS: Final = 10_000
"""Rows that are in memory at once, and in one row group of a Parquet file."""
KNOWN: Final = ("size_bytes", "modified", "config_hash", "analysis_version", "outcome")
"""The columns of ``logs`` that decide whether a log is run again."""
_OURS: Final = 0x79617764
"""SQLite's application id, by which a database is known to be a data set's."""
_MAKE: Final = f"""
    CREATE TABLE IF NOT EXISTS rows (path TEXT, name TEXT, row TEXT);
    CREATE INDEX IF NOT EXISTS by_path ON rows (path);
    CREATE TABLE IF NOT EXISTS unwritten (path TEXT);
    PRAGMA application_id = {_OURS};
    PRAGMA user_version = {FORMAT};
"""
"""``rows`` has each row as JSON by its log's path and its table's name; ``unwritten`` the logs that
the Parquet files do not have."""
_ROWS_OF: Final = """
    WITH alike AS (
        SELECT path, row_number() OVER (
            PARTITION BY row ->> 'log_sha256' ORDER BY (row ->> 'kind') IS 'mcap', path
        ) AS place
        FROM rows WHERE name = 'logs'
    )
    SELECT row FROM rows JOIN alike USING (path)
    WHERE name = ? AND (name = 'logs' OR place = 1) ORDER BY {order}
"""
"""The rows of a table. Of logs of the same bytes the first by path has the rows in all tables but
``logs``, an MCAP only if there is no other: so nothing depends on the order of the runs."""


def read_table(folder: Path, name: str, columns: Sequence[str] | None = None) -> pa.Table:
    """Return a table of a data set, in its own order, with all columns or some.

    Raises:
        SourceError: there is no data set of this version, or it cannot be read.
    """
    path, schema = folder / f"{name}.parquet", TABLES[name].schema
    try:
        with pq.ParquetFile(path) as file:
            its = file.schema_arrow  # the words of its columns may differ
            if not its.equals(schema) or its.metadata != schema.metadata:
                raise SourceError(f"{path} is of another version of yawid: run yawid fleet again")
            names = schema.names if columns is None else list(columns)
            return file.read(names).select(names).unify_dictionaries()
    except (FileNotFoundError, NotADirectoryError):
        raise SourceError(f"{folder} is not a data set: it has no {path.name}") from None
    except (OSError, pa.ArrowException) as error:
        raise SourceError(f"{path} cannot be read: {error}") from error


def table_of(table: Table, rows: Sequence[ReadRow]) -> pa.Table:
    """Return rows as a table, with ids as plain strings; columns that they lack are NULL.

    Raises:
        ValueError: a row has a column that the table does not have.
    """
    clean = plain(list(rows))
    if unknown := {name for row in clean for name in row} - set(table.schema.names):
        raise ValueError(f"{table.name} has no column {', '.join(sorted(unknown))}")
    fields = [each.with_type(pa.string()) if each.type == ID else each for each in table.schema]
    return pa.Table.from_pylist(clean, pa.schema(fields))


class DataSet(AbstractContextManager["DataSet"]):
    """The data set of one running fleet, locked against other fleets until its context ends.

    Its folder is made where there is none. The Parquet files are written when the context ends,
    however it ends.

    Raises:
        SinkError: the folder cannot be written or locked, is not a data set, or another fleet
            writes to it.
        SourceError: the data set is of another version.
    """

    def __init__(self, folder: Path) -> None:
        check_ours(folder)
        with os_errors_as_sink_error(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.copies = folder, folder / COPIES
        with _said(folder), ExitStack() as stack:
            self._rows = stack.enter_context(closing(sqlite3.connect(folder / DATABASE, timeout=0)))
            self._rows.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._rows.execute("BEGIN EXCLUSIVE")
            if _OURS not in self._rows.execute("PRAGMA application_id").fetchone():
                self._rows.executescript(f"BEGIN; {_MAKE} COMMIT")
            self._rows.commit()
            stack.pop_all()  # it stays open

    def __exit__(self, *_: object) -> None:
        """Write the Parquet files where something has changed, and release the lock.

        Raises:
            SinkError: they cannot be written.
            SourceError: the database has rows that no fleet wrote.
        """
        try:
            with _said(self.folder):
                is_new = self._rows.execute("SELECT * FROM unwritten LIMIT 1").fetchone()
                if is_new or not all(map(self._is_written, TABLES)):
                    self._write()
        except (pa.ArrowException, ValueError, TypeError, OverflowError, RecursionError) as error:
            text = f"{self.folder / DATABASE} has rows that no fleet wrote: {error}"
            raise SourceError(text) from error
        finally:
            self._rows.close()

    def known(self) -> dict[str, ReadRow]:
        """Return the columns ``KNOWN`` of each log by its path."""
        with _said(self.folder):
            return _known(self._rows)

    def add(self, entry: Entry) -> None:
        """Add a log's rows, which fit the tables. They are kept even after a kill.

        Raises:
            SinkError: they cannot be written.
        """
        path = entry["logs"][0]["path"]
        rows = [
            (path, name, json.dumps(plain(dict(row)), allow_nan=False))
            for name, below in entry.items()
            for row in below
        ]
        with _said(self.folder), self._rows:
            self._rows.execute("DELETE FROM rows WHERE path = ?", (path,))
            self._rows.executemany("INSERT INTO rows VALUES (?, ?, ?)", rows)
            self._rows.execute("INSERT INTO unwritten VALUES (?)", (path,))

    def _write(self) -> None:
        with ExitStack() as stack:  # at its end, when all are written, each gets its name
            for table in TABLES.values():
                path = self.folder / f"{table.name}.parquet"
                stream = stack.enter_context(written_whole(path, force=True))
                with pq.ParquetWriter(stream, table.schema, compression="zstd") as file:
                    order = ", ".join(f"row ->> '{name}' NULLS LAST" for name in table.order)
                    found = self._rows.execute(_ROWS_OF.format(order=order), (table.name,))
                    while rows := found.fetchmany(ROWS):
                        part = table_of(table, [json.loads(row) for (row,) in rows])
                        file.write_table(part.cast(table.schema))
        write_whole({self.folder / PAGE: schema_page().encode()}, force=True)
        with self._rows:
            self._rows.execute("DELETE FROM unwritten")

    def _is_written(self, name: str) -> bool:
        with suppress(SourceError):
            read_table(self.folder, name, ())
            return True
        return False


def peek(folder: Path) -> dict[str, ReadRow]:
    """Return :meth:`DataSet.known` of a data set that may not exist yet, without writing anything.

    Raises:
        SinkError: a fleet is writing to it, or the folder is not a data set.
        SourceError: the data set is of another version.
    """
    if not check_ours(folder):
        return {}
    with _said(folder), closing(sqlite3.connect(folder / DATABASE, timeout=0.0)) as database:
        return _known(database)


def _known(database: sqlite3.Connection) -> dict[str, ReadRow]:
    columns = ", ".join(f"row ->> '{name}'" for name in KNOWN)
    found = database.execute(f"SELECT path, {columns} FROM rows WHERE name = 'logs'")
    return {path: dict(zip(KNOWN, values, strict=True)) for path, *values in found}


def check_ours(folder: Path) -> bool:
    """Return whether a folder is a data set; if not, it may become one, and need not exist.

    Raises:
        SinkError: the folder holds other files, or cannot be listed.
        SourceError: the data set is of another version.
    """
    with os_errors_as_sink_error(folder):
        names = {path.name for path in folder.iterdir()} if folder.exists() else set()
        head = b""
        if DATABASE in names:
            with (folder / DATABASE).open("rb") as stream:
                head = stream.read(100)
    version, ours = int.from_bytes(head[60:64]), int.from_bytes(head[68:72])
    if ours == _OURS and version != FORMAT:
        raise SourceError(f"{folder} has format {version}, this version reads {FORMAT}")
    if ours == _OURS:
        return True
    # A fleet that was killed before it had made its database leaves an empty file, and a journal.
    if names - {DATABASE, f"{DATABASE}-journal"} or head:
        raise SinkError(f"{folder} is not empty and is not a data set: choose another --out")
    return False


@contextmanager
def _said(folder: Path) -> Iterator[None]:
    """Turn an error of SQLite into a SinkError of one line."""
    try:
        yield
    except sqlite3.Error as error:
        name = getattr(error, "sqlite_errorname", "")
        if "LOCK" in name or name in ("SQLITE_BUSY", "SQLITE_PROTOCOL", "SQLITE_PERM"):
            raise SinkError(
                f"another yawid fleet is writing to {folder}: wait until it has ended; if there is "
                f"none, the folder's disk cannot lock files ({name}): choose a folder on another"
            ) from error
        raise SinkError(f"cannot write {folder / DATABASE}: {error}") from error
