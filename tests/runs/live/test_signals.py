"""A signal ends a session whole; a second one, which is KeyboardInterrupt here, ends it at once."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from live_link import SENT, attend, interrupt, left, tlog_size

from yawid.runs.live.viewer_thread import Viewer
from yawid.runs.live.worker import WorkThread
from yawid.sinks.base import Abort, Event, LogLine, Sink


# Python drops an interrupt that meets it within a __del__ and warns; a user presses once more.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupted_session_ends_at_once_and_keeps_what_was_recorded(tmp_path: Path):
    ended = threading.Event()

    def press(*_: object) -> None:
        interrupt()
        while not ended.wait(5.0):
            interrupt()

    with pytest.raises(KeyboardInterrupt):
        attend(tmp_path, press, ended)
    assert left(tmp_path) == {"live.tlog.part", "live.mcap.part"}
    assert (tmp_path / "live.tlog.part").stat().st_size == tlog_size(SENT)
    assert not [t for t in threading.enumerate() if t.name == "yawid-tap"]


class Stuck(Sink):
    """A viewer that takes nothing, as one behind a dead network."""

    def __init__(self) -> None:
        self.asked, self.freed = threading.Event(), threading.Event()

    def take(self, event: Event) -> None:
        if isinstance(event, LogLine):
            self.asked.set()
            self.freed.wait(60.0)


def test_ending_at_once_waits_for_no_viewer(monkeypatch: pytest.MonkeyPatch):
    stuck = Stuck()
    viewer = Viewer(lambda _: stuck, print, WorkThread("viewers"))
    viewer.take(LogLine(0, "info", "hello"))
    assert stuck.asked.wait(60.0)
    ender = threading.Thread(target=lambda: viewer.take(Abort()), daemon=True)
    ender.start()
    ender.join(2.0)
    try:
        assert not ender.is_alive()
    finally:
        stuck.freed.set()
        ender.join(60.0)
