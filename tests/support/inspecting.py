"""Runs ``yawid inspect`` on a log, given as a file or as bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from printed import printed

from yawid.cli.main import main


def inspected(log: bytes | Path, tmp_path: Path, capsys, *options: str) -> tuple[int, Any]:
    path = log if isinstance(log, Path) else tmp_path / "log.tlog"
    if isinstance(log, bytes):
        path.write_bytes(log)
    code = main(["inspect", str(path), "--json", *options])
    return code, printed("inspect", capsys.readouterr().out)
