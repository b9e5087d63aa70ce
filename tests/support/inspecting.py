"""Runs ``yawid inspect`` on a log, given as a file or as bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
from printed import answered

from yawid.answers.inspection import Inspection
from yawid.sinks.pages import to_text
from yawid.sinks.terminal.inspection import inspection_page


def inspected(log: bytes | Path, tmp_path: Path, capsys, *options: str) -> tuple[int, Any]:
    path = log if isinstance(log, Path) else tmp_path / "log.tlog"
    if isinstance(log, bytes):
        path.write_bytes(log)
    return answered(capsys, "inspect", path, *options)


def page_of(report: Any) -> str:
    """Return the page that a terminal shows of an inspection."""
    return to_text(inspection_page(msgspec.convert(report, Inspection)))


def assert_is_read_in_ten_seconds(report: Any) -> None:
    """Look at the length and width of the page of an inspection."""
    lines = page_of(report).splitlines()
    assert len(lines) <= 40
    assert lines[1].startswith("verdict")
    assert all(len(line) <= 80 for line in lines[1:] if "yawid replay" not in line)
