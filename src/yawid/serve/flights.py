"""The flights of a folder: which logs it holds, their answers, and which are being read.

All of it is done by one thread, the server's; only the pool's processes read logs. The answers are
kept in a small file, so that a folder of a thousand flights is shown at once.
"""

import os
import re
import shlex
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any, Final

import msgspec

from yawid.config.run import OF_RECORDS, RunConfig
from yawid.config.settings import COMMAND_LINE, check_settings, overruled
from yawid.dataset.schema import ANALYSIS_VERSION
from yawid.errors import ConfigError, SinkError
from yawid.fleet.pools import Here, workers_here
from yawid.fleet.spec import Spec
from yawid.fleet.worker import Task
from yawid.serve.tasks import UNREAD, Make, Read
from yawid.sources.formats import IN_FOLDERS, WITH_RECORDS
from yawid.system.part_file import Part, os_errors_as_sink_error, write_whole

OUT, INDEX, UPLOAD = "yawid-out", "serve.json", ".upload"
"""Below the folder: its runs and what is made of them; the kept list; a log that is not whole."""
TIMEOUT_S: Final = 600.0
MOST_WAITING: Final = 200
"""Logs dropped and not read yet; with more, an upload has to wait."""
LONGEST_NAME: Final = 120
"""Bytes of a name: file systems take 255, and yawid's own files have longer ones."""


class Row(msgspec.Struct, frozen=True):
    """A log in the list. Without an ``outcome`` it is not read yet; ``typed`` are its options.

    ``key`` is equal where the file has not changed since it was read.
    """

    name: str
    key: str
    modified: float
    typed: str = ""
    outcome: str = ""
    text: str = ""
    usable: bool = False
    wn: str = ""
    zeta: str = ""
    airspeed: str = ""
    date: str = ""
    asks: str = ""

    @property
    def when(self) -> str:
        """The date of the flight, or of its file where the log has none; it can be sorted by."""
        return (self.date or datetime.fromtimestamp(self.modified, UTC).isoformat())[:19]

    @property
    def has_columns(self) -> bool:
        """Whether it is a CSV or Parquet file, whose columns may have to be named."""
        return not self.name.lower().endswith(IN_FOLDERS)


def is_log(name: str) -> bool:
    """Return whether a file's name is one of a log, and a text: others could not be shown."""
    is_text = not re.search("[\ud800-\udfff]", name)
    return is_text and name.lower().endswith(WITH_RECORDS) and not name.startswith(".")


def safe_name(name: str) -> str:
    """Return a name for an upload: one component, without what a shell or a page could read.

    Raises:
        ConfigError: it is not the name of a log.
    """
    last = re.sub(r"[^\w .()+@=,-]", "_", re.split(r"[/\\]", name)[-1]).strip(". ")
    stem, end = Path(last).stem, Path(last).suffix
    if not is_log(last):
        raise ConfigError(f"the name must end in {', '.join(WITH_RECORDS)}")
    return stem.encode()[:LONGEST_NAME].decode(errors="ignore") + end


def typed_settings(line: str) -> dict[str, Any]:
    """Return the settings in a line of options, as they stand on the command line.

    Raises:
        ConfigError: the line is not understood.
    """
    try:
        words = [part for word in shlex.split(line)
                 for part in (word.split("=", 1) if word.startswith("--") else [word])]  # fmt: skip
        pairs = [*zip(words[::2], words[1::2], strict=True)]
    except ValueError as error:
        raise ConfigError(f"each option needs one value, as in --units deg: {error}") from error
    return check_settings({name.removeprefix("--"): value for name, value in pairs}, COMMAND_LINE)


