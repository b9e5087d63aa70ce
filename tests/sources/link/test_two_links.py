"""Two links carry the same vehicle: a doubled stream gives what a single one gives."""

from __future__ import annotations

import random
from itertools import pairwise

import numpy as np
import pytest
from flightlog import fly, samples_of
from flights.surgery import join, split
from hypothesis import given
from hypothesis import strategies as st
from sources.tlog_records import BY_NAME, START_US, message, pack, record, rows, run, sender

from yawid.blocks import MessageBlock


def records_of(log: bytes) -> list[bytes]:
    """Return the records of an intact log."""
    return [join([each]) for each in split(log)]


def doubled(records: list[bytes], most_behind: int, seed: int, drop: float = 0.0) -> list[bytes]:
    """Return the records with a copy of each, stamped by link 1, up to so many records later."""
    rng = random.Random(seed)
    queue = []
    for i, rec in enumerate(records):
        later = i + rng.randint(0, most_behind)
        stamp = int.from_bytes(records[min(later, len(records) - 1)][:8], "big")
        queue += [(i, 0, rec), (later, 1, record((stamp & ~3) | 1, rec[8:]))]
    queue.sort(key=lambda entry: entry[:2])
    return [rec for _, _, rec in queue if rng.random() >= drop]


def contents(blocks: list[MessageBlock]) -> list[tuple[object, ...]]:
    return [row[1:2] + row[3:] for row in rows(blocks)]


def vehicle(count: int, first: int = 0, kind: str = "ATTITUDE") -> list[bytes]:
    """Return records whose payloads differ, at 250 a second."""
    link = sender()
    cls = BY_NAME[kind]
    return [
        record(
            START_US + 4000 * i,
            pack(message(cls, (i + 1).to_bytes(4, "little")), link, seq=(first + i) % 256),
        )
        for i in range(count)
    ]


@pytest.mark.parametrize("behind", [0, 1, 40, 100])
def test_a_doubled_stream_gives_the_same_messages_and_counts(behind: int) -> None:
    records = vehicle(700)
    single, _ = run(b"".join(records))
    twice, decoder = run(b"".join(doubled(records, behind, seed=behind)))
    assert sorted(contents(twice)) == sorted(contents(single))
    link = decoder.link
    assert (link.frames, link.duplicates, link.lost) == (1400, 700, 0)
    assert link.by_sender[1, 1].duplicates == 700


def test_a_doubled_flight_gives_the_same_samples() -> None:
    log = fly(lambda t: 0.3 * np.sin(2.0 * t), lambda t: 1500 + 100 * (int(t) % 2), 12.0)
    once = samples_of(log.data)
    both = samples_of(b"".join(doubled(records_of(log.data), 6, seed=3)))
    assert len(both) == len(once) > 100
    for name in ("k", "boot_us", "u", "y", "held"):
        np.testing.assert_array_equal(getattr(both, name), getattr(once, name))


def test_three_links_leave_one_frame_of_three() -> None:
    records = vehicle(300)
    triple = [rec for rec in records for _ in range(3)]
    blocks, decoder = run(b"".join(triple))
    assert len(rows(blocks)) == 300
    assert decoder.link.duplicates == 600


def test_what_one_link_lost_and_the_other_brought_is_not_lost() -> None:
    records = vehicle(1000)
    heard = doubled(records, 8, seed=5, drop=0.1)
    missing = 1000 - len({rec[8:] for rec in heard})
    blocks, decoder = run(b"".join(heard))
    assert len(rows(blocks)) == 1000 - missing
    assert decoder.link.duplicates == len(heard) - (1000 - missing)
    assert abs(decoder.link.lost - missing) <= 8
    assert missing > 4


