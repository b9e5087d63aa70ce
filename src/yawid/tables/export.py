"""``yawid export``: a run's samples and results in one file for other programs, and for yawid.

The columns are those of a record and the results (:func:`yawid.tables.columns.record_columns`).
Their units are the fields' metadata in Parquet, a second row in CSV, and JSON in .npz. Files are
written block by block, so that a long run needs no more memory than a short one, except .npz,
which needs all of it, and the lateral motion, if the run kept it.
"""

import json
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq

from yawid.errors import ConfigError, SourceError
from yawid.sinks.mcap.reader import McapRun, open_answered
from yawid.system.part_file import written_whole
from yawid.tables.columns import Units, manoeuvre_columns, mode_columns, record_columns
from yawid.tables.table import Column, arrow_table, filled, unit_of
from yawid.version import __version__

FORMATS: Final = (".parquet", ".csv", ".npz")
Tables = Iterator[list[Column]]
"""A run's columns in groups of rows; there is at least one row."""
_NO_HEADER: Final = pyarrow.csv.WriteOptions(include_header=False)


def check_name(out: Path) -> None:
    """Check the name of a file to be written.

    Raises:
        ConfigError: its suffix is not one of ``FORMATS``.
    """
    if out.suffix not in FORMATS:
        raise ConfigError(f"--out {out}: the name must end in {', '.join(FORMATS)}")


def export(mcap: Path, out: Path, what: str = "samples", *, force: bool = False) -> Path:
    """Write a run's samples and results to ``out``; return its absolute path.

    ``what`` may also be its manoeuvres or its modes.

    Raises:
        SourceError: the MCAP cannot be read, is damaged, or has nothing of it.
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """
    run = open_answered(mcap)
    blocks = run.blocks()
    first = next(blocks, None)
    if run.grid is None or first is None:
        raise SourceError(f"{mcap} holds no sample: there is nothing to export")
    known = Units(run.grid, run.config)
    motion = run.motion() if what == "samples" else None
    groups = chain([first], blocks)
    tables: Tables = (record_columns(rows, known, motion) for rows in groups)
    if what == "modes":
        tables = ([*mode_columns(rows, known)] for rows in groups)
    elif what == "manoeuvres":
        if not run.summary.manoeuvres:
            raise SourceError(f"{mcap} holds no manoeuvre: there is nothing to export")
        tables = iter([[*manoeuvre_columns(run.summary, known)]])
    with written_whole(out, force=force) as stream:
        _WRITERS[out.suffix](stream, tables, facts_of(run, known))
    return out.absolute()


def facts_of(run: McapRun, known: Units) -> dict[str, str]:
    """Return the facts that hold for all rows: their origin, the model and the verdict."""
    summary, config, grid = run.summary, run.config, known.grid
    source, vehicle = summary.source or summary.own_source, summary.vehicle
    facts = {
        "yawid_version": run.metadata.get("versions", {}).get("yawid", __version__),
        "log": source.log,
        "log_sha256": source.sha256,
        "vehicle": vehicle and vehicle.type_name,
        "autopilot": vehicle and vehicle.autopilot_name,
        "rudder_unit": known.grid.rudder_unit,
        "sign": run.metadata.get("sign", {}).get("text"),
        "output": config.output,
        "sample_time_s": repr(grid.sample_time_s),
        "orders": ",".join(map(str, config.orders)),
        "method": grid.methods[0],
        "usable": str(summary.deciding.usable).lower(),
        "reasons": " ".join(reason.id for reason in summary.deciding.reasons),
        "configuration": config.to_toml(),
    }
    return {name: fact for name, fact in facts.items() if fact}


def _parquet(stream: BinaryIO, tables: Tables, facts: dict[str, str]) -> None:
    rows = arrow_table(next(tables), facts)
    with pq.ParquetWriter(stream, rows.schema, compression="zstd") as writer:
        writer.write_table(rows)
        for columns in tables:
            writer.write_table(arrow_table(columns, facts))


def _csv(stream: BinaryIO, tables: Tables, facts: dict[str, str]) -> None:
    first = next(tables)
    heads = [column.name for column in first], [unit_of(column) for column in first]
    stream.write("".join(f"{','.join(head)}\n" for head in heads).encode())
    for columns in chain([first], tables):
        pyarrow.csv.write_csv(arrow_table(columns, facts), stream, _NO_HEADER)


def _npz(stream: BinaryIO, tables: Tables, facts: dict[str, str]) -> None:
    parts = list(tables)
    arrays: dict[str, Any] = {}
    for pieces in zip(*parts, strict=True):
        values = np.concatenate([piece.values for piece in pieces])
        arrays[pieces[0].name] = filled(values)  # NumPy could save objects only by pickle
    units = {column.name: column.unit for column in parts[0]}
    np.savez_compressed(stream, units=json.dumps(units), facts=json.dumps(facts), **arrays)


_WRITERS: Final = {".parquet": _parquet, ".csv": _csv, ".npz": _npz}
