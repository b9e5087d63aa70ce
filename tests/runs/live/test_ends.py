"""A session ends whole by a signal, at once by a second one, in time, and nothing outlives it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from bench.programs import kill_once
from checks.children import child, free_udp_port
from flights.surgery import split
from interrupting import SLOW_TO_END
from live_link import (
    SENT,
    attend,
    frames,
    interrupt,
    left,
    listening,
    send,
    tlog_size,
    wait_for_size,
    wait_until,
)
from places import REPLAY_LOGS
from printed import printed

import yawid
from yawid.answers.run_summary import Manoeuvre
from yawid.config.run import RunConfig
from yawid.manoeuvre.answered import answer
from yawid.runs.live.viewer_thread import Viewer
from yawid.runs.live.worker import FitWorker, WorkThread
from yawid.runs.replay import StopFlag
from yawid.sinks.base import Abort, Event, LogLine, Sink
from yawid.system.processes import cores

VEHICLES = range(1, 6)
END_S = 20.0
"""Time limit in s of a stop: it takes 3 s by itself, and tests share two cores."""
GAPS = split((REPLAY_LOGS / "c172p_gaps" / "log.tlog").read_bytes())
TWO = [frame for stamp, frame in GAPS if stamp < GAPS[0][0] + 42_000_000]
"""Two manoeuvres of a Cessna, of which the second has not ended."""
LEFT_OUT = "was not ready in time for the end of the session: a replay of the tlog gives it"


class Stuck(Sink):
    """A viewer that takes nothing, as one behind a dead network."""

    def __init__(self) -> None:
        self.asked, self.freed = threading.Event(), threading.Event()

    def take(self, event: Event) -> None:
        if isinstance(event, LogLine):
            self.asked.set()
            self.freed.wait(60.0)


def test_ending_at_once_waits_for_no_viewer() -> None:
    stuck = Stuck()
    viewer = Viewer(lambda _: stuck, print, WorkThread("viewers"))
    viewer.take(LogLine(0, "info", "hello"))
    assert stuck.asked.wait(60.0)
    ender = threading.Thread(target=lambda: viewer.take(Abort()), daemon=True)
    ender.start()
    ender.join(2.0)
    stuck.freed.set()
    assert not ender.is_alive()


@pytest.fixture
def slow_fit(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """A fit that is not done before this is set, at the latest at the end of the test."""
    done = threading.Event()

    def wait(*asked: object) -> Manoeuvre:
        assert done.wait(60.0)
        return answer(*asked)  # type: ignore[arg-type] # as the stage calls it

    monkeypatch.setattr("yawid.manoeuvre.stage.answer", wait)
    yield done
    done.set()


def test_the_loop_does_not_wait_for_a_fit_and_the_end_of_the_session_does(
    slow_fit: threading.Event, tmp_path: Path
) -> None:
    with listening(tmp_path, RunConfig()) as session:
        session.fly(TWO)
        session.screen.wait_for("tracking")
        assert not session.lines("manoeuvre 1")
        # Python waits at its end for no thread of ours.
        own = [each for each in threading.enumerate() if each.name.startswith("yawid-")]
        assert {each.daemon for each in own} == {True}
        session.stop.is_set = True
        slow_fit.set()
    assert [each.n for each in session.ended[0].summary.manoeuvres] == [1, 2]


# Python drops an interrupt that meets it within a __del__ and warns; a user presses once more.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("waits_for_a_fit", [False, True])
def test_an_interrupted_session_ends_at_once_and_keeps_what_was_recorded(
    waits_for_a_fit: bool, slow_fit: threading.Event, tmp_path: Path
) -> None:
    ended = threading.Event()

    def press(stop: StopFlag, _: object) -> None:
        if waits_for_a_fit:  # as after a first signal
            stop.is_set = True
            time.sleep(1.0)
        interrupt()
        while not ended.wait(5.0):
            interrupt()

    with pytest.raises(KeyboardInterrupt):
        attend(tmp_path, press, ended)
    assert left(tmp_path) == {"live.tlog.part", "live.mcap.part"}
    assert (tmp_path / "live.tlog.part").stat().st_size == tlog_size(SENT)
    assert not [t for t in threading.enumerate() if t.name == "yawid-tap"]


def test_an_answer_that_is_not_ready_is_left_out_with_a_line_and_the_others_are_as_in_a_replay(
    tmp_path: Path,
) -> None:
    with listening(tmp_path, RunConfig(lateral="auto"), answers_s=0.0) as session:
        session.fly(TWO)
        session.screen.wait_for("manoeuvre 1 (")
    [(summary, _)] = session.ended
    again = yawid.replay(tmp_path / "live.tlog").summary

    assert session.lines(f"the answer of manoeuvre 2 {LEFT_OUT}")
    assert [[each.n for each in run.manoeuvres] for run in (summary, again)] == [[1], [1, 2]]
    own, whole = summary.manoeuvres[0], again.manoeuvres[0]
    assert own.dutch_roll == whole.dutch_roll
    is_late = bool(session.lines(f"the bare airframe of manoeuvre 1 {LEFT_OUT}"))
    assert (own.lateral is None) is is_late
    assert left(tmp_path) == {"live.tlog", "live.mcap"}


def fitting(process: psutil.Process) -> list[psutil.Process]:
    """Return the processes that fit for this one."""
    return [each for each in process.children() if "yawid.system.child" in each.cmdline()]


def test_children_make_the_calls_and_one_that_dies_or_fails_costs_nothing_but_time() -> None:
    said: list[str] = []
    worker, own = FitWorker("fits", said.append), psutil.Process()
    try:
        assert worker.submit(os.getpid).result(60.0) == own.pid
        worker.spread()
        worker.spread()
        begun = [worker.submit(os.getpid) for _ in range(20)]
        used = {future.result(60.0) for future in begun}
        children = fitting(own)
        assert used <= {each.pid for each in children}
        assert len(children) == min(cores(), 4)
        with pytest.raises(ValueError, match="invalid literal for int"):
            worker.submit(int, "no number").result(60.0)
        answers = "this process answers instead, which takes longer"
        assert said.pop() == f"a process that answers manoeuvres ended with exit code 1: {answers}"

        for each in children:
            if each.is_running():
                each.kill()
        after = {worker.submit(os.getpid).result(60.0) for _ in range(20)}
        assert after == {own.pid}
        killed = f"a process that answers manoeuvres was killed by SIGKILL: {answers}"
        assert set(said) <= {killed}
        assert len(said) < len(children)
    finally:
        worker.shutdown()


@contextmanager
def of_five_vehicles(
    folder: Path, command: list[str], seconds: float
) -> Iterator[tuple[subprocess.Popen[str], list[psutil.Process]]]:
    """Run a session in a process; yield it and those that fit for it, which four do not need."""
    port = free_udp_port()
    options = [f"udpin:127.0.0.1:{port}", "--sysid", "all", "--out", str(folder), "--json"]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with child(
        [sys.executable, *command, "live", *options, "--rate", "20", "--orders", "2,2,1,1"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env, start_new_session=True,
    ) as process:  # fmt: skip
        assert "listening" in process.stderr.readline()
        session = psutil.Process(process.pid)
        for sysid in VEHICLES:
            if sysid == VEHICLES[-1]:
                assert fitting(session) == []
            sent = frames(seconds, sysid=sysid)
            send(sent, port)
            name = f"*-{sysid}.tlog.part"
            wait_until(lambda name=name: [*folder.glob(name)])
            wait_for_size(*folder.glob(name), tlog_size(sent))
        wait_until(lambda: len(fitting(session)) >= min(cores(), 4))
        yield process, fitting(session)


@pytest.mark.skipif(sys.platform != "linux", reason="it stops a process by SIGSTOP")
@pytest.mark.parametrize(
    "by", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_a_signal_ends_a_session_in_time_with_every_file_though_processes_that_answer_are_stopped(
    by: signal.Signals, tmp_path: Path
) -> None:
    with of_five_vehicles(tmp_path, ["-m", "yawid"], 12.0) as (process, children):
        for each in children:
            each.send_signal(signal.SIGSTOP)
        process.send_signal(by)
        out, said = process.communicate(timeout=END_S)
        assert psutil.wait_procs(children, END_S)[1] == []

    assert process.returncode in (0, 5)  # the verdict's
    summaries = [printed("live", line) for line in out.splitlines()]
    assert (process.returncode == 0) is all(each["verdict"]["usable"] for each in summaries)
    assert [each["link"]["frames"] for each in summaries] == [len(frames(12.0))] * len(VEHICLES)
    names = {re.sub(r"live-\w+-", "", path.name) for path in tmp_path.iterdir()}
    assert names == {f"{n}.{kind}" for n in VEHICLES for kind in ("mcap", "tlog")}
    for sysid in VEHICLES:
        assert f"system {sysid}: the answer of manoeuvre 1 {LEFT_OUT}" in said
    [tlog] = tmp_path.glob("*-1.tlog")
    again = yawid.replay(tlog, rate=20.0, orders="2,2,1,1").summary
    assert [found.n for found in again.manoeuvres] == [1]


@pytest.mark.parametrize(
    "by", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.long)]
)
def test_no_process_outlives_a_session_that_is_ended_at_once(
    by: signal.Signals, tmp_path: Path
) -> None:
    """By kill -9, or by a second ctrl-C in a terminal while it finishes after the first."""
    with of_five_vehicles(tmp_path, ["-c", SLOW_TO_END], 0.1) as (process, children):
        if by == signal.SIGINT:
            os.killpg(process.pid, by)
            assert process.stdout.readline() == "finishing\n"
            assert [each.is_running() for each in children] == [True] * len(children)
        os.killpg(process.pid, by) if by == signal.SIGINT else process.kill()
        assert process.wait(60.0) == -by
        gone, alive = psutil.wait_procs(children, 60.0)
        assert (len(gone), alive) == (len(children), [])


@pytest.mark.parametrize("moment_s", [pytest.param(3.1, marks=pytest.mark.long), 1.9])
def test_a_killed_session_loses_at_most_its_last_second(moment_s: float, tmp_path: Path) -> None:
    stamped = [(1_700_000_000_000_000 + 10_000 * i, each) for i, each in enumerate(frames(60.0))]

    loss = kill_once(stamped, moment_s, tmp_path, speed=5.0)

    assert max(loss["tlog_s"], loss["mcap_s"]) <= 1.0
    assert min(loss["frames"], loss["rows"]) > 100
    assert loss["same"]
