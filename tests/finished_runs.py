"""Finished runs for the tests of what looks at them, made by the command line from real logs."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

from yawid.cli.main import main

REPLAY_LOGS = Path(__file__).parents[1] / "replay_logs"
C172P = REPLAY_LOGS / "c172p_3211" / "log.tlog"


def replayed(log: Path, folder: Path, *options: object) -> Path:
    """Replay a log into a folder; return the MCAP, whatever the verdict was."""
    with contextlib.redirect_stdout(io.StringIO()):
        main(["replay", str(log), "--out", str(folder), "--json", *map(str, options)])
    return folder / f"{log.stem}.mcap"
