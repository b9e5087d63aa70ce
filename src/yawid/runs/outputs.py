"""Where a run writes, and the facts about its origin that every output holds."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from itertools import count
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import msgspec

from yawid.answers.heard import PARAMETERS
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import RunSummary
from yawid.config.run import RunConfig
from yawid.errors import SinkError, YawidError
from yawid.pipeline import Pipeline
from yawid.results.advice import advised
from yawid.runs.versions import versions
from yawid.sinks.base import Abort, Done, Sink
from yawid.sinks.door import say
from yawid.sinks.mcap.sink import McapSink
from yawid.sinks.rerun.sink import RerunSink
from yawid.sinks.rerun.web import web_viewer
from yawid.system.part_file import Disk, check_free
from yawid.system.stores import Place

if TYPE_CHECKING:
    from yawid.runs.job import Recording

SIGN = "positive rudder = nose right, positive yaw rate = nose right"


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where a run writes: the folder, the name of its files, and which files are written.

    Where ``sink`` is given no file is written: the sink takes everything. ``reading`` says how the
    log is read where that is not the usual way. Only of files that are ``kept`` the summary has the
    names.
    """

    folder: Path
    name: str
    rerun: str = "off"
    force: bool = False
    record: bool = True
    sink: Sink | None = None
    kept: bool = True
    reading: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_viewer(self) -> bool:
        """Whether a viewer shows the run while it goes on."""
        return self.rerun not in ("off", "save")

    def path(self, suffix: str) -> Path:
        """Return the absolute path of one output."""
        return (self.folder / f"{self.name}{suffix}").absolute()

    def files(self) -> dict[str, str]:
        """Return the paths of the MCAP and the Rerun recording, by "mcap" and "rrd"."""
        if self.sink is not None or not self.kept:
            return {}
        rrd = {"rrd": str(self.path(".rrd"))} if self.rerun == "save" else {}
        return {"mcap": str(self.path(".mcap"))} | rrd


def output_names(logs: Sequence[Place]) -> list[str]:
    """Return a name for each log's outputs: its stem, with the folder's name where two agree.

    What was cut off (``x.tlog.part``) has the name that it would have had.
    """
    stems = [Path(log.name.removesuffix(".part")).stem for log in logs]
    names: list[str] = []
    for log, stem in zip(logs, stems, strict=True):
        name = (
            stem
            if stems.count(stem) == 1
            else f"{PurePath(str(log.absolute())).parent.name}-{stem}"
        )
        count = names.count(name)
        names.append(f"{name}-{count + 1}" if count else name)
    return names


def among_files(
    outputs: Outputs, config: RunConfig, source: "Recording", file: Path
) -> tuple[Outputs, str | None]:
    """Return where a run may write next to files that exist, and why it may not, if so.

    A run of the same log with the same options is replaced; one with other options stays, and the
    new one gets the next number in its name. Everything else stays unless ``force`` is set.
    ``file`` is the one that is being read, which is never replaced.
    """
    if outputs.sink is not None:
        return outputs, None
    outputs = replace(outputs, reading=source.reading)
    for number in count(1):
        named = replace(outputs, name=f"{outputs.name}-{number}") if number > 1 else outputs
        mcap, written = named.path(".mcap"), [Path(path) for path in named.files().values()]
        there = [path for path in written if path.exists()]
        before, made = None, None
        if there and not mcap.is_dir():
            before, made = _made(mcap), (source.log_sha256(), source.reading, config)
            is_other = before is None or before[0] is None or before[0] != made[0]
            if number == 1 and not outputs.force and is_other:
                what = "is of another log" if before else "is no run of this log"
                return named, f"{there[0]} exists and {what}: --force overwrites it"
            if before != made and not (number == 1 and outputs.force):
                continue
        if number > 1:
            say(f"{outputs.path('.mcap')} was made with other options: this is {mcap.name}")
        if any(path.samefile(file) for path in there):
            return named, f"{file} would be overwritten by its own results: choose another --out"
        others = {named.path(suffix) for suffix in (".rrd", ".html")} - {*written}
        if before != made and (old := sorted(path.name for path in others if path.exists())):
            say(f"of another run than {mcap.name} will be, and kept: {', '.join(old)}")
        return replace(named, force=outputs.force or bool(there)), None
    raise AssertionError("names do not end")


def _made(mcap: Path) -> tuple[str | None, Mapping[str, str], RunConfig] | None:
    """Return the hash of a run's log, how it was read, and the options; None without a run."""
    from yawid.sinks.mcap.reader import log_sha256_of, open_run, reading_of  # seldom needed

    try:
        run = open_run(mcap, head=True)
    except YawidError:
        return None
    return log_sha256_of(run), reading_of(run), run.config


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
            sink.take(Abort(discard=True))
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
    if outputs.reading:
        metadata["reading"] = outputs.reading
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


@contextmanager
def served(outputs: Outputs) -> Iterator[Outputs]:
    """Serve Rerun's web viewer while the context lasts, where that is asked for; it is the viewer.

    Raises:
        SinkError: it does not start.
    """
    if outputs.rerun != "serve":
        yield outputs
        return
    with web_viewer() as (address, _):
        yield replace(outputs, rerun=address)


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
        PARAMETERS: parameters,
        "summary.json": json.dumps(summary.to_json()).encode(),
    }
    pipeline.pass_on(Done(summary, attachments))
    return summary


def refused(summary: RunSummary, reason: Reason) -> RunSummary:
    """Return the summary with a fatal reason put first in its verdict, also in the flight's."""

    def marked(verdict: Verdict | None) -> Verdict:
        reasons = [] if verdict is None else verdict.reasons
        return Verdict.of([reason, *reasons], None if verdict is None else verdict.method)

    flights = [
        msgspec.structs.replace(each, verdict=marked(each.verdict)) for each in summary.by_loop
    ]
    return advised(
        msgspec.structs.replace(
            summary,
            verdict=marked(summary.verdict),
            flight=flights[0] if flights else None,
            flights=flights if summary.flights else None,
        )
    )


def parameters_of(pipeline: Pipeline) -> bytes:
    """Return the vehicle's parameters, one on each line, as they are attached to a run's file."""
    values = pipeline.channels.parameters.values
    return "".join(f"{name} {value!r}\n" for name, value in sorted(values.items())).encode()
