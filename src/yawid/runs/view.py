"""A finished run in Rerun, as it is drawn during a run."""

from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Ints
from yawid.errors import SourceError
from yawid.sinks.base import Abort, Done, Found, FoundBare
from yawid.sinks.door import say
from yawid.sinks.mcap.reader import McapRun, open_run
from yawid.sinks.rerun.sink import RerunSink
from yawid.sinks.rerun.web import web_viewer

NEAR_S: Final = 2.0
"""A manoeuvre's first and last sample lie at most this far from its date; boot time selects them.
"""


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
        warn=None,
        path=save,
        force=force,
    )
    try:
        _show(run, sink)
    except BaseException:
        sink.take(Abort(discard=True))
        raise


def view_in_browser(mcap: Path) -> None:
    """Show a run in Rerun's own web viewer, which is served until Ctrl-C.

    Raises:
        SourceError: the MCAP cannot be read, was not finished or is not the file of a run.
        SinkError: there is no viewer.
    """
    open_run(mcap)  # it raises before a browser opens
    with web_viewer() as (address, wait), suppress(KeyboardInterrupt):
        view(mcap, target=address)
        say("Ctrl-C ends it")
        wait()


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
        else:
            span_ns.append(round(unix_s * 1e9))
    return span_ns[0], span_ns[1]
