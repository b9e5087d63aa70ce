"""A finished run in the Rerun viewer: what the file holds, drawn as it was drawn during the run."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from yawid.blocks import Ints
from yawid.errors import SinkError, SourceError
from yawid.results.run_summary import Manoeuvre
from yawid.sinks.mcap.reader import McapRun, open_run
from yawid.sinks.rerun.sink import RerunSink

NEAR_S: Final = 2.0
"""Within which of its date a manoeuvre's sample is looked for by boot time."""


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
    date = datetime.fromisoformat(found.date)
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
