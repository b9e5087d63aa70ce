"""Logs without stamps: the frames of a raw stream, under stamps that follow the vehicle's clock."""

from __future__ import annotations

import hashlib
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from flightlog import FlightLog, fly, samples_of
from flights.surgery import split
from hypothesis import given, settings
from hypothesis import strategies as st
from sources.tlog_records import (
    BY_NAME,
    START_US,
    damaged,
    message,
    pack,
    random_records,
    record,
    rows,
    run,
    sender,
)

from yawid.errors import SourceError
from yawid.sources.logs.bare_frames import Stamper
from yawid.sources.logs.tlog import check_readable, read_tlog


def bare(log: bytes) -> bytes:
    """Return an intact tlog without its stamps."""
    return b"".join(frame for _, frame in split(log))


def stamped(data: bytes, cuts: list[int] | None = None) -> bytes:
    stamper = Stamper()
    edges = [0, *sorted(cuts or []), len(data)]
    return b"".join([*(stamper.feed(data[a:b]) for a, b in pairwise(edges)), stamper.finish()])


def attitude(boot_ms: int, seq: int, sysid: int = 1) -> bytes:
    return pack(
        message(BY_NAME["ATTITUDE"], struct.pack("<I6f", boot_ms, *[0.1] * 6)),
        sender(sysid),
        seq=seq % 256,
    )


def stamps_in(log: bytes) -> list[int]:
    blocks, decoder = run(log)
    assert decoder.link.skipped_bytes == 0
    return [row[2] for row in rows(blocks)]


def test_bare_frames_give_every_message_the_tlog_gives() -> None:
    records = random_records(np.random.default_rng(1), 400)
    from_tlog, _ = run(b"".join(records))
    from_raw, decoder = run(stamped(b"".join(rec[8:] for rec in records)))
    assert [row[1:2] + row[3:] for row in rows(from_raw)] == [
        row[1:2] + row[3:] for row in rows(from_tlog)
    ]
    assert decoder.link.skipped_bytes == 0


def test_a_flight_without_stamps_gives_the_same_samples() -> None:
    log = fly(lambda t: 0.3 * np.sin(2.0 * t), lambda t: 1500 + 100 * (int(t) % 2), 12.0)
    once = samples_of(log.data)
    again = samples_of(stamped(bare(log.data)))
    assert len(again) == len(once) > 100
    for name in ("k", "boot_us", "u", "y", "held"):
        np.testing.assert_array_equal(getattr(again, name), getattr(once, name))
    # Unix time is the vehicle's, counted from the first ATTITUDE.
    elapsed_ns = 1000 * (again.boot_us - 10_000_000)
    np.testing.assert_allclose(again.unix_ns, elapsed_ns, atol=20_000_000)


def test_stamps_follow_the_clock_of_the_first_sender_and_never_fall() -> None:
    frames = [attitude(1000, 0), attitude(1020, 1), attitude(77, 0, sysid=2), attitude(1040, 2)]
    assert stamps_in(stamped(b"".join(frames))) == [0, 20_000, 20_000, 40_000]


def test_a_reboot_or_a_leap_of_the_clock_stops_the_stamps_for_one_frame() -> None:
    times = [5000, 5100, 100, 200, 3_600_201, 3_600_301]
    frames = b"".join(attitude(t, i) for i, t in enumerate(times))
    expected = [0, 100_000, 100_000, 200_000, 200_000, 300_000]
    assert stamps_in(stamped(frames)) == expected


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    damage=st.lists(st.tuples(st.floats(0, 1), st.sampled_from("xgid")), max_size=6),
    cuts=st.lists(st.floats(0, 1), max_size=12),
)
def test_no_cut_changes_what_is_stamped(
    seed: int, damage: list[tuple[float, str]], cuts: list[float]
) -> None:
    rng = np.random.default_rng(seed)
    data = damaged(rng, b"".join(rec[8:] for rec in random_records(rng, 12)), damage)
    whole = stamped(bytes(data))
    assert stamped(bytes(data), [int(cut * len(data)) for cut in cuts]) == whole


@pytest.mark.parametrize("seed", range(3))
def test_all_intact_frames_are_found_among_flipped_bytes_and_garbage(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts, intact, noise = [], 0, 0
    for i, rec in enumerate(random_records(rng, 800)):
        frame = bytearray(rec[8:])
        if i % 40 == 20:
            parts.append(rng.bytes(int(rng.integers(1, 500))))
            noise += len(parts[-1])
        if i % 30 == 10:
            frame[int(rng.integers(3, len(frame)))] ^= 0x55
        else:
            intact += 1
        parts.append(bytes(frame))
    _, decoder = run(stamped(b"".join(parts)))
    assert decoder.link.frames == intact
    # What was damaged is counted: the frames passed over whole, the rest byte by byte.
    assert decoder.link.bad_crc + decoder.link.unknown >= 15
    assert decoder.link.skipped_bytes >= noise


def test_a_damaged_frame_is_counted_and_hides_what_is_inside_it() -> None:
    inner = attitude(50, 9)
    body = struct.pack("<HBBB", 0, 1, 1, len(inner)) + inner
    outer = bytearray(pack(message(BY_NAME["TUNNEL"], body), sender(), seq=1))
    outer[-1] ^= 1
    _, decoder = run(stamped(attitude(40, 0) + bytes(outer) + attitude(60, 2)))
    assert (decoder.link.frames, decoder.link.bad_crc, decoder.link.skipped_bytes) == (2, 1, 0)


@pytest.fixture
def frames() -> bytes:
    return b"".join(rec[8:] for rec in random_records(np.random.default_rng(2), 200))


@pytest.mark.parametrize("name", ["flight.rlog", "flight.RAW"])
def test_a_raw_log_is_known_by_its_name_and_its_hash_is_the_files(
    name: str, frames: bytes, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(frames)
    check_readable(path)
    digest = hashlib.sha256()
    assert b"".join(read_tlog(path, 1000, digest)) == stamped(frames)
    assert digest.hexdigest() == hashlib.sha256(frames).hexdigest()


def test_any_name_will_do_where_the_format_is_given(frames: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(frames)
    for form in ("auto", "tlog"):
        with pytest.raises(SourceError, match=r"without time stamps.*--format raw"):
            check_readable(path, form)
    assert b"".join(read_tlog(path, form="raw")) == stamped(frames)


def test_a_tlog_is_one_whatever_it_is_called(tmp_path: Path) -> None:
    data = b"".join(random_records(np.random.default_rng(2), 50))
    for name in ("flight.raw", "flight.rlog", "flight.mavlink", "flight"):
        path = tmp_path / name
        path.write_bytes(data)
        assert b"".join(read_tlog(path)) == data


def test_a_raw_log_without_a_frame_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "noise.raw"
    path.write_bytes(bytes(1000))
    for form in ("auto", "raw"):
        with pytest.raises(SourceError, match="no intact MAVLink"):
            check_readable(path, form)


def test_a_vehicle_that_sends_no_attitude_gets_stamps_at_rest() -> None:
    log = FlightLog()
    for i in range(20):
        log.heartbeat(1.0 + i)
    assert stamps_in(stamped(bare(log.data))) == [0] * 20
    assert stamps_in(record(START_US, b"") + log.data[8:]) != [0] * 20
