"""One Rerun recording: its target, and the data that are sent to it.

Rerun writes a file through a pipe, so that a failed write is noticed: its own writer stops there,
and whoever then closes the recording may wait forever. Errors are raised here as rerun raises them;
:mod:`yawid.sinks.rerun.sink` decides what they mean for the run.
"""

import os
import shutil
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Final
from urllib.parse import urlsplit

import msgspec
import numpy as np

import rerun as rr
from yawid.answers.run_summary import Bare, DutchRoll, Flight, Manoeuvre, RunSummary
from yawid.blocks import Floats, Ints, SampleBlock
from yawid.physics.modes import pair_poles
from yawid.sinks.base import (
    Abort,
    Done,
    Event,
    Flush,
    Found,
    FoundBare,
    Grid,
    LogLine,
    RunRows,
    Sink,
)
from yawid.sinks.pages import Note, Page, to_text
from yawid.sinks.palette import BAD, BARE, MODEL, RUDDER, rgba
from yawid.sinks.rerun.blueprint import TIMELINE, blueprint, log_furniture
from yawid.sinks.rerun.panels import (
    OF_BARE,
    REFUSED,
    USABLE,
    Marks,
    Style,
    bar_style,
    crosses_at,
    group_rows,
    manoeuvre_rows,
    series_styles,
)
from yawid.sinks.run_page import manoeuvre_parts, summary_page
from yawid.sinks.words import lateral_says
from yawid.system.files import IS_POSIX

_PIECE: Final = 1 << 16  # bytes; a pipe of Linux holds no more


class FilePipe:
    """Writes all that comes through a pipe to a file; ``name`` opens the pipe like a file.

    After a failed write the pipe is still read to its end, so that its writer never waits. Where a
    pipe has no name (Windows), ``name`` is the file itself, and a failed write is not noticed.
    """

    def __init__(self, path: Path) -> None:
        self._failed = ""
        self._thread = Thread(target=self._pass_on, name="rrd", daemon=True)
        if not IS_POSIX:
            self.name, self._own = str(path), -1
            return
        self._file = path.open("wb", buffering=0)
        self._end, self._own = os.pipe()
        self.name = f"/dev/fd/{self._own}"
        self._thread.start()

    def release(self) -> None:
        """Close the own end: the pipe then ends as soon as whoever opened ``name`` closes it."""
        if self._own >= 0:
            os.close(self._own)

    def check(self) -> None:
        """Check that no write has failed until now.

        Raises:
            RuntimeError: one has, with the system's reason.
        """
        if self._failed:
            raise RuntimeError(self._failed)

    def finish(self, timeout_s: float) -> None:
        """Wait until the file has everything that came.

        Raises:
            RuntimeError: a write has failed, or the disk needs more than ``timeout_s``.
        """
        if self._own >= 0:
            self._thread.join(timeout_s)
        self.check()
        if self._thread.is_alive():
            raise RuntimeError(f"the disk took more than {timeout_s:g} s")

    def _pass_on(self) -> None:
        while piece := os.read(self._end, _PIECE):
            try:
                while piece and not self._failed:
                    piece = piece[self._file.write(piece) :]
            except OSError as error:
                self._failed = error.strerror or str(error)
        os.close(self._end)
        with suppress(OSError):
            self._file.close()


APPLICATION: Final = "yawid"
DEFAULT_PORT: Final = 9876  # rerun's default
REACH_S: Final = 2.0  # how long a viewer may take to accept a connection, or to take what is sent
FINISH_S: Final = 30.0
BATCH_ROWS: Final = 1000  # a call takes the same time for one row as for some hundred
_LEVELS: Final = {"debug": "DEBUG", "info": "INFO", "warning": "WARN", "error": "ERROR"}

Batch = tuple[Ints, Ints, dict[str, Floats]]  # boot_us (n,), unix_ns (n,), lines by entity (n, m)


