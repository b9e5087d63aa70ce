"""The bar of what takes long: seen on a terminal only, and not where it is done at once."""

from __future__ import annotations

import io
import time

import pytest

from yawid.sinks.terminal.progress import progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("stream", "wait_s"), [(Terminal(), 0.0), (io.StringIO(), 0.1)])
def test_nothing_is_shown_of_what_is_quick_or_where_there_is_no_terminal(
    stream: io.StringIO, wait_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("yawid.sinks.terminal.progress.SOON_S", 0.05)
    with progress(stream, "flight.tlog", 100) as advance:
        advance(50)
        time.sleep(wait_s)
    assert stream.getvalue() == ""


def test_what_takes_long_is_shown_with_how_far_it_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("yawid.sinks.terminal.progress.SOON_S", 0.05)
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    with progress(stream, "flight.tlog", 100) as advance:
        advance(25)
        patience = time.monotonic() + 60.0
        while "flight.tlog" not in stream.getvalue() and time.monotonic() < patience:
            time.sleep(0.01)
        advance.begin("6 structures", 6)
        advance(3)
        time.sleep(0.15)
    shown = stream.getvalue()
    assert "25%" in shown
    assert "6 structures" in shown
    assert "50%" in shown
