"""The journal of a fleet: one line for each log that is finished and not merged yet.

``finished.jsonl`` grows by one line when a log ends, so that a kill loses no finished log and
leaves none half written. The lines are merged into Parquet files when there are many of them, at
the end of the run, after an interrupt, and at the start of the next run. A last line that is
incomplete is ignored, as is one that does not fit the tables: its log is run again. It lies in the
data set's folder; of a data set in a store, which cannot append to a file, in a folder of the user.
"""

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

from yawid.dataset.files import completed, merge, misfit, read_table
from yawid.dataset.places import MANIFEST, read_manifest
from yawid.dataset.schema import TABLES
from yawid.dataset.values import Entry, ReadRow
from yawid.errors import SinkError, SourceError
from yawid.fleet.hold import Hold
from yawid.sinks.door import say
from yawid.system.files import lock
from yawid.system.part_file import os_errors_as_sink_error
from yawid.system.stores import Place, StoredPath

FINISHED: Final = "finished.jsonl"
LOCK: Final = ".lock"
MERGE_LOGS: Final = 20_000
"""Number of lines at which the journal is merged into the tables."""
MERGE_BYTES: Final = 128 << 20
"""Size of the journal in bytes at which it is merged into the tables."""
KNOWN: Final = (
    *("path", "size_bytes", "modified", "config_hash", "analysis_version"),
    *("outcome", "file_sha256"),
)
"""The columns of ``logs`` that decide whether a log is run again."""


class Journal:
    """The data set of one running fleet, locked against other fleets.

    Raises:
        SinkError: the folder cannot be written, is not a data set, or another fleet writes to it.
        SourceError: the data set in the folder cannot be read.
    """

    def __init__(self, folder: Place) -> None:
        self.folder = folder
        self._lines = self._size = 0
        here = _here(folder)
        self._path = here / FINISHED
        self._lock = _locked(folder, here)
        self._hold: Hold | None = None
        self._stream: BinaryIO | None = None
        try:
            if isinstance(folder, StoredPath):
                self._hold = Hold(folder / LOCK, here)
            self.merge()
        except BaseException:
            self._release()
            raise

    def known(self) -> dict[str, ReadRow]:
        """Return the columns ``KNOWN`` of the table ``logs`` as one row for each path."""
        return _known(self.folder)

    def add(self, entry: Entry) -> None:
        """Add a log's rows. They are kept even if this process is killed right after.

        Raises:
            SinkError: the journal or the tables cannot be written.
            SourceError: the tables cannot be read when it is time to merge.
        """
        with os_errors_as_sink_error(self._path):
            if self._stream is None:
                self._stream = self._path.open("ab")
            line = json.dumps(entry, allow_nan=False).encode() + b"\n"
            self._stream.write(line)
            self._stream.flush()
        self._lines, self._size = self._lines + 1, self._size + len(line)
        if self._lines >= MERGE_LOGS or self._size >= MERGE_BYTES:
            self.merge()

    def merge(self) -> None:
        """Merge the finished logs into the tables, or complete a merge that a kill interrupted."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        if self._hold is not None:
            self._hold.check()
        entries = []
        for entry in _lines(self._path):
            if (text := misfit(entry)) is None:
                entries.append(entry)
            else:
                say(f"{entry['logs'][0].get('path')!a}: {text}; left out, the log is run again")
        if entries:
            merge(self.folder, entries)
        else:
            completed(self.folder)
        self._path.unlink(missing_ok=True)
        self._lines = self._size = 0

    def close(self) -> None:
        """Merge, and release the lock."""
        try:
            self.merge()
        finally:
            self._release()

    def _release(self) -> None:
        if self._hold is not None:
            self._hold.release()
        self._lock.close()


@contextmanager
def opened(folder: Place) -> Iterator[Journal]:
    """Open a data set; finished logs are merged however the context ends."""
    journal = Journal(folder)
    try:
        yield journal
    finally:
        journal.close()


def peek(folder: Place) -> dict[str, ReadRow]:
    """Return the columns ``KNOWN`` of each log by path, without writing anything."""
    newer = (entry["logs"][0] for entry in _lines(_here(folder) / FINISHED))
    return _known(folder) | {row["path"]: {name: row.get(name) for name in KNOWN} for row in newer}


def _known(folder: Place) -> dict[str, ReadRow]:
    if not (folder / MANIFEST).exists():
        return {}
    return {row["path"]: row for row in read_table(folder, "logs", KNOWN).to_pylist()}


def check_ours(folder: Place) -> None:
    """Check that a folder is a data set or may become one; it need not exist.

    Raises:
        SinkError: the folder holds other files, or cannot be listed.
        SourceError: its manifest or its journal cannot be read, or was not written by yawid.
    """
    with os_errors_as_sink_error(folder):
        names = _names(folder)
    if MANIFEST in names:
        read_manifest(folder)
    elif names - _BEFORE_MANIFEST:
        raise SinkError(f"{folder} is not empty and is not a data set: choose another --out")
    for _ in _lines(_here(folder) / FINISHED):
        break


def _names(folder: Place) -> set[str]:
    if isinstance(folder, Path):
        return {path.name for path in folder.iterdir()} if folder.exists() else set()
    if (folder / MANIFEST).exists():
        return {MANIFEST}
    return {name.partition("/")[0] for name in folder.below()}


def _here(folder: Place) -> Path:
    """Return the folder of the journal and the lock on this machine."""
    if isinstance(folder, Path):
        return folder
    named = Path(os.environ.get("XDG_STATE_HOME") or ".")
    state = named if named.is_absolute() else Path("~/.local/state").expanduser()
    return state / "yawid" / "fleets" / hashlib.sha256(str(folder).encode()).hexdigest()[:16]


def _lines(path: Path) -> Iterator[Entry]:
    if not path.exists():
        return
    with path.open("rb") as stream:
        for number, line in enumerate(stream, 1):
            if not line.endswith(b"\n"):
                return
            try:
                entry: Entry = json.loads(line)
                is_ours = set(entry) <= set(TABLES) and len(entry["logs"]) == 1
            except (ValueError, KeyError, TypeError, RecursionError):
                is_ours = False
            if not is_ours:
                raise SourceError(
                    f"{path}, line {number} was not written by yawid fleet: move the file away"
                )
            yield entry


def _locked(folder: Place, here: Path) -> BinaryIO:
    check_ours(folder)
    with os_errors_as_sink_error(here):
        here.mkdir(parents=True, exist_ok=True)
        file = (here / LOCK).open("ab")
    try:
        lock(file.fileno())
    except OSError as error:
        file.close()
        raise SinkError(
            f"another yawid fleet is writing to {folder}: wait until it has ended"
        ) from error
    return file


_BEFORE_MANIFEST: Final = frozenset({LOCK, FINISHED, f"{MANIFEST}.part"})
"""Files that a fleet may leave if it is killed before it writes a manifest."""
