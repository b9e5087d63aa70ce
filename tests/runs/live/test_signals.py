"""A signal ends a session whole; a second one, which is KeyboardInterrupt here, ends it at once."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from live_link import SENT, Screen, attend, free_port, interrupt, left, tlog_size

from yawid.blocks import ModesBlock, SampleBlock
from yawid.config.run import RunConfig
from yawid.runs.live import Console, LiveOptions, live
from yawid.runs.live.viewer_thread import Viewer
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag
from yawid.sinks.base import LogLevel


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """A compiler that is never done."""
    monkeypatch.setattr(
        "yawid.runs.live.warm_up.warm_up", lambda _: threading.Event().wait(300.0) and None
    )


def test_an_interrupted_session_ends_at_once_and_keeps_what_was_recorded(tmp_path: Path):
    with pytest.raises(KeyboardInterrupt):
        attend(tmp_path, lambda *_: interrupt())
    assert left(tmp_path) == {"live.tlog.part", "live.mcap.part"}
    assert (tmp_path / "live.tlog.part").stat().st_size == tlog_size(SENT)
    assert not [t for t in threading.enumerate() if t.name == "yawid-tap"]


@pytest.mark.usefixtures("no_compiler")
def test_one_that_ends_while_it_compiles_can_be_ended_at_once_and_keeps_what_was_recorded(
    tmp_path: Path,
):
    def end_twice(stop: StopFlag, screen: Screen) -> None:
        stop.is_set = True
        screen.wait_for("a second signal ends at once")
        interrupt()

    with pytest.raises(KeyboardInterrupt):
        attend(tmp_path, end_twice)
    assert left(tmp_path) == {"live.tlog.part", "live.mcap.part"}
    assert (tmp_path / "live.tlog.part").stat().st_size == tlog_size(SENT)


@pytest.mark.usefixtures("no_compiler")
def test_a_link_nobody_sent_on_waits_for_no_compiler(tmp_path: Path):
    options = LiveOptions(f"udpin:127.0.0.1:{free_port()}", seconds=0.2)
    [ended] = live(options, RunConfig(), Outputs(tmp_path, "live"), StopFlag(), Console(Screen()))
    assert ended.exit_code == 3


class Stuck:
    """A viewer that takes nothing, as one behind a dead network."""

    def __init__(self) -> None:
        self.asked, self.freed = threading.Event(), threading.Event()

    def start(self, *_: object) -> None: ...

    def write(self, samples: SampleBlock, estimates: object, modes: ModesBlock) -> None: ...

    def log(self, unix_ns: int, level: LogLevel, text: str) -> None:
        self.asked.set()
        self.freed.wait(60.0)

    def manoeuvre(self, found: object, span_ns: object) -> None: ...

    def flush(self) -> None: ...

    def finish(self, summary: object, attachments: object) -> None: ...

    def abort(self) -> None: ...


def test_ending_at_once_waits_for_no_viewer(monkeypatch: pytest.MonkeyPatch):
    stuck = Stuck()
    viewer = Viewer(lambda _: stuck, print)
    viewer.log(0, "info", "hello")
    assert stuck.asked.wait(10.0)
    ender = threading.Thread(target=viewer.abort)
    ender.start()
    ender.join(2.0)
    try:
        assert not ender.is_alive()
    finally:
        stuck.freed.set()
        ender.join()
