"""Telemetry logs of any size; damage costs its record alone; other files are refused in a line."""

from __future__ import annotations

import bz2
import gzip
import hashlib
import io
import math
import os
import sqlite3
import struct
import zipfile
from itertools import accumulate
from pathlib import Path

import numpy as np
import pytest
from hostile import run_limited
from hypothesis import assume, given
from hypothesis import strategies as st
from pymavlink.generator.mavcrc import x25crc
from scipy.io import savemat
from sources.tlog_records import (
    BY_NAME,
    START_US,
    message,
    orders,
    pack,
    random_records,
    record,
    rows,
    run,
    sender,
)

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


MEGABYTES = 96
SIZE = 8 << 20
READ = """
from pathlib import Path
from yawid.sources.open_log import Log

wanted = {"ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT", "PARAM_VALUE", "VFR_HUD"}
for path in sorted(Path(sys.argv[1]).iterdir()):
    log = Log(path, wanted)
    for _ in log.read():
        pass
    assert log.link.frames * 20 + log.link.skipped_bytes > path.stat().st_size // 10, path
"""
MORE = random_records(np.random.default_rng(1), 2000)
ATTITUDE = pack(message(BY_NAME["ATTITUDE"], struct.pack("<I", 20)), sender())
CONTENTS = (
    b"".join(MORE),
    record(START_US, ATTITUDE),
    np.random.default_rng(2).bytes(1 << 20),
    b"\xfe" * 1000,
    b"\xfd" * 1000,
    b"\xfe\x1c\x00\x01\x01\x1e",  # the header of an ATTITUDE
)


