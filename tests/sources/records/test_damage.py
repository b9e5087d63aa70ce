"""Records with damage in them: unknown where it is, or one line; no traceback, no NumPy warning."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

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


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "column",
    [
        *("altitude", "aileron [half-travel]", "roll [rad]", "yaw [rad]", "q [rad/s]", "mode"),
        *("turn_rate [rad/s]", "ground_speed", "on_ground", "pitch [rad]"),
    ],
)
def test_a_number_that_cannot_be_is_unknown_and_makes_no_warning(
    column: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    half = len(T) // 2  # alike, so that a sum of them overflows, then a difference does
    cells = [1e308] * half + [(1e308, -1e308, 1.0)[i % 3] for i in range(len(T) - half)]
    path = written(tmp_path / "a.csv", column, cells)

    assert main(["replay", str(path), "--out", str(tmp_path), *RIGHT, "--json"]) in (0, 5)
    told = capsys.readouterr()
    assert told.err == ""
    assert "e+30" not in told.out


@pytest.mark.parametrize("mode", ["²", "٣", "9" * 400, "AUTO\u0660"])
def test_a_mode_of_other_digits_is_a_name(
    mode: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "a.csv", "mode", ["7", mode, ""] * (len(T) // 3))
    assert main(["replay", str(path), "--out", str(tmp_path), *RIGHT, "--json"]) in (0, 5)
    assert json.loads(capsys.readouterr().out)["log"] == str(path)


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
