"""A sink that fails is one line, and the session goes on without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from yawid.blocks import EstimateBlock, ModesBlock, SampleBlock
from yawid.errors import SinkError
from yawid.sinks.base import Grid, LogLevel, Pace, Sink

LOOK_S = 1.0


class Guarded:
    """Stands in front of a sink that writes ``part``; ``failure`` says why it was given up.

    A file that is removed while it is written raises no error by itself: that it is still there is
    looked at every ``LOOK_S``.
    """

    def __init__(self, sink: Sink, part: Path, tell: Callable[[str], None]) -> None:
        self.failure: str | None = None
        self._sink = sink
        self._part = part
        self._tell = tell
        self._look = Pace(LOOK_S)

    def start(self, grid: Grid) -> None:
        """See :meth:`yawid.sinks.base.Sink.start`."""
        self._attempt(lambda: self._sink.start(grid))

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """See :meth:`yawid.sinks.base.Sink.write`."""
        self._attempt(lambda: self._sink.write(samples, estimates, modes))

    def log(self, unix_ns: int, level: LogLevel, text: str) -> None:
        """See :meth:`yawid.sinks.base.Sink.log`."""
        self._attempt(lambda: self._sink.log(unix_ns, level, text))

    def flush(self) -> None:
        """See :meth:`yawid.sinks.base.Sink.flush`."""
        self._attempt(self._flush)

    def finish(self, summary: Mapping[str, Any], attachments: Mapping[str, bytes]) -> None:
        """See :meth:`yawid.sinks.base.Sink.finish`."""
        self._attempt(lambda: self._sink.finish(summary, attachments))

    def abort(self) -> None:
        """See :meth:`yawid.sinks.base.Sink.abort`."""
        if self.failure is None:
            self._sink.abort()

    def _flush(self) -> None:
        if self._look.due():
            check_present(self._part)
        self._sink.flush()

    def _attempt(self, act: Callable[[], None]) -> None:
        if self.failure is not None:
            return
        try:
            act()
        except SinkError as error:
            self.failure = str(error)
            self._tell(f"{error}: the session goes on without it")
            self._sink.abort()


def check_present(part: Path) -> None:
    """Raise SinkError where a file that is being written has been removed."""
    if not part.exists():
        raise SinkError(f"{part} has been removed")
