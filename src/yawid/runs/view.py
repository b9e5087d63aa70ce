"""A finished run in the Rerun viewer: what the file holds, drawn as it was drawn during the run."""

from pathlib import Path

from yawid.errors import SinkError
from yawid.sinks.mcap.reader import McapRun, open_run
from yawid.sinks.rerun.sink import RerunSink


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
    for block in run.blocks():
        sink.write(block.samples, block.estimates, block.modes)
    for line in run.log:
        sink.log(line.unix_ns, line.level, line.text)
    sink.finish(run.summary, {})


def _never(text: str) -> None:
    raise SinkError(text)  # not reached: a viewer that is needed fails by itself
