"""Records with damage in them, or too large: unknown where it is, or one line before it is read."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hostile import run_limited

import yawid.sources.records.record as records
from yawid.cli.main import main
from yawid.errors import SourceError
from yawid.sources.records.find_columns import Asked
from yawid.sources.records.record import Record

T = np.arange(0.0, 30.0, 0.05)
PER_S = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
RIGHT = "--rudder-sign", "nose-right"


def written(path: Path, column: str, cells: list[Any]) -> Path:
    rows = zip(T, np.sin(T), np.cos(T), cells, strict=True)
    lines = [f"{t:.2f},{u:.3f},{r:.3f},{cell}" for t, u, r, cell in rows]
    path.write_text("\n".join([f"t,rudder_deg,r_deg_s,{column}", *lines]) + "\n", encoding="utf-8")
    return path


HALF = len(T) // 2
HUGE = [1e308] * HALF + [(1e308, -1e308, 1.0)[i % 3] for i in range(len(T) - HALF)]
"""Numbers that are alike, so that a sum of them overflows, and then a difference does."""
COLUMNS = (
    *("altitude", "aileron [half-travel]", "roll [rad]", "yaw [rad]", "q [rad/s]", "mode"),
    *("turn_rate [rad/s]", "ground_speed", "on_ground", "pitch [rad]"),
)
DIGITS = "²", "٣", "9" * 400, "AUTO\u0660"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("column", "cells"),
    [
        *((column, HUGE) for column in COLUMNS),
        *(("mode", ["7", mode, ""] * (len(T) // 3)) for mode in DIGITS),
    ],
)
def test_a_number_that_cannot_be_is_unknown_a_mode_of_other_digits_a_name_and_no_warning_is_made(
    column: str, cells: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "a.csv", column, cells)

    assert main(["replay", str(path), "--out", str(tmp_path), *RIGHT, "--json"]) in (0, 5)
    told = capsys.readouterr()
    assert told.err == ""
    assert "e+30" not in told.out
    assert json.loads(told.out)["log"] == str(path)


@pytest.mark.parametrize("column", ["t", "time"])
@pytest.mark.parametrize("unit", PER_S)
def test_a_date_of_another_age_is_refused_with_its_row(
    column: str, unit: str, tmp_path: Path
) -> None:
    t = np.arange(60.0)
    year = 1500 if unit != "ns" else 1960
    dates = [datetime(2024, 5, 1) + timedelta(seconds=each) for each in t]  # noqa: DTZ001 # Parquet's own has no zone
    dates[7] = datetime(year, 1, 1)  # noqa: DTZ001 # the same
    typed = pa.array(dates, pa.timestamp("us")).cast(f"timestamp[{unit}]")
    columns = {"rudder_deg": np.sin(t), "r_deg_s": np.cos(t)} | {"t": t} | {column: typed}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")

    with pytest.raises(SourceError, match=rf"row 8, column \d \({column}\): {year}-01-01"):
        Record(tmp_path / "a.parquet").settle(Asked(rudder_sign="nose-right"))


@pytest.mark.parametrize("unit", PER_S)
def test_dates_of_our_time_are_to_the_nanosecond_what_they_were(unit: str, tmp_path: Path) -> None:
    start_s = 1_714_521_600  # 2024-05-01
    ticks = start_s * PER_S[unit] + np.arange(9)
    pq.write_table(pa.table({"t": pa.array(ticks, pa.timestamp(unit))}), tmp_path / "a.parquet")
    found = Record(tmp_path / "a.parquet")._table.dates_ns(0)

    expected = start_s * 10**9 + np.arange(9) * (10**9 // PER_S[unit])
    np.testing.assert_array_equal(found, expected)


CODE = (
    "from yawid.cli.main import main\n"
    "assert main(['replay', sys.argv[1], '--out', sys.argv[2], '--rudder-sign', 'nose-right', "
    "'--manoeuvres', 'off', '--also', 'none']) in (0, 5)"
)


def of_rows(path: Path, rows: int) -> Path:
    """Write a record of 50 rows a second, a hundred thousand at a time."""
    with path.open("w", encoding="utf-8") as file:
        file.write("t,rudder_deg,r_deg_s\n")
        for first in range(0, rows, 100_000):
            t = 0.02 * np.arange(first, min(first + 100_000, rows))
            np.savetxt(file, np.column_stack([t, np.sin(2.0 * t), np.cos(2.0 * t)]), "%.3f", ",")
    return path


@pytest.mark.long
@pytest.mark.parametrize(("rows", "megabytes"), [(10**6, 230), (10**7, 1000)])
def test_a_million_rows_take_230_mb_more_than_the_help_page_and_ten_a_gigabyte(
    rows: int, megabytes: int, tmp_path: Path
) -> None:
    page = (
        "from yawid.cli.main import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass"
    )
    most = int(run_limited(page, 1000).stdout.split()[-1]) + megabytes
    run_limited(CODE, most, of_rows(tmp_path / "a.csv", rows), tmp_path, within_s=900)


def test_a_hundred_million_rows_in_a_megabyte_are_refused_before_they_are_read(
    tmp_path: Path,
) -> None:
    zeros = pa.table(dict.fromkeys(("t", "rudder_deg", "r_deg_s"), pa.nulls(10_000_000)))
    with pq.ParquetWriter(tmp_path / "a.parquet", zeros.schema, compression="zstd") as writer:
        for _ in range(10):
            writer.write_table(zeros, row_group_size=10_000_000)
    assert (tmp_path / "a.parquet").stat().st_size < 2_000_000

    done = run_limited(
        "from yawid.cli.main import main\nassert main(['inspect', sys.argv[1]]) == 6",
        300,
        tmp_path / "a.parquet",
    )
    assert "100000000 rows of 3 columns are more than the 1e+08 numbers" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_csv_of_too_many_lines_is_refused_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = of_rows(tmp_path / "a.csv", 1000)
    with path.open("a", encoding="utf-8") as file:
        file.write("this line would be refused\n")
    monkeypatch.setattr(records, "MOST_NUMBERS", 3000)
    with pytest.raises(SourceError, match=r"100[0-9] rows of 3 columns are more .*split it into"):
        Record(path).settle(Asked(rudder_sign="nose-right"))
    monkeypatch.setattr(records, "MOST_NUMBERS", 4000)
    with pytest.raises(SourceError, match="line 1002: 1 cells, the header has 3"):
        Record(path).settle(Asked(rudder_sign="nose-right"))


def test_a_line_without_an_end_takes_no_memory(tmp_path: Path) -> None:
    with (tmp_path / "a.csv").open("wb") as file:
        file.write(b"t,rudder_deg,r_deg_s\n0,1,1\n0.02,1,1\n")
        for _ in range(100):
            file.write(b"0,1," * (1 << 18))

    done = run_limited(
        "from yawid.cli.main import main\nassert main(['inspect', sys.argv[1]]) == 6",
        150,
        tmp_path / "a.csv",
    )
    assert "is not a CSV" in done.stderr


@pytest.mark.parametrize("rows", [8191, 8192, 8193, 20_000])
def test_numbers_modes_and_dates_are_the_same_wherever_a_piece_ends_and_they_begin(
    rows: int, tmp_path: Path
) -> None:
    late, date = 9 * rows // 20, "2024-05-01T00:00:01Z"
    modes = [""] * late + ["AUTO" if k % 2 else "7" for k in range(late, rows)]
    cells = [(f"{k / 50}", f"{k % 97 / 7:.3f}", "1", mode, "") for k, mode in enumerate(modes)]
    lines = [",".join((*row, date if k >= late else "")) for k, row in enumerate(cells)]
    text = "\n".join(["t,rudder_deg,r_deg_s,mode,x,time", *lines, ""])
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    table = Record(tmp_path / "a.csv")._table
    table.load([0, 1, 3, 5])

    for column in (0, 1):
        expected = [float(row[column]) for row in cells]
        np.testing.assert_array_equal(table.numbers(column), expected)
    texts, row_has = table.words(3)
    assert [texts[i] for i in row_has] == modes
    unknown = np.iinfo(np.int64).min
    ns = [unknown] * late + [1_714_521_601 * 10**9] * (rows - late)
    np.testing.assert_array_equal(table.dates_ns(5), ns)
    assert table.line(rows - 1) == f"line {rows + 1}"
