"""A finished run in a viewer: in Rerun as it was drawn during the run, or in another program.

PlotJuggler 3 and Foxglove read the MCAP themselves; how they are to draw it stands in the layouts,
package data beside this room.
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
from yawid.sinks.mcap.reader import McapRun, open_run
from yawid.sinks.mcap.schemas import FLIGHT, MANOEUVRE, MODES, SAMPLE, VERDICT, estimate_topics
from yawid.sinks.rerun.sink import RerunSink

NEAR_S: Final = 2.0
"""Within which of its date a manoeuvre's sample is looked for by boot time."""
LAYOUTS: Final = Path(__file__).parents[1] / "layouts"
PLOTJUGGLER, FOXGLOVE = LAYOUTS / "plotjuggler.xml", LAYOUTS / "foxglove.json"
"""Of a run with the default orders and methods."""
START_S: Final = 1.0
"""Within which a program that cannot start has ended."""


def view(
    mcap: Path, save: Path | None = None, target: str = "spawn", *, force: bool = False
) -> None:
    """Show a run: in a recording ``save``, or else in the viewer ``target`` (spawn or an address).

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not a run's.
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
        sink.discard()
        raise


def view_in_plotjuggler(mcap: Path) -> str:
    """Start PlotJuggler on a run, with a layout of what is in it; return what to tell of it.

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not a run's.
        SinkError: there is no PlotJuggler, or it does not start.
    """
    run = open_run(mcap)
    program = shutil.which("plotjuggler")
    if program is None:
        raise SinkError(
            "PlotJuggler is not here (no plotjuggler on PATH): get it from https://plotjuggler.io; "
            f"by hand: load {mcap} without /yawid/log, then the layout {PLOTJUGGLER}"
        )
    with tempfile.NamedTemporaryFile("wb", suffix=".xml", prefix="yawid-", delete=False) as file:
        file.write(plotjuggler_layout(run))
    _start(program, "--nosplash", "--layout", file.name)
    return f"PlotJuggler shows {mcap} by {file.name}{_unusable(run)}"


def view_in_foxglove(mcap: Path) -> str:
    """Start Foxglove, or Lichtblick, its open-source sibling, on a run; return what is left to do.

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not a run's.
        SinkError: there is none of them, or it does not start.
    """
    run = open_run(mcap)
    program = shutil.which("foxglove-studio") or shutil.which("lichtblick")
    if program is None:
        raise SinkError(
            "Foxglove is not here (no foxglove-studio or lichtblick on PATH): get it from "
            f"https://foxglove.dev/download, or drop {mcap} on https://app.foxglove.dev in a "
            f"browser; the layout to import there: {FOXGLOVE}"
        )
    _start(program, str(mcap.absolute()))
    told = f"Foxglove shows {mcap}; it takes a layout by its menu alone, Import from file"
    return f"{told}: {FOXGLOVE}{_unusable(run)}"


VIEWERS: Final[dict[str, Callable[[Path], str]]] = {
    "plotjuggler": view_in_plotjuggler,
    "foxglove": view_in_foxglove,
}
"""Programs other than Rerun, by what ``--in`` calls them."""


def plotjuggler_layout(run: McapRun) -> bytes:
    """Return PlotJuggler's layout without the curves that a run has not, and with its file in it.

    It asks a question for each file named on its command line, and none for one in the layout.
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
    """Tell whether a run's file has a curve: a topic, a slash, a field, a slash, its field."""
    topics, grid = {VERDICT}, run.grid
    if grid is not None:
        topics |= {SAMPLE, MODES, *estimate_topics(grid.methods).values()}
    if run.summary.manoeuvres:
        topics |= {MANOEUVRE, FLIGHT}
    topic, _, parameter = curve.partition("/parameters/")
    if parameter:
        tells = "Estimate.parameters" in run.metadata.get("units", {})  # older files do not
        return tells and grid is not None and parameter in grid.parameters and topic in topics
    return topic.rpartition("/")[0] in topics


def _start(program: str, *arguments: str) -> None:
    """Start a program that goes on by itself.

    Raises:
        SinkError: it does not start, or has failed already.
    """
    quiet = subprocess.DEVNULL
    try:
        process = subprocess.Popen(
            [program, *arguments], stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True
        )
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
        sink.start(run.grid)
    boot_us, unix_ns = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for block in run.blocks():
        sink.write(block.samples, block.estimates, block.modes)
        boot_us.append(block.samples.boot_us)
        unix_ns.append(block.samples.unix_ns)
    times = np.concatenate(boot_us), np.concatenate(unix_ns)
    for found in run.summary.manoeuvres or ():
        try:
            sink.manoeuvre(found, _span_ns(found, *times))
        except (ValueError, OverflowError) as error:
            what = f"the times of manoeuvre {found.n}: {error}"
            raise SourceError(f"{run.path} is not as yawid writes it: {what}") from error
    for line in run.log:
        sink.log(line.unix_ns, line.level, line.text)
    sink.finish(run.summary, {})


def _span_ns(found: Manoeuvre, boot_us: Ints, unix_ns: Ints) -> tuple[int, int]:
    """Return Unix time of a manoeuvre's first and last sample, of all samples' times (n,).

    Raises:
        ValueError: its date is none.
    """
    # Where no date is known the samples' Unix time is that since boot.
    text = found.date or datetime.fromtimestamp(found.from_s, UTC).isoformat()
    date = datetime.fromisoformat(text)
    begin_s = date.replace(tzinfo=date.tzinfo or UTC).timestamp()
    ends = (found.from_s, begin_s), (found.to_s, begin_s + found.duration_s)
    span_ns = []
    for boot_s, unix_s in ends:
        # The date may be a rounded one; two boots may count the same seconds, not at one time.
        near = np.flatnonzero(np.abs(unix_ns / 1e9 - unix_s) < NEAR_S)
        if len(near):
            nearest = near[np.argmin(np.abs(boot_us[near] / 1e6 - boot_s))]
            span_ns.append(int(unix_ns[nearest]))
        else:  # a recovered file may have lost them
            span_ns.append(round(unix_s * 1e9))
    return span_ns[0], span_ns[1]


def _never(text: str) -> None:
    raise SinkError(text)  # not reached: a viewer that is needed fails by itself
