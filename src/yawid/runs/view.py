"""A finished run in a viewer: in Rerun as it is drawn during a run, or in another program.

PlotJuggler 3 and Foxglove read the MCAP themselves. How they draw it is described by layouts, which
are package data in the folder ``layouts``.
"""

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Ints
from yawid.errors import SinkError, SourceError
from yawid.sinks.base import Abort, Done, Found, FoundBare
from yawid.sinks.mcap.reader import McapRun, open_run
from yawid.sinks.mcap.schemas import FLIGHT, MANOEUVRE, MODES, SAMPLE, VERDICT, estimate_topics
from yawid.sinks.rerun.sink import RerunSink
from yawid.system.processes import OWN_GROUP

NEAR_S: Final = 2.0
"""A manoeuvre's first and last sample lie at most this far from its date; boot time selects them.
"""
LAYOUTS: Final = Path(__file__).parents[1] / "layouts"
PLOTJUGGLER, FOXGLOVE = LAYOUTS / "plotjuggler.xml", LAYOUTS / "foxglove.json"
"""Layouts for a run with the default orders and methods."""
START_S: Final = 1.0
"""A program that ends with an error within this time has failed to start."""


def view(
    mcap: Path, save: Path | None = None, target: str = "spawn", *, force: bool = False
) -> None:
    """Write a run to the Rerun recording ``save``, or show it in the viewer ``target``.

    ``target`` is "spawn", which starts a viewer, or the address of one.

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not the file of a run.
        SinkError: there is no viewer, or the recording cannot be written.
    """
    run = open_run(mcap)
    sink = RerunSink(
        "save" if save is not None else target,
        name=mcap.stem,
        warn=_never,
        path=save,
        force=force,
        needed=True,
    )
    try:
        _show(run, sink)
    except BaseException:
        sink.take(Abort(discard=True))
        raise


def view_in_plotjuggler(mcap: Path) -> str:
    """Start PlotJuggler on a run, with a layout of the run's own curves; return a message.

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not the file of a run.
        SinkError: PlotJuggler is not installed, or it does not start.
    """
    run = open_run(mcap)
    program = shutil.which("plotjuggler")
    if program is None:
        raise SinkError(
            "PlotJuggler was not found (no plotjuggler on PATH): get it from "
            f"https://plotjuggler.io; by hand: load {mcap} without /yawid/log, then the layout "
            f"{PLOTJUGGLER}"
        )
    with tempfile.NamedTemporaryFile("wb", suffix=".xml", prefix="yawid-", delete=False) as file:
        file.write(plotjuggler_layout(run))
    _start(program, "--nosplash", "--layout", file.name)
    return f"PlotJuggler shows {mcap} by {file.name}{_unusable(run)}"


def view_in_foxglove(mcap: Path) -> str:
    """Start Foxglove, or its open-source fork Lichtblick, on a run; return what is left to do.

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not the file of a run.
        SinkError: neither is installed, or it does not start.
    """
    run = open_run(mcap)
    program = shutil.which("foxglove-studio") or shutil.which("lichtblick")
    if program is None:
        raise SinkError(
            "Foxglove was not found (no foxglove-studio or lichtblick on PATH): get it from "
            f"https://foxglove.dev/download, or drop {mcap} on https://app.foxglove.dev in a "
            f"browser; the layout to import there: {FOXGLOVE}"
        )
    _start(program, str(mcap.absolute()))
    text = f"Foxglove shows {mcap}; load the layout by its menu, Import from file"
    return f"{text}: {FOXGLOVE}{_unusable(run)}"


VIEWERS: Final[dict[str, Callable[[Path], str]]] = {
    "plotjuggler": view_in_plotjuggler,
    "foxglove": view_in_foxglove,
}
"""Viewers other than Rerun: the function that starts each, by its name in ``--in``."""


def plotjuggler_layout(run: McapRun) -> bytes:
    """Return PlotJuggler's layout without the curves that a run lacks, and with the run's file.

    PlotJuggler asks a question for each file named on its command line, none for one in a layout.
    """
    root = ET.fromstring(PLOTJUGGLER.read_bytes())
    equations = {each.get("name"): each for each in root.iter("snippet")}
    for curve in [each for plot in root.iter("plot") for each in plot]:
        name = curve.get("name", "")
        source = equations[name].findtext("linked_source", "") if name in equations else name
        if not _has(run, source):
            for parent in (*root.iter("plot"), *root.iter("customMathEquations")):
                for child in [each for each in parent if each.get("name") == name]:
                    parent.remove(child)
    loaded = ET.SubElement(root, "previouslyLoaded_Datafiles")
    file = ET.SubElement(loaded, "fileInfo", filename=str(run.path.absolute()), prefix="")
    file.extend(root.iter("plugin"))
    verdict = run.summary.deciding
    if not verdict.usable:
        reasons = ", ".join(reason.id for reason in verdict.fatal)
        next(root.iter("Tab")).set("tab_name", f"NOT USABLE: {reasons}")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root)


