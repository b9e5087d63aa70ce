"""A configuration as TOML: any text in it comes back, and its lines stay as files have them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.config.settings import check_settings
from yawid.sinks.mcap.reader import open_run


@given(columns=st.lists(st.text(), max_size=3), rate=st.floats(0.1, 1000.0))
def test_whatever_a_column_is_called_its_configuration_comes_back(
    columns: list[str], rate: float
) -> None:
    config = RunConfig(columns=tuple(columns), rate=rate, band=(0.1, 3.0))
    read = tomllib.loads(config.to_toml())

    assert read["columns"] == columns
    assert "sysid" not in read  # which is not given
    assert RunConfig(**check_settings(read, "here")) == config


def test_a_run_of_a_column_with_a_line_feed_in_its_name_can_be_replayed_from_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = [0.05 * k for k in range(400)]
    moves = {"t": t, "rudder": [k % 7 / 10 for k in range(400)], "ra\nte": [0.1] * 400}
    pq.write_table(pa.table(moves), tmp_path / "a.parquet")
    named = ["--columns", "r=ra\nte[rad/s]", "--rudder-unit", "half-travel"]
    main(["replay", str(tmp_path / "a.parquet"), "--out", str(tmp_path), *named])

    assert open_run(tmp_path / "a.mcap").config.columns == ("r=ra\nte[rad/s]",)
    assert main(["replay", str(tmp_path / "a.mcap"), "--out", str(tmp_path / "again")]) in (0, 5)
    assert capsys.readouterr().err == ""
