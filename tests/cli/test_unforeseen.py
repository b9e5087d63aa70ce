"""The last door of the command line: whatever fails, it is one line, a code of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
from hostile import FLIGHT

import yawid.runs.job
from yawid.cli.main import main
from yawid.errors import EXIT_CODES


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log whose run hits a fault of yawid's own: here one that is put into it."""

    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a line\nand \x1b[2Jmore")

    monkeypatch.setattr(yawid.runs.job, "summarise", fail)
    (tmp_path / "a.tlog").write_bytes(FLIGHT)
    return tmp_path / "a.tlog"


def test_what_nobody_foresaw_is_one_line_and_exit_70(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("YAWID_DEBUG", raising=False)
    code = main(["replay", str(log), "--out", str(tmp_path / "out"), "--rate", "10"])

    said = capsys.readouterr().err
    assert (code, said.count("\n")) == (70, 1)
    assert "ZeroDivisionError: a line and \\x1b[2Jmore; YAWID_DEBUG=1" in said
    assert "70" in map(str, EXIT_CODES)
    assert not list((tmp_path / "out").glob("*.mcap"))


def test_the_traceback_is_there_for_who_asks_for_it(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("YAWID_DEBUG", "1")
    assert main(["replay", str(log), "--out", str(tmp_path / "out"), "--rate", "10"]) == 70

    said = capsys.readouterr().err
    assert "Traceback" in said
    assert "ZeroDivisionError" in said
    assert "\x1b" not in said


def test_a_log_behind_one_that_fails_is_run_all_the_same(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = [str(log), str(tmp_path / "none.tlog")]
    assert main(["replay", *both, "--out", str(tmp_path / "out")]) == 70
    assert "none.tlog" in capsys.readouterr().err.splitlines()[1]
