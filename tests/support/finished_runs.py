"""Makes finished runs from real logs by the command line, for tests of what reads them."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
import os
import shutil
from pathlib import Path

from mcap.reader import make_reader
from places import REPLAY_LOGS

from yawid.cli.main import main

KEPT = "YAWID_TEST_RUNS"
"""The environment variable that names the folder of a session's runs: its workers share them."""


def replayed(log: Path, folder: Path, *options: object) -> Path:
    """Replay a log into a folder; return the MCAP, whatever the verdict was.

    A log of the project is replayed with the same options once in a session, and then copied.
    """
    words = [str(log), *map(str, options)]
    if not log.is_relative_to(REPLAY_LOGS) or KEPT not in os.environ:
        return _replayed(words, folder)
    kept = Path(os.environ[KEPT]) / hashlib.sha256("\0".join(words).encode()).hexdigest()
    with kept.with_suffix(".lock").open("w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            _replayed(words, kept.with_suffix(".part"))
            kept.with_suffix(".part").rename(kept)
    shutil.copytree(kept, folder, dirs_exist_ok=True)
    return folder / f"{log.stem}.mcap"


def _replayed(words: list[str], folder: Path) -> Path:
    with contextlib.redirect_stdout(io.StringIO()):
        main(["replay", *words, "--out", str(folder), "--json"])
    return folder / f"{Path(words[0]).stem}.mcap"


def messages(path: Path) -> list[tuple[str, int, int, bytes]]:
    with path.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.publish_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
            if channel.topic != "/yawid/verdict"
        ]
