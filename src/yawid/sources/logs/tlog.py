"""The reader of telemetry logs: in chunks, with a hash; other files are refused in one line."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from yawid.blocks import FrameBlock
from yawid.errors import SourceError
from yawid.quantities.link import LinkStats
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.definitions import definitions
from yawid.sources.mavlink.framing import SLACK, find_frames

CHUNK = 1 << 20  # half as much would save 2 MB, twice as much would cost 20
_HEAD = 1 << 20  # a log has an intact record in its first MiB
_AS_CSV: Final = "and a line with t, rudder, r on top (yawid explain own_records.md)"
_MATLAB: Final = (
    "is a MATLAB file: write its columns as CSV by writetable(table(t, rudder, r), 'x.csv'), "
    f"{_AS_CSV}"
)
_HDF5: Final = f"is an HDF5 file: write its columns as CSV or Parquet, {_AS_CSV}"
_EXCEL: Final = f"is an Excel workbook: save its sheet as CSV, {_AS_CSV}"
_PACKED: Final = "is compressed by {0}: unpack it first ({1})"
_PCAP: Final = (
    "is a capture of network packets: send it to yawid live by udpreplay, or record the link by "
    "yawid live itself"
)
ARCHIVE: Final = b"PK\x03\x04"
"""The first bytes of a zip archive."""
_BEGINNINGS: Final = {
    b"\x1f\x8b": _PACKED.format("gzip", "gunzip"),
    b"BZh": _PACKED.format("bzip2", "bunzip2"),
    b"\xfd7zXZ\0": _PACKED.format("xz", "unxz"),
    b"\x28\xb5\x2f\xfd": _PACKED.format("zstd", "unzstd"),
    b"7z\xbc\xaf\x27\x1c": "is a 7-Zip archive: unpack it first (7z x)",
    ARCHIVE: "is a zip archive: unpack it first (unzip)",
    b"MATLAB ": _MATLAB,
    b"\x89HDF\r\n\x1a\n": _HDF5,
    b"\xd0\xcf\x11\xe0": _EXCEL,
    b"MDF     ": f"is a measurement file (MDF, MF4): export it as CSV (asammdf), {_AS_CSV}",
    b"#ROSBAG V": f"is a ROS 1 bag: write its topics as CSV (rostopic echo -p), {_AS_CSV}",
    b"SQLite format 3\0": f"is an SQLite file, such as a ROS 2 bag: write it as CSV, {_AS_CSV}",
    b"\xd4\xc3\xb2\xa1": _PCAP,
    b"\xa1\xb2\xc3\xd4": _PCAP,
    b"\x0a\x0d\x0d\x0a": _PCAP,
    b"\x93NUMPY": f"is a NumPy array: write it by numpy.savetxt as CSV, {_AS_CSV}",
    b"ARROW1": f"is an Arrow (Feather) file: write it as Parquet, {_AS_CSV}",
    b"RRF": "is a Rerun recording: give the log, or the run's .mcap next to it",
    b"H Product:Blackbox": f"is a Betaflight log: write it as CSV (blackbox_decode), {_AS_CSV}",
    b"FMT, 128, 89": "is a dataflash log in text form (.log): give the .BIN it was made from",
    b"%PDF": "is a PDF page: give the log itself",
    b"<": "is a web page or XML: the download may have ended at a page to log in; give the log",
    b"{": f"is JSON: write it as CSV, {_AS_CSV}",
}
"""What files with these first bytes are, and what to do."""
_SUFFIXES: Final = {
    **dict.fromkeys((".xlsx", ".xlsm", ".ods"), _EXCEL),
    **{".mat": _MATLAB, ".npz": "is a file of NumPy arrays: yawid export -o x.parquet can be read"},
}
"""What files with these suffixes are: some begin like an archive, or like nothing at all."""


class TlogReader:
    """The pieces of a telemetry log, which may be cut anywhere, read through a decoder."""

    vehicle_id = None

    def __init__(self, pieces: Iterable[bytes], decoder: Decoder) -> None:
        self._pieces, self._decoder = pieces, decoder

    @property
    def link(self) -> LinkStats:
        """The counts of all that has been decided so far."""
        return self._decoder.link

    def read(self) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they complete) to the end."""
        for piece in self._pieces:
            yield len(piece), self._decoder.feed(piece)
        yield 0, self._decoder.finish()


def read_tlog(path: Path, chunk: int = CHUNK) -> Iterator[bytes]:
    """Yield the bytes of a log, ``chunk`` at a time.

    Raises:
        SourceError: with the first piece, there is no such file, it cannot be read, or its first
        MiB holds no intact record; later on, reading fails.
    """
    if not path.is_file() and path.exists():
        kind = "is a directory" if path.is_dir() else "is not a regular file"
        raise SourceError(f"{path} {kind}: give the .tlog file itself")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
            if head.startswith(ARCHIVE) or not _has_record(head):
                # A stored archive is not packed: the frames of all its logs would be one flight.
                raise SourceError(f"{path} {_what_it_is(path, head)}")
            data = head[:chunk]
            file.seek(len(data))
            while data:
                yield data
                data = file.read(chunk)
    except OSError as error:
        known = {
            FileNotFoundError: "does not exist: check the name of the log",
            PermissionError: "may not be read: ask for permission (chmod u+r)",
        }
        other = f"cannot be read ({error.strerror or error}): copy the log and try again"
        raise SourceError(f"{path} {known.get(type(error), other)}") from error


def _has_record(head: bytes) -> bool:
    decoder = Decoder(wanted=())
    decoder.feed(head)
    decoder.finish()
    return decoder.link.frames > 0


def _what_it_is(path: Path, head: bytes) -> str:
    """Return what a file is that is no telemetry log, and what to do."""
    if not head:
        return "is empty: nothing was recorded"
    if (known := foreign(path, head)) is not None:
        return known
    if _is_text(head):
        return (
            "is a text file, neither MAVLink (MSBuild calls its files .tlog too) nor a table with "
            "a line of names (t, rudder, r) above its numbers: give a log or such a table"
        )
    data = np.frombuffer(b"".join((bytes(SLACK), head, bytes(SLACK))), np.uint8)
    if len(find_frames(data, SLACK, SLACK + len(head), definitions())[0]):
        return (
            "holds MAVLink frames without time stamps (.rlog, .raw): give the .tlog recorded with "
            "it"
        )
    return "holds no intact MAVLink record in its first MiB: give a telemetry log (.tlog)"


def _is_text(head: bytes) -> bool:
    sample = head[:4096]
    if sample.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    controls = set(range(32)) - set(b"\t\n\r\f\x1b")
    return not controls.intersection(sample)


def foreign(path: Path, head: bytes) -> str | None:
    """Return what a file is that begins with ``head``, and what to do; None for an unknown one."""
    heads = (head, head.removeprefix(b"\xef\xbb\xbf").lstrip())
    begun = (magic for magic in _BEGINNINGS if any(each.startswith(magic) for each in heads))
    return _SUFFIXES.get(path.suffix.lower()) or _BEGINNINGS.get(next(begun, b""))
