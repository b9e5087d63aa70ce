"""What a fleet has finished and not merged yet: a line a log, so that a kill loses no log's half.

``DATASET/finished.jsonl`` grows by one line as each log ends. Lines become Parquet when there are
many, at the end, after an interrupt and at the next start. A last line that was torn is left out:
its log is run again.
"""

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

from yawid.dataset.files import completed, merge, read_table
from yawid.dataset.places import MANIFEST, read_manifest
from yawid.dataset.schema import TABLES
from yawid.dataset.values import Entry, ReadRow
from yawid.errors import SinkError, SourceError

FINISHED: Final = "finished.jsonl"
LOCK: Final = ".lock"
MERGE_LOGS: Final = 20_000
MERGE_BYTES: Final = 128 << 20
"""Of lines; as many are merged at once."""
KNOWN: Final = (
    *("path", "size_bytes", "modified", "config_hash", "analysis_version"),
    *("outcome", "file_sha256"),
)


class Journal:
    """The data set of one running fleet; nobody else writes to it meanwhile.

    Raises:
        SinkError: the folder cannot be written, is no data set, or another fleet writes to it.
        SourceError: what is there cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lines = self._size = 0
        self._path = folder / FINISHED
        self._lock = _locked(folder)
        self._stream: BinaryIO | None = None
        try:
            self.merge()
        except BaseException:
            self._lock.close()
            raise

    def known(self) -> dict[str, ReadRow]:
        """Return what is known of each log, by path: the columns ``KNOWN`` of ``logs``."""
        if not (self.folder / MANIFEST).exists():
            return {}
        rows = read_table(self.folder, "logs", KNOWN).to_pylist()
        return {row["path"]: row for row in rows}

    def add(self, entry: Entry) -> None:
        """Add a log's rows; they outlive the end of this process, however it comes."""
        try:
            if self._stream is None:
                self._stream = self._path.open("ab")
            line = json.dumps(entry, allow_nan=False).encode() + b"\n"
            self._stream.write(line)
            self._stream.flush()
        except OSError as error:
            raise SinkError(f"cannot write {self._path}: {error.strerror}") from error
        self._lines, self._size = self._lines + 1, self._size + len(line)
        if self._lines >= MERGE_LOGS or self._size >= MERGE_BYTES:
            self.merge()

    def merge(self) -> None:
        """Merge what is finished into the tables, or complete what a kill has left."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        entries = list(_lines(self._path))
        if entries:
            merge(self.folder, entries)
        else:
            completed(self.folder)
        self._path.unlink(missing_ok=True)
        self._lines = self._size = 0

    def close(self) -> None:
        """Merge and let others write."""
        try:
            self.merge()
        finally:
            self._lock.close()


@contextmanager
def opened(folder: Path) -> Iterator[Journal]:
    """Open a data set; what was finished is merged however the context ends."""
    journal = Journal(folder)
    try:
        yield journal
    finally:
        journal.close()


def peek(folder: Path) -> dict[str, ReadRow]:
    """Return what is known of each log without writing anything."""
    known: dict[str, ReadRow] = {}
    if (folder / MANIFEST).exists():
        known = {row["path"]: row for row in read_table(folder, "logs", KNOWN).to_pylist()}
    newer = (entry["logs"][0] for entry in _lines(folder / FINISHED))
    return known | {row["path"]: {name: row.get(name) for name in KNOWN} for row in newer}


def check_ours(folder: Path) -> None:
    """Find out whether a folder is a data set or may become one; it need not exist.

    Raises:
        SinkError: it holds what is not a data set's.
        SourceError: its manifest or its unmerged lines cannot be read, or are not ours.
    """
    try:
        names = {path.name for path in folder.iterdir()} if folder.exists() else set()
    except OSError as error:
        raise SinkError(f"cannot write {folder}: {error.strerror}") from error
    if MANIFEST in names:
        read_manifest(folder)
    elif names - _BEFORE_MANIFEST:
        raise SinkError(f"{folder} is not empty and not a data set: choose another --out")
    for _ in _lines(folder / FINISHED):
        break


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
            except (ValueError, KeyError, TypeError):
                is_ours = False
            if not is_ours:
                raise SourceError(
                    f"{path}, line {number} was not written by yawid fleet: move the file away"
                )
            yield entry


def _locked(folder: Path) -> BinaryIO:
    check_ours(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / LOCK).open("ab")
    except OSError as error:
        raise SinkError(f"cannot write {folder}: {error.strerror}") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        lock.close()
        raise SinkError(f"another yawid fleet writes to {folder}: wait for its end") from error
    return lock


_BEFORE_MANIFEST: Final = frozenset({LOCK, FINISHED, f"{MANIFEST}.part"})
"""What a fleet may leave that was killed before it wrote a manifest."""