class RerunView(Sink):
    """A recording that goes to ``target``: a file (Path), ``spawn``, or the address of a viewer."""

    def __init__(self, target: str | Path, name: str) -> None:
        self._file: FilePipe | None = None
        self._batch: list[Batch] = []
        self._boot_offset_us: int | None = None  # boot time minus Unix time
        self._manoeuvres: list[Manoeuvre] = []
        self._bars: set[str] = set()
        self._colours: dict[str, dict[str, str]] = {}
        # It comes first: it also loads code for which a live run's first rows would wait 0.2 s.
        first = blueprint()
        self._recording = rr.RecordingStream(APPLICATION)
        if not rr.is_enabled(self._recording):
            raise RuntimeError("rerun is switched off by the environment variable RERUN")
        if isinstance(target, Path):
            self._file = FilePipe(target)
            try:
                self._recording.save(self._file.name, default_blueprint=first)
            finally:
                self._file.release()
        else:
            address = _spawn_viewer(self._recording) if target == "spawn" else target
            _check_listening(address)
            self._recording.connect_grpc(address, default_blueprint=first)
        self._recording.send_recording_name(name)
        log_furniture(self._recording)
        self._show("verdict", [Note("There is no verdict yet: the run goes on.")])
        self._show_manoeuvres([])

    def take(self, event: Event) -> None:
        """See :meth:`yawid.sinks.base.Sink.take`; attachments and lateral motion are not used."""
        match event:
            case RunRows():
                self._write(event)
            case Flush():
                self._flush()
            case Grid():
                self._start(event)
            case LogLine():
                self._log(event)
            case Found():
                self._find(event.manoeuvre, event.span_ns)
            case FoundBare():
                self._find_bare(event.n, event.bare, event.span_ns)
            case Done():
                self._finish(event.summary)
            case Abort():
                self._close()

    def _start(self, grid: Grid) -> None:
        """Set the names and colours of the lines."""
        self._marks, self._grid = Marks(grid), grid
        for entity, style in series_styles(grid).items():
            self._style(entity, style)
        for name, colour in (("poles", MODEL), ("bare", BARE)):
            lines = rr.LineStrips2D.from_fields(colors=rgba(colour), radii=rr.Radius.ui_points(1.2))
            self._recording.log(f"z_plane/{name}", lines, static=True)
        zeros = rr.Points2D.from_fields(colors=rgba(MODEL), radii=rr.Radius.ui_points(4.0))
        self._recording.log("z_plane/zeros", zeros, static=True)

    def _write(self, block: RunRows) -> None:
        """Take a block; its rows are sent by the thousand, or by a flush."""
        samples, estimates, modes = block
        self._boot_offset_us = int(samples.boot_us[-1] - samples.unix_ns[-1] // 1000)
        primary, *_ = estimates.values()
        rows = group_rows(self._grid.parameters, samples, primary, modes)
        self._batch.append((samples.boot_us, samples.unix_ns, rows))
        for lane, row, state, colour in self._marks.changes(samples, primary):
            self._colour(lane, state, colour)
            columns = rr.StateChange.columns(state=[state])
            self._recording.send_columns(f"state/{lane}", _times(samples, np.array([row])), columns)
        for entity, places, columns in self._marks.panels(block):
            self._recording.send_columns(entity, _times(samples, places), columns)
        if sum(len(boot_us) for boot_us, *_ in self._batch) >= BATCH_ROWS:
            self._send()

    def _find(self, found: Manoeuvre, span_ns: tuple[int, int]) -> None:
        """Show a manoeuvre: a state in its lane, its Dutch roll as bars, a row in the table."""
        self._manoeuvres.append(found)
        self._show_manoeuvres(self._manoeuvres)
        boot_us, unix_ns = _span(found, span_ns)
        usable = found.verdict.usable
        state = f"{found.n} usable" if usable else f"{found.n} not usable"
        self._colour("manoeuvre", state, RUDDER if usable else BAD)
        lane = rr.StateChange.columns(state=[state, ""])  # an empty state leaves a gap
        times = [_boot_times(boot_us), _unix_times(unix_ns)]
        self._recording.send_columns("state/manoeuvre", times, lane)
        if found.dutch_roll is not None:
            self._send_bars_of(found.dutch_roll, USABLE if usable else REFUSED, boot_us, unix_ns)

    def _find_bare(self, n: int, bare: Bare, span_ns: tuple[int, int]) -> None:
        """Show the bare airframe of manoeuvre ``n``: bars next to its Dutch roll, and poles."""
        at = next(i for i, each in enumerate(self._manoeuvres) if each.n == n)
        self._manoeuvres[at] = msgspec.structs.replace(self._manoeuvres[at], lateral=bare)
        self._show_manoeuvres(self._manoeuvres)
        if (roll := bare.dutch_roll) is None:
            return
        boot_us, unix_ns = _span(self._manoeuvres[at], span_ns)
        self._send_bars_of(roll, OF_BARE, boot_us, unix_ns)
        z = pair_poles(roll.wn_rad_s, roll.zeta, self._grid.sample_time_s)
        columns = rr.LineStrips2D.columns(strips=crosses_at(z)).partition([len(z)])
        end = [_boot_times(boot_us[1:]), _unix_times(unix_ns[1:])]
        self._recording.send_columns("z_plane/bare", end, columns)

    def _log(self, said: LogLine) -> None:
        """Add a line to the log, also on the vehicle's clock once that is known."""
        times = [_unix_times(np.array([said.unix_ns]))]
        if self._boot_offset_us is not None:
            times.append(_boot_times(np.array([said.unix_ns // 1000 + self._boot_offset_us])))
        line = rr.TextLog.columns(text=[said.text], level=[_LEVELS[said.level]])
        self._recording.send_columns("log", times, line)

    def _flush(self) -> None:
        """Send waiting rows to a viewer; a file gets whole batches only, which keeps it small.

        Raises:
            RuntimeError: the viewer is gone.
        """
        if self._file is None:
            self._send()
            self._recording.flush(timeout_sec=REACH_S)

    def _finish(self, summary: RunSummary) -> None:
        """Send the verdict and waiting rows, and close.

        Raises:
            RuntimeError: not everything could be written.
        """
        self._show("verdict", summary_page(summary))
        self._show_manoeuvres(summary.manoeuvres or self._manoeuvres, summary.by_loop)
        self._close()

    def _close(self) -> None:
        """Send waiting rows and close."""
        self._send()
        self._recording.flush(timeout_sec=FINISH_S if self._file else REACH_S)
        self._recording.disconnect()
        if self._file is not None:
            self._file.finish(FINISH_S)

    def _style(self, entity: str, style: Style) -> None:
        """Set the names, colours and widths of lines, which show all values within a pixel.

        By default the viewer draws their mean: doublets far too small, and noise within its bounds.
        """
        lines = rr.SeriesLines(
            names=style.names,
            colors=style.colours,
            widths=style.widths,
            aggregation_policy=rr.components.AggregationPolicy.MinMax,
        )
        self._recording.log(entity, lines, static=True)

    def _send_bars_of(self, roll: DutchRoll, kind: str, boot_us: Ints, unix_ns: Ints) -> None:
        """Send the bars of a manoeuvre, which end with it."""
        if kind not in self._bars:
            self._bars.add(kind)
            for name in ("wn", "zeta"):
                self._style(f"dutch_roll/{name}/{kind}", bar_style(name, kind))
        after = [_boot_times(np.append(boot_us, boot_us[1] + 1))]
        after.append(_unix_times(np.append(unix_ns, unix_ns[1] + 1000)))
        for entity, rows in manoeuvre_rows(roll, kind).items():
            self._recording.send_columns(entity, after, rr.Scalars.columns(scalars=rows))

    def _show_manoeuvres(self, found: Sequence[Manoeuvre], flights: Sequence[Flight] = ()) -> None:
        """Show the manoeuvres as a table, and below it their bare airframes."""
        bare = [
            Note(f"{each.n}: {lateral_says(each.lateral)}")
            for each in found
            if each.lateral is not None
        ]
        table = manoeuvre_parts(found, flights) if found else [Note("No manoeuvre.")]
        self._show("manoeuvres", [*table, *bare])

    def _show(self, entity: str, page: Page) -> None:
        """Show a page as the terminal does, in letters of one width."""
        text = f"```\n{to_text(page)}```\n"
        document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
        self._recording.log(entity, document, static=True)

    def _colour(self, lane: str, state: str, colour: str) -> None:
        """Set a state's colour when it occurs first; by default the viewer chooses any colour."""
        known = self._colours.setdefault(lane, {})
        if state not in known:
            known[state] = colour
            colours = [rgba(each) for each in known.values()]
            style = rr.StateConfiguration(values=list(known), colors=colours)
            self._recording.log(f"state/{lane}", style, static=True)

    def _send(self) -> None:
        if not self._batch:
            return
        boot_us, unix_ns, blocks = zip(*self._batch, strict=True)
        self._batch = []
        times = [_boot_times(np.concatenate(boot_us)), _unix_times(np.concatenate(unix_ns))]
        for entity in blocks[0]:
            values = np.concatenate([block[entity] for block in blocks])
            self._recording.send_columns(entity, times, rr.Scalars.columns(scalars=values))
        if self._file is not None:
            # Rerun writes in its own thread; without this, waiting rows would fill the memory.
            self._recording.flush(timeout_sec=FINISH_S)
            self._file.check()


def _span(found: Manoeuvre, span_ns: tuple[int, int]) -> tuple[Ints, Ints]:
    """Return the boot times in us and Unix times in ns (2,) of a manoeuvre's begin and end."""
    boot_us = np.rint(np.array([found.from_s, found.to_s]) * 1e6).astype(np.int64)
    return boot_us, np.array(span_ns, np.int64)


def _times(samples: SampleBlock, rows: Ints) -> list[rr.TimeColumn]:
    return [_boot_times(samples.boot_us[rows]), _unix_times(samples.unix_ns[rows])]


def _boot_times(boot_us: Ints) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, duration=boot_us.astype("timedelta64[us]"))


def _unix_times(unix_ns: Ints) -> rr.TimeColumn:
    return rr.TimeColumn("unix_time", timestamp=unix_ns.astype("datetime64[ns]"))


def _spawn_viewer(recording: rr.RecordingStream) -> str:
    """Start a viewer, or find one that listens already, and return its address.

    Raises:
        RuntimeError: there is no screen, or the viewer does not start.
    """
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        # Without this check rerun starts a viewer that fails, and waits six seconds for it.
        raise RuntimeError("there is no screen (neither DISPLAY nor WAYLAND_DISPLAY is set)")
    # The viewer is part of rerun-sdk, whose environment may not be on PATH.
    executable = shutil.which("rerun", path=str(Path(sys.executable).parent))
    # Rerun asks whether the recording is enabled, and takes a missing one for a no.
    rr.spawn(port=DEFAULT_PORT, connect=False, executable_path=executable, recording=recording)
    return f"rerun+http://127.0.0.1:{DEFAULT_PORT}/proxy"


def _check_listening(address: str) -> None:
    """Check that a viewer listens; rerun itself would try for five seconds.

    Raises:
        OSError: nobody listens there.
    """
    url = urlsplit(address)
    if url.hostname:  # else rerun reports what is wrong with the address
        where = url.hostname, url.port or DEFAULT_PORT
        socket.create_connection(where, timeout=REACH_S).close()
