"""A data set that is nested thousands deep: one line, and the exit code of its kind."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import pytest
from places import REPLAY_LOGS

from yawid.cli.main import main
from yawid.dataset.files import DATABASE, DataSet

DEEP = 100_000


@pytest.mark.parametrize("depth", [1_500, DEEP])
def test_a_data_set_whose_rows_are_nested_too_deeply_is_one_line_and_exit_code_6(
    depth: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs, data = tmp_path / "logs", tmp_path / "data"
    logs.mkdir()
    shutil.copy(REPLAY_LOGS / "no_rudder" / "log.tlog", logs / "a.tlog")
    with DataSet(data):
        pass
    database = sqlite3.connect(data / DATABASE)
    database.execute("INSERT INTO rows VALUES ('/b', 'logs', ?)", ["[" * depth + "]" * depth])
    database.commit()
    database.close()

    assert main(["fleet", str(logs), "--out", str(data), "--workers", "1"]) == 6
    assert DATABASE in capsys.readouterr().err.splitlines()[-1]