def _has(run: McapRun, curve: str) -> bool:
    """Return whether a run's file has a curve: TOPIC/FIELD, or TOPIC/parameters/NAME."""
    topics, grid = {VERDICT}, run.grid
    if grid is not None:
        topics |= {SAMPLE, MODES, *estimate_topics(grid.methods).values()}
    if run.summary.manoeuvres:
        topics |= {MANOEUVRE, FLIGHT}
    topic, _, parameter = curve.partition("/parameters/")
    if parameter:
        has_names = "Estimate.parameters" in run.metadata.get("units", {})  # older files lack them
        return has_names and grid is not None and parameter in grid.parameters and topic in topics
    return topic.rpartition("/")[0] in topics


def _start(program: str, *arguments: str) -> None:
    """Start a program that goes on running without this process.

    Raises:
        SinkError: it does not start, or it ends with an error within ``START_S``.
    """
    quiet = subprocess.DEVNULL
    try:
        process = subprocess.Popen(
            [program, *arguments], stdin=quiet, stdout=quiet, stderr=quiet,
            start_new_session=True, creationflags=OWN_GROUP,
        )  # fmt: skip
    except OSError as error:
        raise SinkError(f"cannot start {program}: {error.strerror}") from error
    try:
        code = process.wait(START_S)
    except subprocess.TimeoutExpired:
        return
    if code:
        raise SinkError(f"{program} ended at once with code {code}: is there a screen?")


def _unusable(run: McapRun) -> str:
    verdict = run.summary.deciding
    reasons = ", ".join(reason.id for reason in verdict.fatal)
    return "" if verdict.usable else f"\nnot usable: {reasons}"


def _show(run: McapRun, sink: RerunSink) -> None:
    if run.grid is not None:
        sink.take(run.grid)
    boot_us, unix_ns = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for block in run.blocks():
        sink.take(block)
        boot_us.append(block.samples.boot_us)
        unix_ns.append(block.samples.unix_ns)
    times = np.concatenate(boot_us), np.concatenate(unix_ns)
    for found in run.summary.manoeuvres or ():
        try:
            span_ns = _span_ns(found, *times)
            sink.take(Found(found, span_ns))
            if found.lateral is not None:
                sink.take(FoundBare(found.n, found.lateral, span_ns))
        except (ValueError, OverflowError) as error:
            what = f"the times of manoeuvre {found.n}: {error}"
            raise SourceError(f"{run.path} is not a file as yawid writes it: {what}") from error
    for line in run.log:
        sink.take(line)
    sink.take(Done(run.summary, {}))


def _span_ns(found: Manoeuvre, boot_us: Ints, unix_ns: Ints) -> tuple[int, int]:
    """Return the Unix times in ns of a manoeuvre's first and last sample.

    ``boot_us`` (n,) and ``unix_ns`` (n,) are the times of all samples of the run.

    Raises:
        ValueError: the manoeuvre's date cannot be read.
    """
    # Where no date is known the samples' Unix time is their time since boot.
    text = found.date or datetime.fromtimestamp(found.from_s, UTC).isoformat()
    date = datetime.fromisoformat(text)
    begin_s = date.replace(tzinfo=date.tzinfo or UTC).timestamp()
    ends = (found.from_s, begin_s), (found.to_s, begin_s + found.duration_s)
    span_ns = []
    for boot_s, unix_s in ends:
        # The date may be rounded. Two boots may count the same seconds, but not at the same date.
        near = np.flatnonzero(np.abs(unix_ns / 1e9 - unix_s) < NEAR_S)
        if len(near):
            nearest = near[np.argmin(np.abs(boot_us[near] / 1e6 - boot_s))]
            span_ns.append(int(unix_ns[nearest]))
        else:  # a recovered file may lack these samples
            span_ns.append(round(unix_s * 1e9))
    return span_ns[0], span_ns[1]


def _never(text: str) -> None:
    raise SinkError(text)  # not reached: the sink itself raises where a viewer is needed
