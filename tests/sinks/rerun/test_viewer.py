"""A viewer: one that runs, dies, is not there, or opens on a screen of its own (--long)."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit
from urllib.request import urlopen

import numpy as np
import pytest
from checks.children import LEAVE_S, child
from finished_runs import replayed
from places import C172P
from sinks.rerun.rerun_reading import VIEWER, fail, recorded, values
from sinks.sink_blocks import GRID, ROWS, START_NS, SUMMARY, make_blocks, run

from yawid.runs.outputs import Outputs, open_rerun, served
from yawid.sinks.base import Abort, Done, Flush, LogLine, RunRows
from yawid.sinks.rerun.sink import RerunSink


@contextmanager
def viewer(*options: str) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Rerun's own receiver, without a window, on a free port."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with child(
        [VIEWER, *options, "--bind", "127.0.0.1", "--port", str(port)],
        env={**os.environ, "RUST_LOG": "info"},
        stderr=subprocess.PIPE,
    ) as process:
        while b"Listening for gRPC" not in process.stderr.readline():
            assert process.poll() is None
        yield f"rerun+http://127.0.0.1:{port}/proxy", process


def wait_for_rows(path: Path, n: int) -> dict[str, dict[str, Any]]:
    """What the other process has written once it holds ``n`` rows: it gives no sign of its own."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        try:
            entities = recorded(path)
        except (RuntimeError, ValueError):  # half a message at the end
            continue
        last = entities.get("/log", {}).get("TextLog:text", [])
        if len(last) == 2 and len(entities["/input"]["boot_time"]) == n:
            return entities
    pytest.fail(f"{path} does not hold {n} rows")


@pytest.mark.filterwarnings("ignore:RRD file has no footer")  # a receiver that still runs
def test_a_viewer_that_runs_already_gets_everything_and_one_that_dies_is_noticed_in_one_warning(
    tmp_path: Path,
) -> None:
    warnings: list[str] = []
    rows = RunRows(*make_blocks(n=300))
    with viewer("--save", str(tmp_path / "got.rrd")) as (address, process):
        sink = RerunSink(address, name="flight", warn=fail)
        run(sink, tuple(rows), [100, 101])
        sink.take(Done(SUMMARY, {}))
        entities = wait_for_rows(tmp_path / "got.rrd", 300)
        sink = RerunSink(address, name="flight", warn=warnings.append)
        for event in (GRID, rows, Flush()):
            sink.take(event)
        assert warnings == []
        process.kill()
        process.wait(LEAVE_S)
        for event in (rows, LogLine(START_NS, "info", "still flying"), Done(SUMMARY, {})):
            sink.take(event)
    np.testing.assert_array_equal(values(entities, "/input"), rows.samples.u)
    assert entities["/log"]["TextLog:text"][-1] == ["the last line"]
    [warning] = warnings
    assert "no Rerun viewer" in warning
    assert "\n" not in warning


NO_SCREEN = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is a screen")


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("rerun+http://127.0.0.1:{free}/proxy", "Connection refused"),
        ("somewhere", ""),
        pytest.param("spawn", "no screen", marks=NO_SCREEN),
    ],
)
def test_a_viewer_that_is_not_there_is_one_warning(
    target: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with socket.create_server(("127.0.0.1", 0)) as server:
        free = server.getsockname()[1]
    warnings: list[str] = []
    sink = RerunSink(target.format(free=free), name="flight", warn=warnings.append)
    run(sink, make_blocks(n=ROWS), [])
    sink.take(Abort())
    [warning] = warnings
    assert words in warning


PORT = 9876  # rerun's own, which --rerun spawn takes


def listens() -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        return probe.connect_ex(("127.0.0.1", PORT)) == 0


def wait_until(wanted: bool) -> bool:
    deadline = time.monotonic() + 60.0
    while listens() is not wanted and time.monotonic() < deadline:
        time.sleep(0.1)
    return listens() is wanted


def answers(host: str, port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        return probe.connect_ex((host, port)) == 0


NEIGHBOUR = "127.0.0.2"  # an address of this machine that is not the one served


def test_the_web_viewer_is_served_to_this_address_only_takes_a_run_and_ends_at_ctrl_c(
    tmp_path: Path,
) -> None:
    run = str(replayed(C172P, tmp_path, "--rate", 10))
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "BROWSER")}
    environment |= {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-m", "yawid", "view", run, "--web"]
    with child(command, env=environment, stderr=subprocess.PIPE) as process:
        line = process.stderr.readline().decode()
        url = line.split()[-1]
        where, viewer = urlsplit(url), urlsplit(parse_qs(urlsplit(url).query)["url"][0])
        assert process.stderr.readline() == b"yawid: Ctrl-C ends it\n"  # the run was taken
        with urlopen(f"http://{where.netloc}/", timeout=60.0) as page:
            assert b"web viewer" in page.read()
        for port in (where.port, viewer.port):
            assert answers("127.0.0.1", port)
            if sys.platform == "linux":
                assert not answers(NEIGHBOUR, port)
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 0
    assert not answers("127.0.0.1", where.port)
    assert not answers("127.0.0.1", viewer.port)


def test_a_live_session_that_serves_hands_its_rows_to_the_web_viewer_and_others_serve_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("yawid.sinks.rerun.web.has_desktop", lambda: False)
    outputs = Outputs(tmp_path, "flight", rerun="serve")
    with served(outputs) as given:
        assert given == replace(outputs, rerun=given.rerun)
        assert given.has_viewer
        (sink,) = open_rerun(given)
        run(sink, make_blocks(n=300), [100])
        sink.take(Done(SUMMARY, {}))
        said = capsys.readouterr().err
        assert said.count("\n") == 1  # no viewer failed
        assert quote(given.rerun, safe="") in said
    with served(replace(outputs, rerun="off")) as given:
        assert given.rerun == "off"
    assert capsys.readouterr().err == ""


@pytest.fixture
def screen() -> Iterator[str]:
    """The name of a display that is not seen; a viewer on it ends with it."""
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


@pytest.mark.long
@pytest.mark.skipif(
    not (shutil.which("Xvfb") and shutil.which("xwininfo")), reason="needs Xvfb and xwininfo"
)
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
