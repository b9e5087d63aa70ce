"""The kinds of files that hold a flight. A new kind needs its reader and a row of ``FORMATS``.

A file is recognised by its first bytes. Only a table of texts may be recognised by its name, so
that its reader can say what is wrong with it. Any unknown file is taken for a telemetry log, whose
reader then says what is wrong.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from yawid.sources.logs.dataflash import DataflashReader
    from yawid.sources.logs.tlog import TlogReader
    from yawid.sources.logs.ulog import UlogReader
    from yawid.sources.mavlink.decoder import Decoder
    from yawid.sources.records.record import Record

    Reader = TlogReader | DataflashReader | UlogReader | Record

HEAD: Final = 1 << 14
"""The number of first bytes that identify a kind of file."""


Opener = Callable[[Path, "Callable[[], Decoder]"], "Reader"]
"""A function of a path, and of one that makes the decoder of its bytes, that returns a reader."""


@dataclass(frozen=True, slots=True)
class Format:
    """One kind of file; ``name`` is also its suffix, and its ``kind`` in a data set.

    ``said`` is its name in help texts, ``called`` its name in errors. ``opener`` is None for a
    finished run, which holds samples instead of messages: ``runs/`` opens it. ``magic`` holds its
    first bytes, empty if they do not identify it. ``needs`` names the module that must be installed
    and the extra that installs it. Files that ``has_columns`` have many other uses, so they are not
    searched for in folders.
    """

    name: str
    said: str
    called: str
    opener: Opener | None
    magic: bytes = b""
    needs: tuple[str, str] | None = None
    has_columns: bool = False

    @property
    def suffix(self) -> str:
        """The suffix of such a file's name, with its dot."""
        return f".{self.name}"

    def __str__(self) -> str:
        return self.said if self.needs is None else f"{self.said} (extra {self.needs[1]})"


def _tlog(path: Path, decoder: "Callable[[], Decoder]") -> "Reader":
    from yawid.sources.logs.tlog import TlogReader, read_tlog

    pieces = read_tlog(path)
    return TlogReader(chain([next(pieces)], pieces), decoder())


def _dataflash(path: Path, _: "Callable[[], Decoder]") -> "Reader":
    from yawid.sources.logs.dataflash import DataflashReader

    return DataflashReader(path)


def _ulog(path: Path, _: "Callable[[], Decoder]") -> "Reader":
    from yawid.sources.logs.ulog import UlogReader

    return UlogReader(path)


def _record(path: Path, _: "Callable[[], Decoder]") -> "Reader":
    from yawid.sources.records.record import Record

    return Record(path)


TLOG: Final = Format("tlog", "tlog", "a telemetry log", _tlog)
CSV: Final = Format("csv", "CSV", "a table of texts", _record, has_columns=True)
RUN: Final = Format("mcap", "a run's MCAP", "an MCAP file", None, b"\x89MCAP0\r\n")
FORMATS: Final = (
    TLOG,
    Format("bin", "dataflash .BIN", "a dataflash log (.bin)", _dataflash, b"\xa3\x95"),
    Format("ulg", "PX4 .ulg", "a PX4 ULog", _ulog, b"ULog\x01\x12\x35", ("pyulog", "ulog")),
    CSV,
    Format("parquet", "Parquet", "a Parquet file", _record, b"PAR1", has_columns=True),
    RUN,
)
IN_FOLDERS: Final = tuple(each.suffix for each in FORMATS if not each.has_columns)
"""The suffixes of files that are taken from a folder: logs and finished runs."""
WITH_RECORDS: Final = tuple(each.suffix for each in FORMATS)
"""Those where the user says what the columns of CSV and Parquet hold."""


def recorded() -> str:
    """Return the kinds of logs in words."""
    *first, last = (str(each) for each in FORMATS if each.opener is not None)
    return f"{', '.join(first)} or {last}"


def format_of(path: Path) -> Format:
    """Return the kind of a file by its first bytes; an unreadable file counts as telemetry log."""
    head = b""  # of an unreadable file, too: its reader will say what is wrong
    if path.is_file():
        with suppress(OSError), path.open("rb") as file:
            head = file.read(HEAD)
    for each in FORMATS:
        if each.magic and head.startswith(each.magic):
            return each
    if not path.is_file() or head[:1] == b"\0":  # as the stamps of a tlog begin
        return TLOG
    if path.suffix.lower() in [each.suffix for each in FORMATS if each.has_columns]:
        return CSV
    from yawid.sources.records.csv_header import looks_like_csv  # a log needs nothing of it

    return CSV if looks_like_csv(head) else TLOG
