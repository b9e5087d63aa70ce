"""A link is recorded from the first frame, whatever the compiler still has to do."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest
from finished_runs import messages
from live_link import CONFIG, frames, listening, send, tlog_size, wait_for_size

from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.runs.live.warm_up import Warming
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay


@pytest.fixture
def compiler(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """A compiler that is not done before this is set."""
    done = threading.Event()

    def compile_slowly(_: RunConfig) -> None:
        assert done.wait(60.0)

    monkeypatch.setattr("yawid.runs.live.warm_up.warm_up", compile_slowly)
    monkeypatch.setattr("yawid.runs.live.loop.WARMING_S", 0.0)
    return done


def test_what_comes_while_the_estimator_is_compiled_is_recorded_at_once_and_estimated_then(
    compiler: threading.Event, tmp_path: Path
):
    early, late = frames(20.0), frames(10.0, first_s=120.0)
    with listening(tmp_path) as session:
        send(early, session.port)
        wait_for_size(session.part("tlog"), tlog_size(early))
        session.screen.wait_for("the estimator is being made ready")
        session.screen.wait_for(f"{tlog_size(early)} bytes wait for the estimator")
        compiler.set()
        session.screen.wait_for("the estimator is ready")
        send(late, session.port)
        session.screen.wait_for("tracking")
        wait_for_size(session.part("tlog"), tlog_size(early + late))

    [(summary, _, _)] = session.ended
    again, _ = replay(tmp_path / "live.tlog", CONFIG, Outputs(tmp_path, "again"), StopFlag())
    assert summary.link.frames == len(early + late)
    assert summary.channels["rudder"].how == "parameter"
    assert summary.live.dropped["queue"] == 0
    assert summary.estimates == again.estimates
    assert messages(tmp_path / "live.mcap") == messages(tmp_path / "again.mcap")


def test_a_session_told_to_stop_while_it_compiles_is_complete_all_the_same(
    compiler: threading.Event, tmp_path: Path
):
    sent = frames(20.0)
    with listening(tmp_path) as session:
        send(sent, session.port)
        wait_for_size(session.part("tlog"), tlog_size(sent))
        session.stop.is_set = True
        session.screen.wait_for("ending as soon as the estimator is ready")
        compiler.set()
    [ended] = session.ended
    again, verdict = replay(tmp_path / "live.tlog", CONFIG, Outputs(tmp_path, "again"), StopFlag())
    assert ended.exit_code == verdict.exit_code
    assert ended.summary.estimates == again.estimates
    assert set(ended.summary.files) == {"mcap", "tlog"}
    assert ended.summary.live.latency_ms is None  # that of the link, not of the compiler


def test_each_of_several_vehicles_waits_for_the_compiler(compiler: threading.Event, tmp_path: Path):
    sent = {sysid: frames(20.0, sysid=sysid) for sysid in (1, 2)}
    with listening(tmp_path, every_vehicle=True) as session:
        send([frame for pair in zip(*sent.values(), strict=True) for frame in pair], session.port)
        for sysid in sent:
            wait_for_size(session.part("tlog", f"live-{sysid}"), tlog_size(sent[sysid]))
        compiler.set()
    assert [e.summary.estimates["els"].updates > 100 for e in session.ended] == [
        True,
        True,
    ]


def test_what_does_not_fit_a_vehicle_is_found_after_compiling_and_stops_no_other(
    compiler: threading.Event, tmp_path: Path
):
    quick, slow = frames(20.0, sysid=1), frames(20.0, sysid=2, hz=5)
    with listening(tmp_path, every_vehicle=True) as session:
        send([*slow, *quick], session.port)
        wait_for_size(session.part("tlog", "live-1"), tlog_size(quick))
        compiler.set()
        session.screen.wait_for("no longer estimated")
    assert [e.summary.vehicle.sysid for e in session.ended] == [1]


def test_memory_for_what_waits_has_an_end_and_nothing_is_lost(
    compiler: threading.Event, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("yawid.runs.live.vehicle_session.MOST_HELD", 20_000)
    sent = frames(20.0)
    with listening(tmp_path) as session:
        send(sent, session.port)
        wait_for_size(session.part("tlog"), 10_000)
        compiler.set()
        wait_for_size(session.part("tlog"), tlog_size(sent))
    again, _ = replay(tmp_path / "live.tlog", CONFIG, Outputs(tmp_path, "again"), StopFlag())
    assert again.link.frames == len(sent)
    assert session.ended[0].summary.estimates == again.estimates


def test_a_warm_up_that_fails_says_so_and_is_no_silent_thread(monkeypatch: pytest.MonkeyPatch):
    def fail(_: RunConfig) -> None:
        raise ConfigError("these estimators cannot be had")

    monkeypatch.setattr("yawid.runs.live.warm_up.warm_up", fail)
    with pytest.raises(ConfigError, match="cannot be had"):
        Warming(replace(CONFIG)).wait()
