from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks.children import LEAVE_S, child
from sinks.rerun.rerun_reading import VIEWER, fail, recorded, run, values
from sinks.sink_blocks import (
    GRID,
    START_NS,
    SUMMARY,
    make_blocks,
    run_script,
)

from yawid.sinks.base import Abort, Done, Flush, LogLine, RunRows
from yawid.sinks.rerun.recording import RerunView
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
        assert process.stderr is not None
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
def test_a_viewer_that_runs_already_gets_everything(tmp_path: Path) -> None:
    blocks = make_blocks(n=300)
    with viewer("--save", str(tmp_path / "got.rrd")) as (address, _):
        run(RerunSink(address, name="flight", warn=fail), blocks, [100, 101])
        entities = wait_for_rows(tmp_path / "got.rrd", 300)
    np.testing.assert_array_equal(values(entities, "/input"), blocks[0].u)
    assert entities["/log"]["TextLog:text"][-1] == ["gap of 3 s"]


def test_a_viewer_that_dies_is_one_warning_and_the_run_goes_on() -> None:
    warnings: list[str] = []
    blocks = make_blocks(n=300)
    with viewer("--serve-grpc") as (address, process):
        sink = RerunSink(address, name="flight", warn=warnings.append)
        sink.take(GRID)
        sink.take(RunRows(*blocks))
        sink.take(Flush())
        assert warnings == []
        process.kill()
        process.wait(LEAVE_S)
        sink.take(RunRows(*blocks))
        sink.take(LogLine(START_NS, "info", "still flying"))
        sink.take(Done(SUMMARY, {}))
    [warning] = warnings
    assert "no Rerun viewer" in warning
    assert "\n" not in warning


def test_a_viewer_that_died_is_noticed_by_the_next_flush() -> None:
    samples, estimates, modes = make_blocks(n=30)
    with viewer("--serve-grpc") as (address, process):
        view = RerunView(address, "flight")
        view.take(GRID)
        view.take(RunRows(samples, estimates, modes))
        view.take(Flush())
        process.kill()
        process.wait(LEAVE_S)
        view.take(RunRows(samples, estimates, modes))
        with pytest.raises(RuntimeError):
            view.take(Flush())


def test_a_viewer_that_is_not_there_is_one_warning() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    warnings: list[str] = []
    sink = RerunSink(f"rerun+http://127.0.0.1:{port}/proxy", name="flight", warn=warnings.append)
    run(sink, make_blocks(n=30))
    sink.take(Abort())
    assert len(warnings) == 1
    assert "Connection refused" in warnings[0]


def test_an_address_that_is_none_is_one_warning() -> None:
    warnings: list[str] = []
    run(RerunSink("somewhere", name="flight", warn=warnings.append), make_blocks(n=30))
    assert len(warnings) == 1


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a screen")
def test_a_machine_without_a_screen_is_one_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    warnings: list[str] = []
    run(RerunSink("spawn", name="flight", warn=warnings.append), make_blocks(n=30))
    assert len(warnings) == 1
    assert "no screen" in warnings[0]


def test_rerun_and_mcap_are_loaded_only_by_those_who_use_them() -> None:
    script = (
        "import sys, yawid.sinks.base, yawid.sinks.rerun.sink\n"
        "assert not {'rerun', 'mcap', 'google.protobuf'} & sys.modules.keys()\n"
        "import yawid.sinks.mcap.sink, yawid.sinks.mcap.reader\n"
        "assert 'rerun' not in sys.modules"
    )
    run_script(script)
