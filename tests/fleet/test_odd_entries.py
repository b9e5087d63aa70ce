"""What a folder of logs may hold that is no log: it costs its own row, and no other log's."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from places import REPLAY_LOGS

from yawid.cli.main import main

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no such names and devices there")
LOG = REPLAY_LOGS / "no_rudder" / "log.tlog"
LATIN1 = b"caf\xe9.tlog"


def rows_of(data: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of a data set's table of logs by file name, as any program reads them."""
    return {Path(row["path"]).name: row for row in pq.read_table(data / "logs.parquet").to_pylist()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log, a link to one, a name in Latin 1, a dangling link, a loop, a FIFO, a device."""
    logs = tmp_path_factory.mktemp("odd") / "logs"
    logs.mkdir()
    shutil.copy(LOG, logs / "a.tlog")
    (logs / "linked.tlog").symlink_to(LOG)
    shutil.copy(LOG, logs / os.fsdecode(LATIN1))
    (logs / "dangling.tlog").symlink_to("nowhere")
    (logs / "loop.tlog").symlink_to("loop.tlog")
    os.mkfifo(logs / "fifo.tlog")
    (logs / "zero.tlog").symlink_to("/dev/zero")
    return logs


@pytest.fixture(scope="module", params=["", "*.tlog"], ids=["folder", "glob"])
def data(request: pytest.FixtureRequest, folder: Path, tmp_path_factory: Any) -> Path:
    """The data set of that folder, made by a fleet, whose exit code is that of failed logs."""
    out: Path = tmp_path_factory.mktemp("data") / "data"
    logs = str(folder / request.param) if request.param else str(folder)
    assert main(["fleet", logs, "--out", str(out), "--workers", "1", "--timeout", "60"]) == 6
    return out


def test_what_cannot_be_read_as_a_file_is_failed_and_the_logs_next_to_it_have_their_rows(
    data: Path,
) -> None:
    rows = rows_of(data)
    outcomes = {name: row["outcome"] for name, row in rows.items()}
    assert outcomes == {
        "a.tlog": "unusable",
        "linked.tlog": "unusable",
        r"caf\udce9.tlog": "failed",
        "dangling.tlog": "failed",
        "loop.tlog": "failed",
        "fifo.tlog": "failed",
        "zero.tlog": "failed",
    }
    assert "No such file" in rows["dangling.tlog"]["text"]
    assert "symbolic links" in rows["loop.tlog"]["text"]
    for name in ("fifo.tlog", "zero.tlog"):
        assert rows[name]["text"] == "it is not a regular file: only those are read"


def test_a_name_that_is_not_utf_8_is_escaped_in_the_table_and_on_the_terminal(
    data: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row = rows_of(data)[r"caf\udce9.tlog"]
    assert row["text"] == "its name is not UTF-8: rename the file or its folder"
    assert row["path"] == str(folder / r"caf\udce9.tlog")

    again = ["fleet", str(folder), "--out", str(data), "--workers", "1"]
    assert main(again) == 6
    said = capsys.readouterr()
    assert "5 logs to run, 2 known already" in said.err  # what failed is tried again
    assert (said.out + said.err).isascii()


@pytest.mark.parametrize("command", ["replay", "inspect"])
@pytest.mark.parametrize("name", ["fifo.tlog", "zero.tlog", "dangling.tlog", "."])
def test_one_such_entry_given_by_itself_is_one_line_and_exit_code_6(
    folder: Path,
    command: str,
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([command, str(folder / name)]) == 6
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
