"""A live session: a tlog being written, and estimated as it grows."""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, BinaryIO

from yawid.errors import SinkError
from yawid.outputs import Outputs, finish, open_mcap, open_rerun
from yawid.pipeline import Pipeline
from yawid.run_config import RunConfig
from yawid.session import StopFlag
from yawid.sinks.base import Sink, open_part
from yawid.sources.reading import Reading
from yawid.sources.udp import UdpTap, parse_endpoint
from yawid.summary import summarise
from yawid.verdict import Verdict

PLAIN_LINE_S = 10.0
TERMINAL_LINE_S = 1.0
READ_S = 0.2


def live(
    endpoint: str,
    config: RunConfig,
    outputs: Outputs,
    stop: StopFlag,
    seconds: float | None,
    say: Callable[[str], None],
    reading: Reading | None = None,
) -> tuple[dict[str, Any], Verdict]:
    """Tap a link until told to stop; return the session's summary and verdict.

    Raises:
        ConfigError: the endpoint is malformed.
        SourceError: the socket cannot be had.
        SinkError: an output cannot be written.
    """
    address = parse_endpoint(endpoint)
    rerun = open_rerun(outputs)
    with UdpTap(address) as tap:
        say(f"listening on {endpoint} (receive buffer {tap.receive_buffer} bytes)")
        session = LiveSession(config, outputs, rerun, endpoint, reading)
        try:
            _pump(tap, session, stop, seconds, say)
        except BaseException:
            session.abort()
            raise
    return session.finish()


def _pump(
    tap: UdpTap,
    session: LiveSession,
    stop: StopFlag,
    seconds: float | None,
    say: Callable[[str], None],
) -> None:
    end = float("inf") if seconds is None else time.monotonic() + seconds
    period = TERMINAL_LINE_S if sys.stderr.isatty() else PLAIN_LINE_S
    next_line = time.monotonic() + period
    while not stop.is_set and (now := time.monotonic()) < end:
        data = tap.read(min(READ_S, end - now))
        if data:
            session.feed(data)
        session.flush()
        if now >= next_line:
            next_line = now + period
            say(session.line())


class LiveSession:
    """A live session is a tlog being written: the same bytes go to the file and to the pipeline."""

    def __init__(
        self,
        config: RunConfig,
        outputs: Outputs,
        rerun: list[Sink],
        endpoint: str,
        reading: Reading | None = None,
    ) -> None:
        self.config = config
        self.outputs = outputs
        self.endpoint = endpoint
        self.pipeline = Pipeline(config, rerun, reading)
        self._sha256 = hashlib.sha256()
        self._opened = False
        self._tlog: BinaryIO | None = None

    def feed(self, data: bytes) -> None:
        """Record the bytes, then estimate; the files are opened with the first of them."""
        if not self._opened:
            self._opened = True
            self.pipeline.sinks.insert(0, open_mcap(self.config, self.outputs))
            if self.outputs.record:
                self._part, self._tlog = open_part(
                    self.outputs.path(".tlog"), force=self.outputs.force
                )
        self._sha256.update(data)
        if self._tlog is not None:
            try:
                self._tlog.write(data)
            except OSError as error:
                raise SinkError(f"cannot write {self._part}: {error.strerror}") from error
        self.pipeline.feed(data)

    def flush(self) -> None:
        """Bring out what is complete."""
        if self._tlog is not None:
            self._tlog.flush()
        for sink in self.pipeline.sinks:
            sink.flush()

    def line(self) -> str:
        """Return one line on where the session stands."""
        frames, bank, found = (
            self.pipeline.decoder.link.frames,
            self.pipeline.bank,
            self.pipeline.modes,
        )
        if bank is None or found is None:
            return f"{frames} frames, waiting for rudder and yaw rate"
        updates = bank.estimators[self.config.method].updates
        wn, wn_std, zeta, zeta_std = found.dutch_roll[-1]
        return (
            f"{frames} frames, {updates} updates, wn {wn:.4g} ± {wn_std:.2g} rad/s, "
            f"zeta {zeta:.3g} ± {zeta_std:.2g}, lost {self.pipeline.decoder.link.lost}"
        )

    def finish(self) -> tuple[dict[str, Any], Verdict]:
        """Finish every file; return the final summary and the verdict."""
        self.pipeline.finish()
        summary, verdict = summarise(self.pipeline, self._log_name(), self._sha256.hexdigest())
        files = self.outputs.files() if self._opened else {}
        if self._tlog is not None:
            self._tlog.close()
            self._part.replace(self.outputs.path(".tlog"))
            files["tlog"] = str(self.outputs.path(".tlog"))
        finish(self.pipeline, summary, files)
        return summary, verdict

    def abort(self) -> None:
        """Close what is open under its unfinished name: what was recorded stays."""
        if self._tlog is not None:
            self._tlog.close()
        for sink in self.pipeline.sinks:
            sink.abort()

    def _log_name(self) -> str:
        recorded = self._opened and self.outputs.record
        return str(self.outputs.path(".tlog")) if recorded else self.endpoint


def session_name() -> str:
    """Return a name for a live session's files: its start in UTC."""
    return datetime.now(UTC).strftime("live-%Y%m%dT%H%M%SZ")
