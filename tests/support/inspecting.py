"""Runs ``yawid inspect`` on a log, given as a file or as bytes."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import msgspec
from printed import printed

from yawid.answers.inspection import Inspection
from yawid.cli.main import main
from yawid.sinks.terminal.inspection import print_inspection


def inspected(log: bytes | Path, tmp_path: Path, capsys, *options: str) -> tuple[int, Any]:
    path = log if isinstance(log, Path) else tmp_path / "log.tlog"
    if isinstance(log, bytes):
        path.write_bytes(log)
    code = main(["inspect", str(path), "--json", *options])
    return code, printed("inspect", capsys.readouterr().out)


def assert_is_read_in_ten_seconds(report: Any) -> None:
    """Print the page of an inspection, and look at its length and width."""
    out = io.StringIO()
    print_inspection(msgspec.convert(report, Inspection), out)
    lines = out.getvalue().splitlines()
    assert len(lines) <= 40
    assert lines[1].startswith("verdict")
    assert all(len(line) <= 80 for line in lines[1:] if "yawid replay" not in line)
