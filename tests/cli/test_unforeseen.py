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


def test_what_is_unforeseen_is_one_line_and_exit_70_with_a_traceback_for_who_asks(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("YAWID_DEBUG", raising=False)
    replay = ["replay", str(log), str(tmp_path / "none.tlog"), "--out", str(tmp_path / "out")]
    assert main(replay) == 70 in EXIT_CODES

    first, second = capsys.readouterr().err.splitlines()
    assert "ZeroDivisionError: a line and \\x1b[2Jmore; YAWID_DEBUG=1" in first
    assert "none.tlog" in second  # a log behind one that fails is run all the same
    assert not list((tmp_path / "out").glob("*.mcap"))
    monkeypatch.setenv("YAWID_DEBUG", "1")
    assert main(replay) == 70
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert "\x1b" not in said
