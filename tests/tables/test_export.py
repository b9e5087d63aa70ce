"""``yawid export``: what others read in the file, and what they do not have to guess."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from finished_runs import replayed
from flights.surgery import join, split
from places import C172P

import yawid
import yawid.sinks.mcap.reader
from yawid.cli.main import main
from yawid.tables.run import Run


@pytest.fixture(scope="module")
def mcap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    options = ("--also", "none", "--manoeuvres", "off", "--rudder-max-deg", 25)
    return replayed(C172P, folder, "--rate", 10, *options)


@pytest.fixture(scope="module")
def run(mcap: Path) -> Run:
    return yawid.load(mcap)


@pytest.fixture(autouse=True)
def many_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a short run one of many blocks and groups."""
    monkeypatch.setattr(yawid.sinks.mcap.reader, "BLOCK_ROWS", 100)


Contents = tuple[dict[str, list[Any]], dict[str, str]]
"""Columns and units by name."""


def in_parquet(path: Path) -> Contents:
    table = pq.read_table(path)
    columns = {name: table[name].to_numpy().tolist() for name in table.column_names}
    return columns, {field.name: field.metadata[b"unit"].decode() for field in table.schema}


def in_csv(path: Path) -> Contents:
    assert b"\r" not in path.read_bytes()
    with path.open(encoding="utf-8", newline="") as stream:
        names, units, *rows = csv.reader(stream)
    columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
    times = [cell.removesuffix("Z") or "NaT" for cell in columns["time"]]
    columns["time"] = np.array(times, "M8[ns]").tolist()
    return columns, dict(zip(names, units, strict=True))


def in_npz(path: Path) -> Contents:
    with np.load(path, allow_pickle=False) as found:
        columns = {name: column.tolist() for name, column in found.items()}
    units = json.loads(columns.pop("units"))
    assert json.loads(columns.pop("facts"))["method"] == "els"
    return columns, units


def known(values: list[Any], kind: str) -> list[Any]:
    """The values, with None for what is unknown; a number may be text."""
    told = [None if each in (None, "") or each != each else each for each in values]
    return [each and float(each) for each in told] if kind == "f" else told


@pytest.mark.parametrize("read", [in_parquet, in_csv, in_npz])
def test_a_table_has_every_number_to_the_bit_its_unit_and_nothing_for_the_unknown(
    read: Callable[[Path], Contents], mcap: Path, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / f"run.{read.__name__.removeprefix('in_')}"
    assert main(["export", str(mcap), "-o", str(out)]) == 0

    columns, units = read(out)
    assert [*columns] == list(run.record)
    held = {} if read == in_npz else {"rudder": "rad nose-right held"}  # which a record must say
    assert units == run.record.units | held
    for name, column in columns.items():
        ours = run.record[name]
        assert known(column, ours.dtype.kind) == known(ours.tolist(), ours.dtype.kind), name


def test_parquet_has_null_for_the_unknown_and_says_whose_run_it_is(mcap: Path, run: Run) -> None:
    assert main(["export", str(mcap)]) == 0

    file = pq.ParquetFile(mcap.with_suffix(".parquet"))
    found = file.read()
    assert file.metadata.num_row_groups == 12
    unknown = [known(run.record[name].tolist(), "").count(None) for name in run.record]
    assert [column.null_count for column in found.columns] == unknown
    facts = {name.decode(): text.decode() for name, text in found.schema.metadata.items()}
    assert facts["log_sha256"] == run.summary.sha256
    assert facts["sign"].startswith("positive rudder = nose right")
    names = ("log", "rudder_unit", "orders", "method", "autopilot")
    assert [facts[name] for name in names] == [str(C172P), "rad", "3,3,2,1", "els", "ArduPilot"]


def test_of_a_torn_run_no_half_of_a_table_is_left(
    mcap: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn, data = tmp_path / "torn.mcap", bytearray(mcap.read_bytes())
    data[data.index(b"zstd", len(data) // 3) + 200] ^= 255  # found when some rows are written
    torn.write_bytes(data)

    assert main(["export", str(torn), "-o", str(tmp_path / "torn.csv")]) == 6
    assert "what is left of it" in capsys.readouterr().err
    assert [*tmp_path.iterdir()] == [torn]


def test_the_time_of_a_log_without_a_date_is_unknown_and_not_1970(tmp_path: Path) -> None:
    records = split(C172P.read_bytes())
    undated = join((stamp - records[0][0], frame) for stamp, frame in records)
    (tmp_path / "flight.tlog").write_bytes(undated)
    options = ("--rate", 10, "--also", "none", "--manoeuvres", "off")
    mcap = replayed(tmp_path / "flight.tlog", tmp_path / "out", *options)
    assert main(["export", str(mcap)]) == main(["export", str(mcap), "-o", f"{mcap}.csv"]) == 0

    table = pq.read_table(mcap.with_suffix(".parquet"))
    assert len(table) > 100
    assert table["time"].null_count == len(table)
    assert table["t"].null_count == 0
    with Path(f"{mcap}.csv").open(encoding="utf-8", newline="") as stream:
        head, _, *rows = csv.reader(stream)
    assert {row[head.index("time")] for row in rows} == {""}
