"""A session ends in time with all its files, even where a process that answers is stopped."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from checks.children import child, free_udp_port
from flights.surgery import split
from live_link import frames, listening, send, tlog_size, wait_for_size
from places import REPLAY_LOGS

import yawid
from yawid.config.run import RunConfig

VEHICLES = range(1, 6)
END_S = 20.0
"""Time limit in s of a stop: it takes 3 s by itself, and tests share two cores."""
GAPS = split((REPLAY_LOGS / "c172p_gaps" / "log.tlog").read_bytes())
TWO = [frame for stamp, frame in GAPS if stamp < GAPS[0][0] + 42_000_000]
"""Two manoeuvres of a Cessna, of which the second has not ended."""
LEFT_OUT = "was not ready in time for the end of the session: a replay of the tlog gives it"


@pytest.mark.skipif(sys.platform != "linux", reason="it stops a process by SIGSTOP")
def test_a_stopped_process_that_answers_does_not_stop_the_end_of_a_session(tmp_path: Path) -> None:
    port = free_udp_port()
    options = ["--sysid", "all", "--rate", "20", "--orders", "2,2,1,1", "--out", str(tmp_path)]
    command = [sys.executable, "-m", "yawid", "live", f"udpin:127.0.0.1:{port}", *options]
    with child(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert "listening" in process.stderr.readline()
        for sysid in VEHICLES:
            send(sent := frames(12.0, sysid=sysid), port)
            name, end_s = f"*-{sysid}.tlog.part", time.monotonic() + 60.0
            while not (part := [*tmp_path.glob(name)]) and time.monotonic() < end_s:
                time.sleep(0.02)
            wait_for_size(part[0], tlog_size(sent))
        fitting: list[psutil.Process] = []
        wanted, end_s = min(len(os.sched_getaffinity(0)), 4), time.monotonic() + 60.0
        while len(fitting) < wanted and time.monotonic() < end_s:
            below = psutil.Process(process.pid).children()
            fitting = [each for each in below if "yawid.system.child" in each.cmdline()]
            time.sleep(0.02)
        for each in fitting:
            each.send_signal(signal.SIGSTOP)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=END_S)
        assert psutil.wait_procs(fitting, END_S)[1] == []

    assert process.returncode in (0, 5)  # the verdict's
    names = {re.sub(r"live-\w+-", "", path.name) for path in tmp_path.iterdir()}
    assert names == {f"{n}.{kind}" for n in VEHICLES for kind in ("mcap", "tlog")}
    for sysid in VEHICLES:
        assert f"system {sysid}: the answer of manoeuvre 1 {LEFT_OUT}" in said
    [tlog] = tmp_path.glob("*-1.tlog")
    again = yawid.replay(tlog, rate=20.0, orders="2,2,1,1").summary
    assert [found.n for found in again.manoeuvres] == [1]


def test_an_answer_that_is_not_ready_is_left_out_with_a_line_and_the_others_are_as_in_a_replay(
    tmp_path: Path,
) -> None:
    with listening(tmp_path, RunConfig(lateral="auto"), answers_s=0.0) as session:
        send(TWO, session.port)
        session.screen.wait_for("manoeuvre 1 (")
        wait_for_size(session.part("tlog"), tlog_size(TWO))
    [ended] = session.ended
    again = yawid.replay(tmp_path / "live.tlog").summary
    said = session.screen.getvalue()

    assert f"the answer of manoeuvre 2 {LEFT_OUT}" in said
    assert [each.n for each in ended.summary.manoeuvres] == [1]
    own, whole = ended.summary.manoeuvres[0], again.manoeuvres[0]
    assert [each.n for each in again.manoeuvres] == [1, 2]
    assert own.dutch_roll == whole.dutch_roll
    is_late = f"the bare airframe of manoeuvre 1 {LEFT_OUT}" in said
    assert (own.lateral is None) is is_late
    assert {path.name for path in tmp_path.iterdir()} == {"live.tlog", "live.mcap"}