class Flights:
    """The flights of ``folder``; ``spec`` is how each is read. ``stack`` ends the processes.

    ``version`` is another number whenever a row has changed.

    Raises:
        SinkError: the folder cannot be written, or another server has it.
    """

    def __init__(self, folder: Path, spec: Spec, stack: ExitStack) -> None:
        self.folder, self.out, self._spec = folder, folder / OUT, spec
        self.rows: dict[str, Row] = {}
        self.version = 0
        self._waiting: dict[str, bool] = {}
        self._reading: dict[str, tuple[str, Future[Any]]] = {}
        self._made: dict[tuple[str, str], Future[Any]] = {}
        self._made_by = f"{spec.config_hash} {ANALYSIS_VERSION}"
        self._with_records = any(name in spec.settings for name in OF_RECORDS)
        with os_errors_as_sink_error(self.out):
            self.out.mkdir(exist_ok=True)
        own = Part(self.out / INDEX, force=True, suffix=".lock")  # two would write the same runs
        stack.callback(own.remove)
        copies = self.out / "copies"
        self._reads = stack.enter_context(workers_here(None, copies))
        for _ in range(self._reads.threads):  # a folder has no answer, but its process is there
            self._reads.submit(Task(str(folder), spec, TIMEOUT_S))
        self._pages = Here(1, copies)
        stack.callback(self._pages.end)
        for left in folder.glob(f"*{UPLOAD}"):  # of a server that was killed
            if is_log(left.stem) and not left.is_symlink():
                with suppress(SinkError):
                    Part(left.with_suffix(""), force=True, suffix=UPLOAD).remove()
        with suppress(OSError, msgspec.DecodeError):
            kept = (self.out / INDEX).read_bytes()
            made_by, rows = msgspec.json.decode(kept, type=tuple[str, list[Row]])
            for row in rows:
                is_known = made_by == self._made_by and row.outcome != UNREAD
                again = Row(row.name, row.key, row.modified, row.typed)
                self.rows[row.name] = row if is_known else again

    @property
    def is_full(self) -> bool:
        """Whether so many dropped logs wait that no other may be dropped."""
        return sum(self._waiting.values()) >= MOST_WAITING

    def listed(self) -> list[Row]:
        """Return the rows, the newest flight first."""
        return sorted(self.rows.values(), key=lambda row: (row.when, row.name), reverse=True)

    def states(self) -> dict[str, str]:
        """Return a line for each log that is not read yet."""
        return {name: f"waits, {i} before it" for i, name in enumerate(self._waiting)} | {
            name: "is being read" if future.running() else "is next"
            for name, (_, future) in self._reading.items()
        }

    def free(self, name: str) -> tuple[Path, Part]:
        """Return a path in the folder that no file has, and the part that becomes it.

        Raises:
            ConfigError: it is not the name of a log.
            SinkError: the folder cannot be written.
        """
        safe = Path(safe_name(name))
        for number in range(1, 10_000):
            path = self.folder / (f"{safe.stem}-{number}{safe.suffix}" if number > 1 else safe)
            if not path.exists() and not path.with_name(path.name + UPLOAD).exists():
                return path, Part(path, force=False, suffix=UPLOAD)
        raise SinkError(f"{name}: there are too many files of this name")

    def add(self, name: str, typed: str = "") -> None:
        """Have a log read before those that only lie in the folder, with options of its own.

        Raises:
            ConfigError: the options are not understood, or do not fit together.
        """
        self._spec_with(typed)
        self.rows[name] = _unread(name, (self.folder / name).stat(), typed)
        self._waiting = {name: True} | self._waiting
        self._keep()
        self.look()

    def look(self) -> None:
        """Take the answers there are, find logs that are new or changed, and have them read."""
        changed = [name for name, (_, future) in self._reading.items() if future.done()]
        for name in changed:
            self._take(name, *self._reading.pop(name))
        found = dict(self._found())
        for name in self.rows.keys() - found.keys():
            changed.append(name)
            del self.rows[name]
            self._waiting.pop(name, None)
        for name, about in found.items():
            before = self.rows.get(name)
            row = _unread(name, about, "" if before is None else before.typed)
            if before is None or before.key != row.key:
                changed.append(name)
                self.rows[name] = row
            if not self.rows[name].outcome and name not in self._reading:
                self._waiting.setdefault(name, False)
        if changed:
            self._keep()
        ready = (name for name in [*self._waiting] if name not in self._reading)
        for name in islice(ready, max(self._reads.threads - len(self._reading), 0)):
            del self._waiting[name]
            self._made = {key: made for key, made in self._made.items() if key[0] != name}
            row = self.rows[name]
            task = Read(str(self.folder / name), self._spec_with(row.typed), TIMEOUT_S, self.out)
            self._reading[name] = row.key, self._reads.submit(task)

    def make(self, name: str, what: str) -> "Future[Any]":
        """Have a file of a flight made, once; return the future of that."""
        made = self._made.get((name, what))
        if made is None or (made.done() and not (self.out / f"{name}.{what}").is_file()):
            spec = self._spec_with(self.rows[name].typed)
            task = Make(str(self.folder / name), spec, TIMEOUT_S, self.out, what)
            self._made[name, what] = self._pages.submit(task)
        return self._made[name, what]

    def _found(self) -> Iterator[tuple[str, os.stat_result]]:
        """Yield each log in the folder; CSV and Parquet only where they were dropped or asked for.

        Other programs have such files, too.
        """
        with os.scandir(self.folder) as entries:
            for each in entries:
                known = self._with_records or each.name in self.rows
                if is_log(each.name) and (known or each.name.lower().endswith(IN_FOLDERS)):
                    with suppress(OSError):  # it has just been removed
                        if each.is_file():
                            yield each.name, each.stat()

    def _spec_with(self, typed: str) -> Spec:
        """Return how a log is read for which options were typed."""
        if not typed:
            return self._spec
        settings = overruled(self._spec.settings, typed_settings(typed))
        RunConfig(**settings)
        return replace(self._spec, settings=settings)

    def _take(self, name: str, key: str, future: Future[Any]) -> None:
        """Put the answer of a log into its row, unless its file has changed meanwhile."""
        row = self.rows.get(name)
        if row is not None and row.key == key:
            rows = future.result()
            known = {each: value for each, value in rows["logs"][0].items()
                     if each in Row.__struct_fields__}  # fmt: skip
            self.rows[name] = msgspec.structs.replace(row, **known, asks=rows.get("asks", ""))

    def _keep(self) -> None:
        """Write the list, which has changed."""
        self.version += 1
        kept = self._made_by, [*self.rows.values()]
        with suppress(SinkError):  # a full disk: the logs are read again at the next start
            write_whole({self.out / INDEX: msgspec.json.encode(kept)}, force=True)


def _unread(name: str, about: os.stat_result, typed: str) -> Row:
    """Return the row of a log that is not read yet."""
    return Row(name, f"{about.st_size} {about.st_mtime_ns}", about.st_mtime, typed)
