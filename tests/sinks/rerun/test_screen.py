"""A viewer that really opens, on a screen of its own; with ``tools/check.py --long`` only."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from checks.children import child
from finished_runs import replayed
from places import C172P

PORT = 9876  # rerun's own, which --rerun spawn takes
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not (shutil.which("Xvfb") and shutil.which("xwininfo")), reason="needs Xvfb and xwininfo"
    ),
]


def listens() -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        return probe.connect_ex(("127.0.0.1", PORT)) == 0


def wait_until(wanted: bool) -> bool:
    deadline = time.monotonic() + 60.0
    while listens() is not wanted and time.monotonic() < deadline:
        time.sleep(0.1)
    return listens() is wanted


@pytest.fixture
def screen() -> Iterator[str]:
    """The name of a display that nobody sees; a viewer on it ends with it."""
    if listens():
        pytest.skip(f"somebody listens on port {PORT} already")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1024x768x24"]
    quiet = subprocess.DEVNULL
    with (
        os.fdopen(read, encoding="ascii") as numbers,
        child([*command, "-nolisten", "tcp"], pass_fds=[write], stderr=quiet),
    ):
        os.close(write)
        yield f":{numbers.readline().strip()}"
    assert wait_until(False), "the viewer outlives its screen"


@pytest.mark.parametrize("command", ["view", "replay --rerun spawn"])
def test_a_viewer_opens_where_there_is_a_screen(screen: str, tmp_path: Path, command: str) -> None:
    arguments = ["replay", str(C172P), "--rerun", "spawn", "--out", str(tmp_path)]
    if command == "view":
        arguments = ["view", str(replayed(C172P, tmp_path, "--rate", 10))]
    environment = {k: v for k, v in os.environ.items() if k != "WAYLAND_DISPLAY"}
    environment |= {"DISPLAY": screen, "PYTHONPATH": os.pathsep.join(sys.path)}
    with (tmp_path / "said").open("wb") as said:  # a pipe would stay open as long as the viewer
        done = subprocess.run(
            [sys.executable, "-m", "yawid", *arguments],
            env=environment, stdout=said, stderr=subprocess.STDOUT, check=False, timeout=120,
        )  # fmt: skip
    text = (tmp_path / "said").read_text(encoding="utf-8")

    assert done.returncode == 0, text
    assert "no Rerun viewer" not in text
    assert listens()
    windows = subprocess.run(
        ["xwininfo", "-root", "-tree", "-display", screen],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    assert '"Rerun"' in windows.stdout
