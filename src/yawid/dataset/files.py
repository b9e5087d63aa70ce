"""A data set on disk or in a store: Parquet files by table and month, and a manifest of them.

A merge writes new files, which become part of the data set when the manifest names them
(:mod:`yawid.dataset.places`): if it is killed at any moment, the data set is either as before or as
after. A log has one outcome: a newer one replaces the older one with all its rows. Rows are dicts
by column name, with times in microseconds since 1970.
"""

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from yawid.dataset.places import MANIFEST, NEW, NO_MONTH, complete, month_of, opened, read_manifest
from yawid.dataset.schema import FORMAT, ID, TABLES, TIME, Table, json_schema, schema_page
from yawid.dataset.values import Entry, ReadRow, Row, plain
from yawid.errors import SourceError
from yawid.system.part_file import os_errors_as_sink_error, sync, write_whole
from yawid.system.stores import Place

PAGE, SCHEMA = "SCHEMA.md", "schema.json"
"""Files that describe the columns: one for people, one for programs."""
MOST_ROWS: Final = 1_000_000
"""Most rows in a file; a file with half as many is no longer merged with new rows."""


def read_table(folder: Place, name: str, columns: Sequence[str] | None = None) -> pa.Table:
    """Return a table of a data set, with all columns or some; ids are dictionary-encoded.

    Rows come month by month, and within each file in the table's own order.

    Raises:
        SourceError: there is no data set, or a file that its manifest names cannot be read.
    """
    files = read_manifest(folder)["tables"].get(name, {"files": []})["files"]
    return _read(folder, TABLES[name], [each["path"] for each in files], columns)


def read_flights_by_loop(folder: Place, columns: Sequence[str]) -> pa.Table:
    """Return some columns of ``flights_by_loop``, ``log_sha256`` among them.

    Logs of an older analysis have no rows there: those in ``flights`` stand in for them.

    Raises:
        SourceError: there is no data set, or a file that its manifest names cannot be read.
    """
    by_loop, older = (read_table(folder, name, columns) for name in ("flights_by_loop", "flights"))
    has = pc.is_in(older["log_sha256"].cast(pa.string()), by_loop["log_sha256"].cast(pa.string()))
    older = older.filter(pc.invert(has))
    return pa.concat_tables([by_loop, older]).unify_dictionaries()


def merge(folder: Place, entries: Iterable[Entry]) -> Row:
    """Merge logs with all their rows into a data set, which is created if there is none.

    Return the new manifest. Of several entries with one path, the last counts. Logs of the same
    bytes have a row each in ``logs``, and share their rows in the other tables.

    Raises:
        SourceError: the data set that is there cannot be read.
        SinkError: the data set cannot be written.
    """
    by_path = {entry["logs"][0]["path"]: entry for entry in entries}
    before = completed(folder) or _begun(folder)
    generation = before["generation"] + 1
    logs = _logs(folder, before, by_path)
    by_sha = _owners(logs, by_path)
    is_alive = set(pc.unique(logs["log_sha256"].drop_null()).to_pylist())
    tables: dict[str, list[Row]] = {}
    with os_errors_as_sink_error(folder):
        tables["logs"] = _write(folder, TABLES["logs"], "logs", logs, generation)
        for table in TABLES.values():
            if table.by_month:
                new = [row for entry in by_sha.values() for row in entry.get(table.name, ())]
                files = before["tables"].get(table.name, {"files": []})["files"]
                tables[table.name] = _merged(
                    folder, table, files, new, by_sha.keys(), is_alive, generation
                )
        manifest = _manifest(tables, logs, generation)
        texts = {
            PAGE: schema_page().encode(),
            SCHEMA: _json(json_schema()),
            MANIFEST: _json(manifest),  # written last: it makes the other files count
        }
        _put(folder, texts)
        complete(folder, manifest)
    return manifest


