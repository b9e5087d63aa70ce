"""Files: read in pieces and hashed in one pass; what is no telemetry log is refused in one line."""

from __future__ import annotations

import bz2
import gzip
import hashlib
import io
import os
import sqlite3
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from sources.tlog_records import random_records

from yawid.errors import SourceError
from yawid.sources.logs.tlog import read_tlog
from yawid.sources.open_log import Log

RECORDS = random_records(np.random.default_rng(0), 200)
GARBAGE = np.random.default_rng(1).bytes(100_000)
LOGS = {
    "a log": b"".join(RECORDS),
    "one of one record": RECORDS[0],
    "one that begins with garbage": GARBAGE + b"".join(RECORDS),
    "one longer than its head": b"".join(RECORDS) * (1 + (3 << 20) // len(b"".join(RECORDS))),
}


@pytest.mark.parametrize("name", LOGS)
def test_the_pieces_are_the_file_and_its_hash_that_of_its_bytes(name: str, tmp_path: Path) -> None:
    path, data = tmp_path / "flight.tlog", LOGS[name]
    path.write_bytes(data)
    for chunk in (max(1, len(data) // 1000), 1 << 21):
        pieces = list(read_tlog(path, chunk))
        assert b"".join(pieces) == data
        assert max(map(len, pieces)) <= chunk
    source = Log(path, ())
    assert sum(size for size, _ in source.read()) == source.size == len(data)
    assert source.sha256 == hashlib.sha256(data).hexdigest()


MSBUILD = "^C:\\PROJECT\\MAIN.CPP\r\nC:\\PROJECT\\MAIN.OBJ\r\n"
BARE = [rec[8:] for rec in RECORDS]


def packed(kind: str) -> bytes:
    """Return a file of another format, by the library of that format."""
    out = io.BytesIO()
    if kind == "mat":
        savemat(out, {"t": np.arange(9.0)})
    elif kind == "npy":
        np.save(out, np.arange(9.0))
    elif kind == "sqlite":
        with sqlite3.connect(":memory:") as connection:
            connection.execute("create table topics (id)")
            return connection.serialize()
    else:
        # Nothing is packed, so that the frames of all its logs stand in the archive.
        with zipfile.ZipFile(out, "w") as archive:
            archive.writestr({"xlsx": "xl/workbook.xml"}.get(kind, "b.tlog"), b"".join(RECORDS))
    return out.getvalue()


STRANGERS = {
    "empty.tlog": (b"", "is empty"),
    "text.tlog": (MSBUILD.encode(), "text file"),
    "utf16.tlog": (MSBUILD.encode("utf-16"), "text file"),
    "gzip.tlog": (gzip.compress(b"x" * 1000), "gunzip"),
    "raw.tlog": (b"".join(BARE), "without time stamps"),
    "noise.tlog": (np.random.default_rng(3).bytes(2_000_000), "no intact MAVLink record"),
    "zeros.tlog": (bytes(5000), "no intact MAVLink record"),
    "a.mat": (packed("mat"), "MATLAB file.*writetable"),
    "a.npy": (packed("npy"), "NumPy array.*savetxt"),
    "a.db3": (packed("sqlite"), "SQLite"),
    "a.xlsx": (packed("xlsx"), "Excel.*CSV"),
    "a.tlog": (packed("zip"), "zip archive.*unzip"),
    "a.csv.bz2": (bz2.compress(b"t,rudder,r"), "bunzip2"),
    "page.html": (b"\xef\xbb\xbf\r\n<!DOCTYPE html><title>Sign in</title>", "web page"),
    "7.log": (b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n", r"\.BIN"),
    "none.tlog": (None, "does not exist"),
    "folder": ("mkdir", "directory"),
    "pipe.tlog": ("mkfifo", "not a regular file"),  # and does not block
}


@pytest.mark.parametrize("name", STRANGERS)
def test_what_is_no_telemetry_log_is_refused_in_one_line_with_what_to_do(
    tmp_path: Path, name: str
) -> None:
    content, verdict = STRANGERS[name]
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        getattr(os, content)(path)
    with pytest.raises(SourceError, match=verdict) as caught:
        next(iter(read_tlog(path) if path.suffix == ".tlog" else Log(path, ()).read()))
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "log").touch(mode=0)
    with pytest.raises(SourceError, match="chmod"):
        next(read_tlog(tmp_path / "log"))
