"""Makes finished runs from real logs by the command line, for tests of what reads them."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

from mcap.reader import make_reader

from yawid.cli.main import main


def replayed(log: Path, folder: Path, *options: object) -> Path:
    """Replay a log into a folder; return the MCAP, whatever the verdict was."""
    with contextlib.redirect_stdout(io.StringIO()):
        main(["replay", str(log), "--out", str(folder), "--json", *map(str, options)])
    return folder / f"{log.stem}.mcap"


def messages(path: Path) -> list[tuple[str, int, int, bytes]]:
    with path.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.publish_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
            if channel.topic != "/yawid/verdict"
        ]