def completed(folder: Place) -> Row | None:
    """Complete a merge that a kill interrupted; return the manifest, or None if there is none.

    Raises:
        SourceError: the manifest cannot be read.
        SinkError: the data set cannot be written.
    """
    if not (folder / MANIFEST).exists():
        return None
    manifest = read_manifest(folder)
    with os_errors_as_sink_error(folder):
        complete(folder, manifest)
    return manifest


def _begun(folder: Place) -> Row:
    """Make a folder an empty data set; return its manifest."""
    manifest = {"format": FORMAT, "generation": 0, "outcomes": {}, "tables": {}}
    with os_errors_as_sink_error(folder):
        if isinstance(folder, Path):
            folder.mkdir(parents=True, exist_ok=True)
        _put(folder, {MANIFEST: _json(manifest)})
    return manifest


def _put(folder: Place, texts: Mapping[str, bytes]) -> None:
    """Write files, in their order; each is there as a whole or not at all."""
    if isinstance(folder, Path):
        write_whole({folder / name: text for name, text in texts.items()}, force=True)
    else:
        for name, text in texts.items():
            (folder / name).write_bytes(text)


def table_of(table: Table, rows: Sequence[ReadRow]) -> pa.Table:
    """Return rows as a table, with ids as plain strings; columns that they lack are NULL.

    Raises:
        ValueError: a row has a column that the table does not have.
    """
    clean = plain(list(rows))
    if unknown := {name for row in clean for name in row} - set(table.schema.names):
        raise ValueError(f"{table.name} has no column {', '.join(sorted(unknown))}")
    return pa.Table.from_pylist(clean, _without_ids(table.schema))


def misfit(entry: Entry) -> str | None:
    """Return why an entry does not fit the tables, None where it does."""
    try:
        for name, rows in entry.items():
            table_of(TABLES[name], rows)
    except (pa.ArrowException, ValueError, TypeError, OverflowError) as error:
        return f"its rows do not fit the tables: {error}"
    return None


def _without_ids(schema: pa.Schema) -> pa.Schema:
    """Return a schema with strings in place of dictionaries, which can be sorted and joined."""
    fields = [each.with_type(pa.string()) if each.type == ID else each for each in schema]
    return pa.schema(fields)


def _read(
    folder: Place, table: Table, files: Sequence[str], columns: Sequence[str] | None = None
) -> pa.Table:
    whole = table.schema
    names = whole.names if columns is None else list(columns)
    schema = pa.schema([whole.field(name) for name in names])
    found = []
    for name in files:
        try:
            # A file of an older version may lack a column: it is NULL.
            with opened(folder, name) as stream, pq.ParquetFile(stream) as file:
                has = set(file.schema_arrow.names)
                part = file.read([each for each in names if each in has])
        except (OSError, pa.ArrowException) as error:
            raise SourceError(f"{folder / name} cannot be read: {error}") from error
        for column in schema:
            if column.name not in has:
                part = part.append_column(column, pa.nulls(len(part), column.type))
        found.append(part.select(names).cast(schema))
    return pa.concat_tables(found) if found else schema.empty_table()


def _logs(folder: Place, before: ReadRow, by_path: Mapping[str, Entry]) -> pa.Table:
    """Return the table ``logs``, in which the logs of ``by_path`` replace older rows."""
    table = TABLES["logs"]
    files = [each["path"] for each in before["tables"].get("logs", {"files": []})["files"]]
    old = _read(folder, table, files).cast(_without_ids(table.schema))
    old = old.filter(pc.invert(pc.is_in(old["path"], pa.array(list(by_path), pa.string()))))
    new = table_of(table, [entry["logs"][0] for entry in by_path.values()])
    return pa.concat_tables([old, new])


