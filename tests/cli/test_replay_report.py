"""``yawid replay --report``: the answer, and its page written and opened."""

from __future__ import annotations

import json
import os
import pty
import stat
import sys
from pathlib import Path

import pytest
from places import C172P, REPLAY_LOGS

from yawid.cli.main import main

NO_RUDDER = REPLAY_LOGS / "no_rudder" / "log.tlog"


def test_a_report_comes_after_the_answer_and_one_that_cannot_be_written_is_a_line(
    tmp_path: Path, capsys
) -> None:
    (tmp_path / "log.html").write_text("mine", encoding="utf-8")

    replay = ["replay", str(C172P), "--report", "--out", str(tmp_path), "--rate=10", "--to=80"]
    assert main(replay) == 6
    said = capsys.readouterr()
    assert "verdict  usable" in said.out
    assert "log.html exists: --force overwrites it" in said.err
    assert (tmp_path / "log.html").read_text(encoding="utf-8") == "mine"
    (tmp_path / "log.html").unlink()
    assert main([*replay, "--json"]) == 0  # the files of the same log are replaced
    said = capsys.readouterr()
    assert json.loads(said.out)["files"]["mcap"] == str(tmp_path / "log.mcap")
    assert said.err.endswith(f"yawid: report: {tmp_path / 'log.html'}\n")


@pytest.mark.parametrize("logs", [1, pytest.param(2, marks=pytest.mark.long)])
def test_on_a_terminal_one_log_s_report_is_opened_and_the_code_is_the_verdict_s(
    tmp_path: Path, logs: int
) -> None:
    """In a terminal of its own, with a browser that writes down what it is to show."""
    browser, shown = tmp_path / "browser", tmp_path / "shown"
    browser.write_text(f'#!/bin/sh\necho "$1" > {shown}\n', encoding="utf-8")
    browser.chmod(stat.S_IRWXU)
    words = ["replay", *[str(NO_RUDDER)] * logs, "--report", "--out", str(tmp_path)]
    child, terminal = pty.fork()
    if child == 0:
        os.environ["BROWSER"] = f"{browser} %s"
        os.execv(sys.executable, [sys.executable, "-m", "yawid", *words])
    said = b""
    try:
        while part := os.read(terminal, 4096):
            said += part
    except OSError:  # the terminal's end on Linux
        pass
    _, status = os.waitpid(child, 0)

    page = tmp_path / ("log.html" if logs == 1 else "no_rudder-log.html")
    assert os.waitstatus_to_exitcode(status) == 3
    assert f"report: {page}".encode() in said.replace(b"\r\n", b"")
    assert page.exists()
    assert shown.exists() is (logs == 1)
    if logs == 1:
        assert shown.read_text(encoding="utf-8").strip() == page.as_uri()
