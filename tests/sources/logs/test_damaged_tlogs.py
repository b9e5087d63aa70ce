"""Every record whose stamp and frame are intact is found and none is invented."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
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

DAY_US = 86400 * 1_000_000


def vibration(stamp_us: int, seq: int, **kinds: bool) -> bytes:
    return record(
        stamp_us, pack(message(BY_NAME["VIBRATION"], b"\x01" * 32), sender(), seq=seq, **kinds)
    )


def flipped(
    records: list[bytes], rng: np.random.Generator, rate: float, days: float = 3.0
) -> tuple[bytes, list[int]]:
    """Return the log with bytes changed at a rate, and where its intact records start.

    A record counts as intact if its frame is untouched and its stamp still within so many days.
    """
    whole = np.frombuffer(b"".join(records), np.uint8).copy()
    hit = np.flatnonzero(rng.random(len(whole)) < rate)
    whole[hit] ^= rng.integers(1, 256, len(hit), dtype=np.uint8)
    data, intact, at = whole.tobytes(), [], 0
    for original in records:
        damaged = data[at : at + len(original)]
        drift = struct.unpack(">Q", damaged[:8])[0] - struct.unpack(">Q", original[:8])[0]
        if damaged[8:] == original[8:] and abs(drift) <= days * DAY_US:
            intact.append(at)
        at += len(original)
    return data, intact


@pytest.mark.parametrize("seed", range(4))
def test_all_intact_records_are_found_among_flipped_bytes_and_garbage(seed: int) -> None:
    rng = np.random.default_rng(seed)
    records = random_records(rng, 2500)
    places = sorted(rng.integers(0, len(records), 60).tolist())
    parts, truth, at = [], [], 0
    for first, last in zip([0, *places], [*places, len(records)], strict=True):
        data, intact = flipped(records[first:last], rng, 3e-4)
        garbage = rng.bytes(int(rng.integers(1, 3000)))
        parts += [data, garbage]
        truth += [at + start for start in intact]
        at += len(data) + len(garbage)
    blocks, decoder = run(b"".join(parts))
    assert orders(blocks) == truth
    assert decoder.link.frames == len(truth)


@given(seed=st.integers(0, 2**32 - 1), rate=st.sampled_from([1e-3, 1e-2]))
def test_all_intact_records_are_found_among_flipped_bytes(seed: int, rate: float) -> None:
    """A stamp that is off by more, next to another one that is off, may be taken for a true one."""
    rng = np.random.default_rng(seed)
    records = random_records(rng, 40)
    (data, intact), (_, untouched) = (
        flipped(records, np.random.default_rng(seed), rate, days) for days in (3.0, math.inf)
    )
    assume(len(intact) >= 2)
    blocks, _ = run(data)
    assert set(intact) <= set(orders(blocks)) <= set(untouched)


@given(
    garbage=st.lists(st.binary(max_size=600), min_size=5, max_size=5),
    seed=st.integers(0, 2**32 - 1),
)
def test_garbage_anywhere_costs_no_record(garbage: list[bytes], seed: int) -> None:
    records = random_records(np.random.default_rng(seed), 4)
    parts, truth, at = [garbage[0]], [], len(garbage[0])
    for rec, noise in zip(records, garbage[1:], strict=True):
        truth.append(at)
        parts += [rec, noise]
        at += len(rec) + len(noise)
    blocks, decoder = run(b"".join(parts))
    assert orders(blocks) == truth
    link = decoder.link
    passed = link.bad_crc + link.unknown
    assert passed or link.skipped_bytes == sum(map(len, garbage))


@pytest.mark.parametrize("cut", [1, 7, 8, 9, 17, 30])
def test_a_torn_end_costs_the_torn_record_only(cut: int) -> None:
    records = random_records(np.random.default_rng(7), 20, ("ATTITUDE", "VIBRATION"))
    data = b"".join(records)[:-cut]
    blocks, decoder = run(data)
    assert len(rows(blocks)) == 19
    assert decoder.link.skipped_bytes == len(records[-1]) - cut


def test_garbage_alone_yields_nothing_and_counts_every_byte() -> None:
    data = np.random.default_rng(5).bytes(300_000)
    blocks, decoder = run(data, cuts=[10_000, 123_456])
    assert blocks == []
    assert decoder.link.frames == 0
    assert decoder.link.skipped_bytes == len(data)
    assert decoder.link.first_us is None


def tunnel(payload: bytes, seq: int = 0) -> bytes:
    body = struct.pack("<HBBB", 0, 1, 1, len(payload)) + payload
    return pack(message(BY_NAME["TUNNEL"], body), sender(), seq=seq)


INNER = {
    "a frame": vibration(START_US, 9)[8:],
    "a frame of MAVLink 1": vibration(START_US, 9, v1=True)[8:],
    "a whole record": vibration(START_US, 9),
    "two records": vibration(START_US, 9) + vibration(START_US, 10),
    "frames in a row": vibration(START_US, 9)[8:] + vibration(START_US, 10)[8:],
}


@pytest.mark.parametrize("inner", INNER.values(), ids=INNER.keys())
@pytest.mark.parametrize("damage", ["none", "crc", "unknown id"])
def test_frames_inside_a_payload_are_not_believed(inner: bytes, damage: str) -> None:
    outer = bytearray(record(START_US + 10, tunnel(inner)))
    if damage == "crc":
        outer[-1] ^= 1
    elif damage == "unknown id":
        outer[8 + 7 : 8 + 10] = b"\xff\xff\xff"
    beside = [vibration(START_US + 20 * i, i) for i in range(6)]
    parts = (beside[i] + bytes(outer) + beside[i + 1] for i in range(0, 6, 2))
    blocks, decoder = run(b"".join(parts))
    names = [row[1] for row in rows(blocks)]
    assert names.count("VIBRATION") == 6
    link = decoder.link
    assert link.frames == 6 + (3 if damage == "none" else 0)
    assert (link.bad_crc, link.unknown) == {"none": (0, 0), "crc": (3, 0), "unknown id": (0, 3)}[
        damage
    ]
    assert link.skipped_bytes == 0


def test_dialect_drift_is_passed_over_whole_however_many_in_a_row() -> None:
    # The right id and length under another CRC_EXTRA: the CRC never fits.
    drifted = bytearray(vibration(START_US + 5, 3))
    drifted[-2] ^= 0xFF
    data = vibration(START_US, 1) + bytes(drifted) * 4 + vibration(START_US + 9, 4)
    for log in (data, bytes(drifted) + data, data + bytes(drifted)):
        _, decoder = run(log)
        assert decoder.link.frames == 2
        assert decoder.link.bad_crc == 4 + (len(log) > len(data))
        assert decoder.link.skipped_bytes == 0


def test_a_damaged_length_that_reaches_a_later_record_costs_no_other() -> None:
    # The third record claims to end where the fourth does.
    records = [vibration(START_US + i, i) for i in range(6)]
    longer = bytearray(records[2])
    longer[8 + 1] += len(records[3])
    blocks, decoder = run(b"".join([*records[:2], bytes(longer), *records[3:]]))
    size = len(records[0])
    assert orders(blocks) == [0, size, 3 * size, 4 * size, 5 * size]
    assert decoder.link.skipped_bytes == size


@pytest.mark.parametrize("garbled", [0, 1, 5, 9])
@pytest.mark.parametrize("stamp", [0, START_US + 4 * DAY_US, 2**63 + 5, 2**64 - 1])
def test_a_record_with_a_nonsense_stamp_is_left_out_alone(garbled: int, stamp: int) -> None:
    records = [vibration(START_US + i, i) for i in range(10)]
    records[garbled] = record(stamp, records[garbled][8:])
    blocks, decoder = run(b"".join(records))
    size = len(records[0])
    assert orders(blocks) == [i * size for i in range(10) if i != garbled]
    assert decoder.link.skipped_bytes == size


def test_a_clock_that_is_set_in_flight_loses_nothing() -> None:
    stamps = [60_000_000 + i for i in range(5)] + [START_US + i for i in range(5)]
    data = b"".join(vibration(stamp, i) for i, stamp in enumerate(stamps))
    for cuts in ([], list(range(1, len(data)))):
        blocks, _ = run(data, cuts)
        assert [row[2] for row in rows(blocks)] == stamps


def test_bursts_on_one_stamp_and_steps_back_lose_nothing() -> None:
    stamps = [START_US] * 26 + [START_US - 1_400_000] * 26 + [START_US - 2 * DAY_US]
    blocks, _ = run(b"".join(vibration(stamp, i) for i, stamp in enumerate(stamps)))
    assert [row[2] for row in rows(blocks)] == stamps


def test_a_single_record_is_believed() -> None:
    blocks, decoder = run(b"noise" + vibration(START_US, 0))
    assert orders(blocks) == [5]
    assert decoder.link.frames == 1


@pytest.mark.parametrize("v1", [False, True])
def test_frames_without_stamps_are_no_records(v1: bool) -> None:
    link = sender()
    msg = message(BY_NAME["SERVO_OUTPUT_RAW"], struct.pack("<I4H", 1, 1500, 1500, 1000, 1500))
    bare = b"".join(pack(msg, link, v1=v1) for _ in range(50))
    for data in (bare, bare[3:], vibration(START_US, 0) * 2 + bare + vibration(START_US, 0) * 2):
        blocks, _ = run(data)
        assert all(row[1] == "VIBRATION" for row in rows(blocks))


def test_a_frame_with_unknown_incompatible_flags_is_not_believed() -> None:
    from pymavlink.generator.mavcrc import x25crc

    body = bytearray(vibration(START_US, 1)[9:-2])
    body[1] = 0x02
    crc = x25crc(bytes(body))
    crc.accumulate(bytes([BY_NAME["VIBRATION"].crc_extra]))
    strange = record(START_US, b"\xfd" + bytes(body) + crc.crc.to_bytes(2, "little"))
    data = vibration(START_US, 0) + strange + vibration(START_US, 2)
    _, decoder = run(data)
    assert decoder.link.frames == 2
    assert decoder.link.skipped_bytes == len(strange)


def test_line_ends_damaged_by_a_text_transfer_cost_only_the_records_that_hold_them() -> None:
    # This start has no line feed in its upper bytes, unlike START_US.
    records = random_records(np.random.default_rng(11), 400, start_us=1_500_000_000_000_000)
    truth, at = [], 0
    for rec in records:
        if b"\n" not in rec:
            truth.append(at)
        at += len(rec.replace(b"\n", b"\r\n"))
    blocks, _ = run(b"".join(records).replace(b"\n", b"\r\n"))
    assert len(truth) > 200
    assert orders(blocks) == truth


def test_stamps_damaged_all_alike_are_not_believed() -> None:
    records = random_records(np.random.default_rng(11), 50)
    assert all(b"\n" in rec[:8] for rec in records)
    blocks, _ = run(b"".join(records).replace(b"\n", b"\r\n"))
    assert blocks == []


def test_a_length_no_message_can_have_hides_no_intact_record() -> None:
    # The third record claims to end where the fifth does; the fifth is damaged, the fourth is not.
    records = [vibration(START_US + i, i) for i in range(7)]
    size = len(records[0])
    longer, damaged = bytearray(records[2]), bytearray(records[4])
    longer[8 + 1] += 2 * size
    damaged[-1] ^= 1
    data = b"".join([*records[:2], bytes(longer), records[3], bytes(damaged), *records[5:]])
    blocks, _ = run(data)
    assert orders(blocks) == [i * size for i in (0, 1, 3, 5, 6)]
