"""A session that begins with nothing compiled answers at once and changes over as it flies."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest
from finished_runs import messages
from live_link import CONFIG, frames, listening, send, tlog_size, wait_for_size

from yawid.estimation import armax
from yawid.estimation.machine import kept
from yawid.estimation.machine.runner import RUNNER, Runner
from yawid.runs.live import loop
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay


def test_a_session_changes_over_while_it_flies_with_the_bits_of_its_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    runner, found = Runner(), kept.find
    monkeypatch.setattr("yawid.estimation.machine.runner.LOOK_S", 0.0)
    monkeypatch.setattr(armax, "RUNNER", runner)
    is_made, behind = [False], list[bool]()
    monkeypatch.setattr(kept, "find", lambda name: found(name) if is_made[0] else None)
    monkeypatch.setattr(loop, "RUNNER", runner)
    monkeypatch.setattr(runner, "compile_behind", lambda: behind.append(True))
    early, late = frames(20.0), frames(20.0, first_s=120.0)
    with listening(tmp_path) as session:
        send(early, session.port)
        session.screen.wait_for("tracking")
        assert not runner.is_compiled()
        is_made[0] = True
        send(late, session.port)
        wait_for_size(session.part("tlog"), tlog_size(early + late))
    assert behind == [True]
    assert runner.is_compiled()

    monkeypatch.setattr(armax, "RUNNER", RUNNER)
    replay(tmp_path / "live.tlog", asdict(CONFIG), Outputs(tmp_path, "again"), StopFlag())
    assert messages(tmp_path / "live.mcap") == messages(tmp_path / "again.mcap")