def test_a_log_of_any_size_is_read_in_96_mb(tmp_path: Path) -> None:
    for i, content in enumerate(CONTENTS):
        log = b"".join(MORE[:5]) + content * (SIZE // len(content))
        (tmp_path / str(i)).write_bytes(log)

    run_limited(READ, MEGABYTES, tmp_path)  # they were read, not skipped


DAY_US = 86400 * 1_000_000
KEPT, SKIPPED, WRONG_CRC, UNKNOWN = "kept", "skipped", "wrong CRC", "unknown"
Part = tuple[bytes, str]


def vibration(stamp_us: int, seq: int, **kinds: bool) -> bytes:
    return record(
        stamp_us, pack(message(BY_NAME["VIBRATION"], b"\x01" * 32), sender(), seq=seq, **kinds)
    )


TEN = [vibration(START_US + i, i) for i in range(10)]
LENGTH = len(TEN[0])


def changed(data: bytes, at: int, to: bytes) -> bytes:
    return data[:at] + to + data[at + len(to) :]


def among(*parts: Part) -> list[Part]:
    """Return parts of a log between five records and five others."""
    whole = [(each, KEPT) for each in TEN]
    return [*whole[:5], *parts, *whole[5:]]


def stamped(*stamps: int) -> list[Part]:
    return [(vibration(stamp, i), KEPT) for i, stamp in enumerate(stamps)]


def tunnels(inner: bytes) -> list[list[Part]]:
    """A frame whose payload has frames: intact, with a wrong CRC, and of an unknown id."""
    body = struct.pack("<HBBB", 0, 1, 1, len(inner)) + inner
    outer = record(START_US + 10, pack(message(BY_NAME["TUNNEL"], body), sender(), seq=77))
    wrong = outer[:-1] + bytes([outer[-1] ^ 1])
    unknown = changed(outer, 8 + 7, b"\xff\xff\xff")
    return [
        among((each, kind))
        for each, kind in ((outer, KEPT), (wrong, WRONG_CRC), (unknown, UNKNOWN))
    ]


def of_other_flags() -> bytes:
    body = changed(TEN[1][9:-2], 1, b"\x02")
    crc = x25crc(body + bytes([BY_NAME["VIBRATION"].crc_extra])).crc
    return record(START_US, b"\xfd" + body + crc.to_bytes(2, "little"))


def bare(v1: bool) -> bytes:
    msg = message(BY_NAME["SERVO_OUTPUT_RAW"], struct.pack("<I4H", 1, 1500, 1500, 1000, 1500))
    return b"".join(pack(msg, sender(), v1=v1) for _ in range(50))


OLD, NEXT = vibration(START_US, 9, v1=True)[8:], TEN[9][8:]
DRIFTED = changed(TEN[3], LENGTH - 2, bytes([TEN[3][-2] ^ 0xFF]))
"""The right id and length under another CRC_EXTRA: the CRC never fits."""
LONGER, TOO_LONG = (changed(TEN[2], 8 + 1, bytes([TEN[2][9] + n * LENGTH])) for n in (1, 2))
NOISE = np.random.default_rng(5).bytes(300_000)
CRLF = random_records(np.random.default_rng(11), 400, start_us=1_500_000_000_000_000)
DAMAGES: dict[str, list[list[Part]]] = {
    "a single record": [[(b"noise", SKIPPED), (TEN[0], KEPT)]],
    "garbage alone": [[(NOISE, SKIPPED)]],
    "a torn end": [
        [*among(), (vibration(START_US + 20, 20)[:-cut], SKIPPED)] for cut in (1, 7, 17, 30)
    ],
    "frames inside of a payload": [
        log
        for inner in (NEXT, OLD, TEN[9], TEN[8] + TEN[9], TEN[8][8:] + NEXT)
        for log in tunnels(inner)
    ],
    "a drifted dialect, in a row and at either end": [
        among(*[(DRIFTED, WRONG_CRC)] * 4),
        [(DRIFTED, WRONG_CRC), *among()],
        [*among(), (DRIFTED, WRONG_CRC)],
    ],
    "a length that reaches a later record": [among((LONGER, SKIPPED))],
    "a length that no message can have, before a damaged record": [
        among((TOO_LONG, SKIPPED), (vibration(START_US + 50, 50), KEPT), (DRIFTED, WRONG_CRC))
    ],
    "a stamp of nonsense": [
        [
            (record(stamp, each[8:]), SKIPPED) if i == garbled else (each, KEPT)
            for i, each in enumerate(TEN)
        ]
        for garbled in (0, 1, 5, 9)
        for stamp in (0, START_US + 4 * DAY_US, 2**63 + 5, 2**64 - 1)
    ],
    "a clock that is set in flight": [
        stamped(*range(60_000_000, 60_000_005), *range(START_US, START_US + 5))
    ],
    "bursts on one stamp, and steps back": [
        stamped(*[START_US] * 26, *[START_US - 1_400_000] * 26, START_US - 2 * DAY_US)
    ],
    "frames without stamps": [
        log
        for frames in (bare(v1=False), bare(v1=True))
        for log in ([(frames, SKIPPED)], [(frames[3:], SKIPPED)], among((frames, SKIPPED)))
    ],
    "unknown incompatible flags": [among((of_other_flags(), SKIPPED))],
    # This start has no line feed in its upper bytes, unlike START_US.
    "line ends of a text": [
        [(each.replace(b"\n", b"\r\n"), KEPT if b"\n" not in each else SKIPPED) for each in CRLF]
    ],
    "stamps damaged all alike": [
        [(each.replace(b"\n", b"\r\n"), SKIPPED) for each in TEN if b"\n" in each[:8]]
    ],
}


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_costs_only_the_record_that_it_stands_in(name: str) -> None:
    for parts in DAMAGES[name]:
        data = b"".join(part for part, _ in parts)
        starts = accumulate((len(part) for part, _ in parts), initial=0)
        blocks, decoder = run(data)

        link, kinds = decoder.link, [kind for _, kind in parts]
        kept = [start for start, kind in zip(starts, kinds, strict=False) if kind == KEPT]
        assert orders(blocks) == kept
        assert link.frames == len(kept)
        if name != "line ends of a text":  # there a frame may be whole, and of another length
            skipped = sum(len(part) for part, kind in parts if kind == SKIPPED)
            counts = kinds.count(WRONG_CRC), kinds.count(UNKNOWN), skipped
            assert (link.bad_crc, link.unknown, link.skipped_bytes) == counts
        again, cut = run(data, list(range(1, len(data), 1 + len(data) // 60)))
        assert rows(again) == rows(blocks)
        assert cut.link == link


def flipped(
    records: list[bytes], rng: np.random.Generator, rate: float, days: float = 3.0
) -> tuple[bytes, list[int]]:
    """Return the log with bytes changed at a rate, and where its intact records start.

    A record counts as intact if its frame is untouched and its stamp still within so many days.
    Up to 3 kB of garbage stand before one record in forty.
    """
    data, intact = b"", []
    for original in records:
        data += rng.bytes(int(rng.integers(1, 3000)) * (rng.random() < 1 / 40))
        each = np.frombuffer(original, np.uint8).copy()
        hit = np.flatnonzero(rng.random(len(each)) < rate)
        each[hit] ^= rng.integers(1, 256, len(hit), dtype=np.uint8)
        drift = int.from_bytes(each[:8].tobytes(), "big") - int.from_bytes(original[:8], "big")
        if each[8:].tobytes() == original[8:] and abs(drift) <= days * DAY_US:
            intact.append(len(data))
        data += each.tobytes()
    return data, intact


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.sampled_from([40, 40, 1000]),
    rate=st.sampled_from([3e-4, 1e-3, 1e-2]),
)
def test_all_intact_records_are_found_among_flipped_bytes_and_garbage(
    seed: int, count: int, rate: float
) -> None:
    """A stamp that is off by more, next to another one that is off, may be taken for a true one."""
    records = random_records(np.random.default_rng(seed), count)
    (data, intact), (_, untouched) = (
        flipped(records, np.random.default_rng(seed), rate, days) for days in (3.0, math.inf)
    )
    assume(len(intact) >= 2)
    blocks, _ = run(data)
    assert set(intact) <= set(orders(blocks)) <= set(untouched)
