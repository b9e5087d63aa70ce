"""Writing and reading Rerun recordings for the tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import rerun_cli
from rerun.chunk import RrdReader

# The command beside the interpreter is a script that waits for this one.
VIEWER = str(Path(rerun_cli.__file__).with_name("rerun"))


def fail(text: str) -> None:
    pytest.fail(f"warned: {text}")


def recorded(path: Path) -> dict[str, dict[str, Any]]:
    """Columns of each entity over time, its chunks joined in the file's order; times in ns."""
    entities: dict[str, dict[str, list[Any]]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if not chunk.is_static:
            columns = _columns(chunk)
            entity = entities.setdefault(chunk.entity_path, {})
            for name, values in columns.items():
                entity.setdefault(name, []).extend(values)
    return entities


def _columns(chunk: Any) -> dict[str, list[Any]]:
    # Times as numbers: as Python's own they are too coarse, and as pandas' they ask for pandas.
    batch = chunk.to_record_batch()
    return {
        name: (column.cast("int64") if pa.types.is_temporal(column.type) else column).to_pylist()
        for name, column in zip(batch.schema.names, batch.columns, strict=True)
    }


def statics(path: Path, entity: str, component: str) -> list[Any]:
    return [
        row
        for chunk in RrdReader(path).stream().to_chunks()
        if chunk.is_static and chunk.entity_path == entity
        for row in _columns(chunk)[component]
    ]


def values(entities: dict[str, dict[str, Any]], entity: str) -> Any:
    columns = entities[entity]
    order = np.argsort(columns["boot_time"], kind="stable")
    return np.array(columns["Scalars:scalars"])[order]
