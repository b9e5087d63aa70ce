"""Many vehicles' manoeuvres are answered by processes, of which none outlives its session."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from checks.children import child
from interrupting import SLOW_TO_END
from live_link import frames, send

from yawid.runs.live.worker import FitWorker
from yawid.system.processes import cores


def fitting(process: psutil.Process) -> list[psutil.Process]:
    """Return the processes that fit for this one."""
    return [each for each in process.children() if "yawid.system.child" in each.cmdline()]


def test_children_make_the_calls_and_one_that_dies_costs_nothing_but_time():
    said: list[str] = []
    worker = FitWorker("fits", said.append)
    own = psutil.Process()
    try:
        assert worker.submit(os.getpid).result(60.0) == own.pid
        worker.spread()
        worker.spread()
        begun = [worker.submit(os.getpid) for _ in range(20)]
        used = {future.result(60.0) for future in begun}
        children = fitting(own)
        assert used <= {each.pid for each in children}
        assert len(children) == min(cores(), 4)

        for each in children:
            each.kill()
        after = {worker.submit(os.getpid).result(60.0) for _ in range(20)}
        assert after == {own.pid}
        answers = "this process answers instead, which takes longer"
        assert set(said) == {f"a process that answers manoeuvres was killed by SIGKILL: {answers}"}
        assert len(said) <= len(children)
    finally:
        worker.shutdown()


def test_a_call_that_fails_in_a_child_fails_here():
    said: list[str] = []
    worker = FitWorker("fits", said.append)
    worker.spread()
    try:
        with pytest.raises(ValueError, match="invalid literal for int"):
            worker.submit(int, "no number").result(60.0)
        assert "ended with exit code 1" in said[0]
    finally:
        worker.shutdown()


@pytest.mark.parametrize(
    "by", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGKILL]
)
def test_no_process_outlives_a_session_that_is_ended_at_once(
    by: signal.Signals, tmp_path: Path
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = ["live", f"udpin:127.0.0.1:{port}", "--sysid", "all", "--out", str(tmp_path)]
    with child(
        [sys.executable, "-c", SLOW_TO_END, *options],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    ) as process:  # fmt: skip
        assert "listening" in process.stderr.readline()
        session, end_s = psutil.Process(process.pid), time.monotonic() + 60.0
        for sysid in range(1, 5):
            send(frames(0.1, sysid=sysid), port)
        time.sleep(0.5)
        assert fitting(session) == []  # one thread does it for so few
        send(frames(0.1, sysid=5), port)
        while len(children := fitting(session)) < min(cores(), 4):
            assert time.monotonic() < end_s
            time.sleep(0.05)
        if by == signal.SIGINT:
            os.killpg(process.pid, by)  # as a terminal does
            assert process.stdout.readline() == "finishing\n"
            assert [each.is_running() for each in children] == [True] * len(children)
        os.killpg(process.pid, by) if by == signal.SIGINT else process.kill()
        assert process.wait(60.0) == -by
        gone, alive = psutil.wait_procs(children, 60.0)
        assert (len(gone), alive) == (len(children), [])