def _owners(logs: pa.Table, by_path: Mapping[str, Entry]) -> dict[str, Entry]:
    """Return, by the hash of their log, the new entries whose rows represent the log.

    If several files have the same hash, the first by path represents the log; an MCAP does so only
    if there is no other file. So the result does not depend on the order of the runs.
    """
    new = {entry["logs"][0].get("log_sha256") for entry in by_path.values()} - {None}
    alike = logs.filter(pc.is_in(logs["log_sha256"], pa.array(list(new), pa.string())))
    owner: dict[str, tuple[bool, str]] = {}
    for row in alike.select(["log_sha256", "kind", "path"]).to_pylist():
        rank = row["kind"] == "mcap", row["path"]
        owner[row["log_sha256"]] = min(rank, owner.get(row["log_sha256"], rank))
    return {sha: by_path[path] for sha, (_, path) in owner.items() if path in by_path}


def _merged(
    folder: Place,
    table: Table,
    files: Sequence[ReadRow],
    new: Sequence[ReadRow],
    replaced: Iterable[str],
    is_alive: set[str],
    generation: int,
) -> list[Row]:
    """Return the files of one table after the merge; those that change are written again.

    The old rows of a log are removed if its hash is in ``replaced`` or not in ``is_alive``.
    """
    rows_of: dict[str, list[ReadRow]] = {}
    for row in new:
        rows_of.setdefault(_month(row.get("date")), []).append(row)
    files_of: dict[str, list[ReadRow]] = {}
    for file in files:
        files_of.setdefault(month_of(file["path"]), []).append(file)
    keeps = pa.array(sorted(is_alive - set(replaced)), pa.string())
    after: list[Row] = []
    for month in sorted({*rows_of, *files_of}):
        place = f"{table.name}/month={month}"
        parts = [table_of(table, rows_of.get(month, []))]
        for file in files_of.get(month, []):
            shas = _read(folder, table, [file["path"]], ["log_sha256"])["log_sha256"]
            kept = pc.is_in(shas.cast(pa.string()), keeps)
            is_whole = bool(pc.all(kept).as_py()) and file["path"].startswith(f"{place}/")
            if is_whole and (month not in rows_of or 2 * file["rows"] >= MOST_ROWS):
                after.append(dict(file))
                continue
            parts.append(_read(folder, table, [file["path"]]).filter(kept).cast(parts[0].schema))
        if rows := pa.concat_tables(parts):
            after += _write(folder, table, place, rows, generation)
    return after


def _write(folder: Place, table: Table, place: str, rows: pa.Table, generation: int) -> list[Row]:
    """Write sorted rows as files of at most ``MOST_ROWS``; return their entries in the manifest."""
    rows = rows.sort_by([(name, "ascending") for name in table.order]).cast(table.schema)
    files = []
    for i, first in enumerate(range(0, len(rows), MOST_ROWS)):
        name = f"{place}/part-{generation:06d}-{i}.parquet"
        path = folder / NEW / name
        piece = rows.slice(first, MOST_ROWS)
        if isinstance(path, Path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("wb") as stream:
                pq.write_table(piece, stream, compression="zstd")
                sync(stream)
        else:
            whole = io.BytesIO()
            pq.write_table(piece, whole, compression="zstd")
            path.write_bytes(whole.getvalue())
        files.append({"path": name, "rows": len(piece)})
    return files


def _month(date_us: int | None) -> str:
    if date_us is None:
        return NO_MONTH
    return str(pa.scalar(date_us, TIME).as_py().strftime("%Y-%m"))


def _json(content: ReadRow) -> bytes:
    return json.dumps(content, indent=1).encode() + b"\n"


def _manifest(tables: Mapping[str, list[Row]], logs: pa.Table, generation: int) -> Row:
    counted = pc.value_counts(logs["outcome"]).to_pylist()
    return {
        "format": FORMAT,
        "generation": generation,
        "outcomes": {each["values"]: each["counts"] for each in counted},
        "tables": {
            name: {"rows": sum(file["rows"] for file in files), "files": files}
            for name, files in tables.items()
        },
    }
