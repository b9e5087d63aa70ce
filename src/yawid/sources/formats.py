"""The kinds of files that hold a flight: a new one is its reader and a row of ``FORMATS`` here.

A file is known by its first bytes. Only a table of texts may be known by its name, to be told why
it is none; all that is not known is taken for a telemetry log, whose reader says what is wrong.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from yawid.sources.logs.dataflash import DataflashReader
    from yawid.sources.logs.tlog import TlogReader
    from yawid.sources.logs.ulog import UlogReader
    from yawid.sources.open_log import ReadOptions
    from yawid.sources.records.record import Record

    Reader = TlogReader | DataflashReader | UlogReader | Record

HEAD: Final = 1 << 14
"""Bytes by which a file's kind is known."""


Opener = Callable[[Path, Iterable[str], "ReadOptions"], "Reader"]
"""From a path, the messages that are wanted and how bytes are read to a reader."""


@dataclass(frozen=True, slots=True)
class Format:
    """One kind of file; ``name`` is its suffix too, and the ``kind`` in a data set.

    ``said`` is what help calls it, ``called`` what an error does. ``opener`` is None of a finished
    run, which holds samples, not messages: ``runs/`` opens it. ``magic`` are its first bytes, none
    where it is not known by them. ``needs`` are the module that must be installed and the extra
    which brings it. A file that ``has_columns`` is one of many uses: no folder is searched for it.
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
        """What the name of such a file ends in."""
        return f".{self.name}"

    def __str__(self) -> str:
        return self.said if self.needs is None else f"{self.said} (extra {self.needs[1]})"


def _tlog(path: Path, wanted: Iterable[str], options: "ReadOptions") -> "Reader":
    from yawid.sources.logs.tlog import TlogReader

    return TlogReader(path, options.decoder(wanted), options.form)


def _dataflash(path: Path, wanted: Iterable[str], options: "ReadOptions") -> "Reader":
    from yawid.sources.logs.dataflash import DataflashReader

    return DataflashReader(path)


def _ulog(path: Path, wanted: Iterable[str], options: "ReadOptions") -> "Reader":
    from yawid.sources.logs.ulog import UlogReader

    return UlogReader(path)


def _record(path: Path, wanted: Iterable[str], options: "ReadOptions") -> "Reader":
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
"""What files end in that are taken from a folder: logs and finished runs."""


def recorded() -> str:
    """Return what a log may be, in words."""
    *first, last = (str(each) for each in FORMATS if each.opener is not None)
    return f"{', '.join(first)} or {last}"


def format_of(path: Path) -> Format:
    """Return the kind of a file by its first bytes; what cannot be read is a telemetry log."""
    head = _head(path)
    for each in FORMATS:
        if each.magic and head.startswith(each.magic):
            return each
    # A stamp begins with 0, a frame of MAVLink 2 with 0xFD.
    if not path.is_file() or head[:1] in (b"\0", b"\xfd"):
        return TLOG
    if path.suffix.lower() in [each.suffix for each in FORMATS if each.has_columns]:
        return CSV
    from yawid.sources.records.csv_table import looks_like_csv  # a log needs nothing of it

    return CSV if looks_like_csv(head) else TLOG


def _head(path: Path) -> bytes:
    """Return the first bytes, none where the reader is to say what is wrong."""
    if not path.is_file():
        return b""
    try:
        with path.open("rb") as file:
            return file.read(HEAD)
    except OSError:
        return b""
