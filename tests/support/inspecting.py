"""Runs ``yawid inspect`` on a log or on the bytes of one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from yawid.cli.main import main


def inspected(log: bytes | Path, tmp_path: Path, capsys, *options: str) -> tuple[int, Any]:
    path = log if isinstance(log, Path) else tmp_path / "log.tlog"
    if isinstance(log, bytes):
        path.write_bytes(log)
    code = main(["inspect", str(path), "--json", *options])
    return code, json.loads(capsys.readouterr().out)
