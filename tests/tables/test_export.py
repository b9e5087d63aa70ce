"""``yawid export``: what others read in the file, and what they do not have to guess."""

from __future__ import annotations

import csv
import json
from pathlib import Path

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


def unknown(values: np.ndarray) -> np.ndarray:
    return np.array([each is None or each != each for each in values])


def test_parquet_has_every_number_its_unit_and_null_for_the_unknown(mcap: Path, run: Run) -> None:
    assert main(["export", str(mcap)]) == 0

    file = pq.ParquetFile(mcap.with_suffix(".parquet"))
    found = file.read()
    assert file.metadata.num_row_groups == 12
    assert found.column_names == list(run.record)
    for name, values in zip(found.column_names, found.columns, strict=True):
        ours = run.record[name]
        assert values.null_count == np.count_nonzero(unknown(ours)), name
        known = values.to_numpy()[~unknown(ours)]
        assert known.tolist() == ours[~unknown(ours)].tolist(), name
    assert found.schema.field("r").metadata[b"unit"] == b"rad/s"
    facts = {name.decode(): text.decode() for name, text in found.schema.metadata.items()}
    assert facts["log"] == str(C172P)
    assert facts["log_sha256"] == run.summary.sha256
    assert facts["sign"].startswith("positive rudder = nose right")
    assert [facts[name] for name in ("rudder_unit", "orders", "method", "autopilot")] == [
        "rad", "3,3,2,1", "els", "ArduPilot",
    ]  # fmt: skip


def test_csv_has_a_row_of_units_and_numbers_that_come_back_to_the_bit(
    mcap: Path, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "run.csv"
    assert main(["export", str(mcap), "-o", str(out)]) == 0

    data = out.read_bytes()
    names, units, *rows = csv.reader(data.decode().splitlines())
    assert b"\r" not in data
    assert names == list(run.record)
    held = {"rudder": "rad nose-right held"}  # which a record must say
    assert dict(zip(names, units, strict=True)) == run.record.units | held
    assert len(rows) == len(run.record)
    for name, column in zip(names, zip(*rows, strict=True), strict=True):
        ours = run.record[name]
        assert [cell == "" for cell in column] == unknown(ours).tolist(), name
        if ours.dtype == float:
            np.testing.assert_array_equal([float(cell or "nan") for cell in column], ours)
        elif ours.dtype == object:
            assert [cell or None for cell in column] == ours.tolist()


def test_npz_needs_no_pickle(mcap: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "run.npz"
    assert main(["export", str(mcap), "-o", str(out)]) == 0

    with np.load(out, allow_pickle=False) as found:
        np.testing.assert_array_equal(found["wn"], run.record.wn)
        assert [each or None for each in found["held"].tolist()] == run.record.held.tolist()
        assert json.loads(str(found["units"]))["wn"] == "rad/s"
        assert json.loads(str(found["facts"]))["method"] == "els"


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
