"""Files: read in chunks and hashed in one pass; what is no telemetry log is refused in one line."""

from __future__ import annotations

import bz2
import gzip
import hashlib
import os
import sqlite3
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from sources.tlog_records import BY_NAME, START_US, message, pack, random_records, record, sender

from yawid.errors import SourceError
from yawid.sources.logs.tlog import read_tlog
from yawid.sources.open_log import Log


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"".join(random_records(np.random.default_rng(0), 200)))
    return path


@pytest.mark.parametrize("chunk", [1, 999, 1 << 21])
def test_the_pieces_are_the_file(log: Path, chunk: int) -> None:
    pieces = list(read_tlog(log, chunk))
    assert b"".join(pieces) == log.read_bytes()
    assert max(map(len, pieces)) <= chunk


def test_a_file_longer_than_its_head_is_read_whole(tmp_path: Path) -> None:
    records = b"".join(random_records(np.random.default_rng(0), 200))
    path = tmp_path / "long.tlog"
    path.write_bytes(records * (1 + (3 << 20) // len(records)))
    assert b"".join(read_tlog(path)) == path.read_bytes()
    source = Log(path, ())
    assert sum(size for size, _ in source.read()) == source.size
    assert source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_log_that_begins_with_garbage_is_read(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "late.tlog"
    garbage = np.random.default_rng(1).bytes(100_000)
    path.write_bytes(garbage + log.read_bytes())
    next(read_tlog(path))
    assert b"".join(read_tlog(path)) == garbage + log.read_bytes()


def test_a_log_of_one_record_is_read(tmp_path: Path) -> None:
    path = tmp_path / "one.tlog"
    path.write_bytes(record(START_US, pack(message(BY_NAME["VIBRATION"], b"\x01"), sender())))
    next(read_tlog(path))


MSBUILD = "^C:\\PROJECT\\MAIN.CPP\r\nC:\\PROJECT\\MAIN.OBJ\r\n"
BARE = [rec[8:] for rec in random_records(np.random.default_rng(2), 50)]
STRANGERS = {
    "empty": (b"", "is empty"),
    "text": (MSBUILD.encode(), "text file"),
    "utf-16": (MSBUILD.encode("utf-16"), "text file"),
    "gzip": (gzip.compress(b"x" * 1000), "gunzip"),
    "raw": (b"".join(BARE), "without time stamps"),
    "noise": (np.random.default_rng(3).bytes(2_000_000), "no intact MAVLink record"),
    "zeros": (bytes(5000), "no intact MAVLink record"),
}


@pytest.mark.parametrize("name", STRANGERS)
def test_what_is_no_telemetry_log_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    content, verdict = STRANGERS[name]
    path = tmp_path / "stranger.tlog"
    path.write_bytes(content)
    with pytest.raises(SourceError, match=verdict) as caught:
        next(read_tlog(path))
    assert_one_line(caught.value, path)


def written_by_others(folder: Path) -> dict[str, str]:
    """Write files in formats of others, by their own libraries where there is one."""
    savemat(folder / "a.mat", {"t": np.arange(9.0)})
    np.save(folder / "a.npy", np.arange(9.0))
    sqlite3.connect(folder / "a.db3").execute("create table topics (id)").connection.close()
    with zipfile.ZipFile(folder / "a.xlsx", "w") as book:
        book.writestr("xl/workbook.xml", "<workbook/>")
    (folder / "a.csv.bz2").write_bytes(bz2.compress(b"t,rudder,r"))
    (folder / "page.tlog").write_bytes(b"\xef\xbb\xbf\r\n<!DOCTYPE html><title>Sign in</title>")
    (folder / "7.log").write_text(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n", encoding="utf-8"
    )
    return {
        "a.mat": "MATLAB file.*writetable", "a.npy": "NumPy array.*savetxt", "a.db3": "SQLite",
        "a.xlsx": "Excel.*CSV", "a.csv.bz2": "bunzip2", "page.tlog": "web page", "7.log": r"\.BIN",
    }  # fmt: skip


def test_a_file_in_a_known_format_is_named_with_the_way_to_convert_it(tmp_path: Path) -> None:
    for name, said in written_by_others(tmp_path).items():
        with pytest.raises(SourceError, match=f"{name} is .*{said}") as caught:
            Log(tmp_path / name, ())
        assert_one_line(caught.value, tmp_path / name)


def test_logs_stored_in_an_archive_are_not_read_as_one_flight(tmp_path: Path) -> None:
    """``zip -0`` packs nothing, so that the frames of all its logs stand in the archive."""
    with zipfile.ZipFile(tmp_path / "a.tlog", "w") as archive:
        archive.writestr("b.tlog", b"".join(random_records(np.random.default_rng(2), 50)))
    with pytest.raises(SourceError, match=r"zip archive.*unzip"):
        next(read_tlog(tmp_path / "a.tlog"))


def test_a_missing_file_and_a_directory_are_refused_in_one_line(tmp_path: Path) -> None:
    for path, verdict in ((tmp_path / "none.tlog", "does not exist"), (tmp_path, "directory")):
        with pytest.raises(SourceError, match=verdict) as caught:
            next(read_tlog(path))
        assert_one_line(caught.value, path)


def test_a_pipe_is_refused_and_does_not_block(tmp_path: Path) -> None:
    path = tmp_path / "pipe.tlog"
    os.mkfifo(path)
    with pytest.raises(SourceError, match="not a regular file"):
        next(read_tlog(path))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission_is_refused_in_one_line(log: Path) -> None:
    log.chmod(0)
    with pytest.raises(SourceError, match="chmod") as caught:
        next(read_tlog(log))
    assert_one_line(caught.value, log)


def assert_one_line(error: SourceError, path: Path) -> None:
    text = str(error)
    assert "\n" not in text
    assert str(path) in text
    assert ":" in text.removeprefix(str(path))  # the remedy
