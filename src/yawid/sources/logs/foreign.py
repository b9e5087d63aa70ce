"""Files that hold a flight, or look so, and that yawid does not read: what each is, what to do."""

from pathlib import Path
from typing import Final

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


def foreign(path: Path, head: bytes) -> str | None:
    """Return what a file is that begins with ``head``, and what to do; None for an unknown one."""
    heads = (head, head.removeprefix(b"\xef\xbb\xbf").lstrip())
    begun = (magic for magic in _BEGINNINGS if any(each.startswith(magic) for each in heads))
    return _SUFFIXES.get(path.suffix.lower()) or _BEGINNINGS.get(next(begun, b""))
