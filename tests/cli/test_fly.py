"""``yawid fly``: a log inspected, replayed as recommended, its report written and opened."""

from __future__ import annotations

import os
import pty
import stat
import sys
from pathlib import Path

import pytest
from places import C172P, REPLAY_LOGS

import yawid
from yawid.cli.main import main

NO_RUDDER = REPLAY_LOGS / "no_rudder" / "log.tlog"


@pytest.mark.long
def test_one_line_inspects_replays_and_reports(tmp_path: Path, capsys) -> None:
    fly = ["fly", str(C172P), "--out", str(tmp_path), "--rate", "10"]

    assert main(fly) == 0
    said = capsys.readouterr().out
    run = yawid.load(tmp_path / "log.mcap")
    assert f"try  yawid replay {C172P} --rate 10.0" in said  # of the inspection
    assert "\n  flight  wn " in said  # of the replay
    assert said.endswith(f"report: {tmp_path / 'log.html'}\n")
    assert run.config.rate == 10.0
    assert run.summary.log in (tmp_path / "log.html").read_text(encoding="utf-8")

    assert main(fly) == 0  # the files of the same log are replaced
    assert capsys.readouterr().out == said


@pytest.mark.parametrize("option", ["", pytest.param("--no-open", marks=pytest.mark.long)])
def test_on_a_terminal_the_report_is_opened_and_the_code_is_the_verdict_s(
    tmp_path: Path, option: str
) -> None:
    """In a terminal of its own, with a browser that writes down what it is to show."""
    browser, shown = tmp_path / "browser", tmp_path / "shown"
    browser.write_text(f'#!/bin/sh\necho "$1" > {shown}\n', encoding="utf-8")
    browser.chmod(stat.S_IRWXU)
    words = ["fly", str(NO_RUDDER), "--out", str(tmp_path), *option.split()]
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

    page = tmp_path / "log.html"
    assert os.waitstatus_to_exitcode(status) == 3
    assert f"report: {page}".encode() in said.replace(b"\r\n", b"")
    assert page.exists()
    assert shown.exists() is not bool(option)
    if not option:
        assert shown.read_text(encoding="utf-8").strip() == page.as_uri()
