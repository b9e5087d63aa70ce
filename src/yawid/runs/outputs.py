"""Where a run writes, and the facts about its origin that every output holds."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgspec

from yawid.answers.run_summary import ReasonSummary, RunSummary, VerdictSummary
from yawid.config.run import RunConfig
from yawid.errors import SinkError
from yawid.pipeline import Pipeline
from yawid.results.advice import advised
from yawid.results.reasons import Reason, Verdict
from yawid.runs.versions import versions
from yawid.sinks.base import Sink
from yawid.sinks.door import say
from yawid.sinks.mcap.sink import McapSink
from yawid.sinks.rerun.sink import RerunSink
from yawid.system.part_file import Disk, check_free
from yawid.system.stores import Place

SIGN = "positive rudder = nose right, positive yaw rate = nose right"


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where a run writes: the folder, the name of its files, and which files are written.

    Where ``sink`` is given no file is written: the sink takes everything.
    """

    folder: Path
    name: str
    rerun: str = "off"
    force: bool = False
    record: bool = True
    sink: Sink | None = None

    @property
    def has_viewer(self) -> bool:
        """Whether a viewer shows the run while it goes on."""
        return self.rerun not in ("off", "save")

    def path(self, suffix: str) -> Path:
        """Return the absolute path of one output."""
        return (self.folder / f"{self.name}{suffix}").absolute()

    def files(self) -> dict[str, str]:
        """Return the paths of the MCAP and the Rerun recording, by "mcap" and "rrd"."""
        if self.sink is not None:
            return {}
        rrd = {"rrd": str(self.path(".rrd"))} if self.rerun == "save" else {}
        return {"mcap": str(self.path(".mcap"))} | rrd


def output_names(logs: Sequence[Place]) -> list[str]:
    """Return a name for each log's outputs: its stem, with the folder's name where two agree."""
    stems = [log.stem for log in logs]
    names: list[str] = []
    for log, stem in zip(logs, stems, strict=True):
        name = stem if stems.count(stem) == 1 else f"{log.absolute().parent.name}-{stem}"
        count = names.count(name)
        names.append(f"{name}-{count + 1}" if count else name)
    return names


def open_sinks(config: RunConfig, outputs: Outputs) -> list[Sink]:
    """Open every sink of a replay: files and viewer, or the one sink given instead.

    Raises:
        SinkError: the folder or a file cannot be written.
    """
    if outputs.sink is not None:
        return [outputs.sink]
    sinks: list[Sink] = [open_mcap(config, outputs)]
    with whole_or_none(sinks):
        sinks += open_rerun(outputs)
    return sinks


@contextmanager
def whole_or_none(sinks: Sequence[Sink]) -> Iterator[None]:
    """Delete what a failing run has written: half a file is of no use, and its source remains."""
    try:
        yield
    except BaseException:
        for sink in sinks:
            sink.discard()
        raise


def keep_as_interrupted(sinks: Sequence[Sink], outputs: Outputs) -> dict[str, str]:
    """Name the files of a run that was cut short ``NAME.interrupted``; return their paths.

    Raises:
        SinkError: such a file exists and may not be overwritten.
    """
    kept = replace(outputs, name=f"{outputs.name}.interrupted")
    for sink in sinks:
        if sink.path is not None:
            sink.path = kept.path(sink.path.suffix)
            check_free(sink.path, force=outputs.force)
    return kept.files()


def open_mcap(config: RunConfig, outputs: Outputs, disk: Disk | None = None) -> McapSink:
    """Open the MCAP file with its first metadata: configuration, versions, sign convention.

    Raises:
        SinkError: the folder or the file cannot be written.
    """
    metadata: dict[str, str | Mapping[str, object]] = {
        "configuration": asdict(config),
        "versions": versions(),
        "sign": SIGN,
    }
    _make_folder(outputs.folder)
    return McapSink(outputs.path(".mcap"), metadata, force=outputs.force, disk=disk)


def open_rerun(outputs: Outputs) -> list[Sink]:
    """Open the Rerun recording or viewer, if one is asked for.

    Raises:
        SinkError: the folder or the recording cannot be written.
    """
    if outputs.rerun == "off":
        return []
    _make_folder(outputs.folder)
    return [
        RerunSink(
            outputs.rerun,
            path=outputs.path(".rrd"),
            name=outputs.name,
            warn=say,
            force=outputs.force,
        )
    ]


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise SinkError(
            f"{folder} is a file: give --out a folder, or a name for a new one"
        ) from error
    except OSError as error:
        raise SinkError(f"cannot make the folder {folder}: {error.strerror}") from error


def finish(
    pipeline: Pipeline, summary: RunSummary, files: dict[str, str], parameters: bytes
) -> RunSummary:
    """Add the file names to the summary, finish every sink with it and return it."""
    summary = msgspec.structs.replace(summary, files=files or None)
    attachments = {
        "configuration.toml": pipeline.config.to_toml().encode(),
        "parameters.txt": parameters,
        "summary.json": json.dumps(summary.to_json()).encode(),
    }
    for sink in pipeline.sinks:
        sink.finish(summary, attachments)
    return summary


def refused(summary: RunSummary, verdict: Verdict, reason: Reason) -> tuple[RunSummary, Verdict]:
    """Return the summary and the verdict with a fatal reason put first, also the flight's."""
    said = ReasonSummary(reason.id, reason.weight, reason.text)
    marked = msgspec.structs.replace(summary, verdict=_with(said, summary.verdict))
    if (flight := summary.flight) is not None:
        flight, *flights = (
            msgspec.structs.replace(each, verdict=_with(said, each.verdict))
            for each in (flight, *(summary.flights or ()))
        )
        marked = msgspec.structs.replace(marked, flight=flight, flights=flights or None)
    return advised(marked), Verdict.of([reason, *verdict.reasons], verdict.method)


def _with(fatal: ReasonSummary, verdict: VerdictSummary) -> VerdictSummary:
    reasons = [fatal, *verdict.reasons]
    return msgspec.structs.replace(verdict, usable=False, reasons=reasons)


def parameters_of(pipeline: Pipeline) -> bytes:
    """Return the vehicle's parameters, one on each line, as they are attached to a run's file."""
    values = pipeline.channels.parameters.values
    return "".join(f"{name} {value!r}\n" for name, value in sorted(values.items())).encode()
