"""How much memory a record takes, and that too large a one is refused before it is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hostile import run_limited

import yawid.sources.records.record as records
from yawid.errors import SourceError
from yawid.sources.records.find_columns import Asked
from yawid.sources.records.record import Record

CODE = (
    "from yawid.cli.main import main\n"
    "assert main(['replay', sys.argv[1], '--out', sys.argv[2], '--rudder-sign', 'nose-right', "
    "'--manoeuvres', 'off', '--also', 'none']) in (0, 5)"
)


def written(path: Path, rows: int) -> Path:
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
    run_limited(CODE, most, written(tmp_path / "a.csv", rows), tmp_path, within_s=900)


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
    path = written(tmp_path / "a.csv", 1000)
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
def test_a_number_is_the_same_wherever_a_piece_ends(rows: int, tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", rows)
    record = Record(path)
    record._table.load([0, 1])

    t, rudder = np.loadtxt(path, delimiter=",", skiprows=1, usecols=(0, 1), unpack=True)
    np.testing.assert_array_equal(record._table.numbers(0), t)
    np.testing.assert_array_equal(record._table.numbers(1), rudder)
    assert record._table.line(rows - 1) == f"line {rows + 1}"


def test_modes_and_dates_are_understood_from_whichever_piece_they_begin_in(tmp_path: Path) -> None:
    rows = [f"{k / 50},1,1,{'' if k < 9000 else 'AUTO' if k % 2 else 7},," for k in range(20_000)]
    rows = [row + ("" if k < 9000 else "2024-05-01T00:00:01Z") for k, row in enumerate(rows)]
    (tmp_path / "a.csv").write_text(
        "t,rudder_deg,r_deg_s,mode,x,time\n" + "\n".join(rows) + "\n", encoding="utf-8"
    )
    table = Record(tmp_path / "a.csv")._table
    table.load([3, 5])
    texts, row_has = table.words(3)
    assert [texts[i] for i in row_has] == [r.split(",")[3] for r in rows]
    dates = table.dates_ns(5)
    assert dates is not None
    assert set(dates[:9000].tolist()) == {np.iinfo(np.int64).min}
    assert set(dates[9000:].tolist()) == {1_714_521_601 * 10**9}