@given(
    seed=st.integers(0, 2**32 - 1),
    behind=st.integers(0, 120),
    drop=st.sampled_from([0.0, 0.3, 0.9]),
    cuts=st.lists(st.floats(0, 1), max_size=8),
)
def test_no_cut_changes_what_is_a_duplicate(
    seed: int, behind: int, drop: float, cuts: list[float]
) -> None:
    heard = doubled(vehicle(300, first=seed % 256), behind, seed, drop)
    data = b"".join(heard)
    whole, one_go = run(data)
    places = sorted(int(cut * len(data)) for cut in cuts)
    pieces, decoder = run(data, places)
    assert rows(pieces) == rows(whole)
    assert decoder.link == one_go.link


def test_the_same_bytes_a_whole_turn_of_the_sequence_later_are_no_duplicate() -> None:
    # At 500 messages a second the sequence turns in half a second.
    link, heartbeat = sender(), message(BY_NAME["HEARTBEAT"], b"\1\2\3\4\5\6\7\x08\x03")
    records = [
        record(START_US + 2000 * i, pack(heartbeat, link, seq=i % 256)) for i in range(3 * 256)
    ]
    blocks, decoder = run(b"".join(records))
    assert len(rows(blocks)) == 3 * 256
    assert decoder.link.duplicates == 0


def test_the_same_bytes_seconds_later_are_no_duplicate() -> None:
    heartbeat = message(BY_NAME["HEARTBEAT"], b"\1\2\3\4\5\6\7\x08\x03")
    frame = pack(heartbeat, sender(), seq=0)
    _, decoder = run(record(START_US, frame) + record(START_US + 2_000_001, frame))
    assert decoder.link.duplicates == 0
    _, decoder = run(record(START_US, frame) + record(START_US + 1_999_999, frame))
    assert decoder.link.duplicates == 1


def test_another_payload_under_the_same_number_is_no_duplicate() -> None:
    link = sender()
    frames = [
        pack(message(BY_NAME["ATTITUDE"], bytes([i + 1])), link, seq=n)
        for i, n in enumerate([5, 5, 6, 6, 7, 5])
    ]
    data = b"".join(record(START_US + i, frame) for i, frame in enumerate(frames))
    blocks, decoder = run(data)
    assert len(rows(blocks)) == 6
    assert decoder.link.duplicates == 0


def test_frames_that_differ_in_their_middle_only_are_told_apart() -> None:
    # All but the 30 bytes in the middle of the payload are the same, the check sum too.
    from pymavlink.generator.mavcrc import x25crc

    cls, seen = BY_NAME["STATUSTEXT"], {}
    rng = np.random.default_rng(1)
    pair = None
    while pair is None:
        payload = b"\x01" * 10 + rng.bytes(30) + b"\x01" * 11
        crc = x25crc(payload).crc
        pair = (seen[crc], payload) if crc in seen else None
        seen[crc] = payload
    frames = [pack(message(cls, payload), sender(), seq=9) for payload in pair]
    assert frames[0][-2:] == frames[1][-2:]
    for cut in ([], [8 + len(frames[0])]):
        _, decoder = run(b"".join(record(START_US, frame) for frame in frames), cut)
        assert decoder.link.duplicates == 0


def test_a_restart_leaves_no_trace_in_what_follows() -> None:
    before, after = vehicle(150), vehicle(400, first=40)
    shifted = [record(START_US + 3_000_000 + 4000 * i, rec[8:]) for i, rec in enumerate(after)]
    blocks, decoder = run(b"".join(before + shifted))
    assert len(rows(blocks)) == 550
    assert (decoder.link.duplicates, decoder.link.lost) == (0, 0)


def test_the_pieces_of_a_live_link_count_as_the_whole() -> None:
    data = b"".join(doubled(vehicle(120), 5, seed=8))
    edges = np.cumsum([len(rec) for rec in records_of(data)]).tolist()
    whole, one_go = run(data)
    pieces, decoder = run(data, [b for _, b in pairwise([0, *edges[:-1]])])
    assert rows(pieces) == rows(whole)
    assert decoder.link == one_go.link
