"""What a link carried, counted per sender; a stream that two links carry gives what one gives."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.generator.mavcrc import x25crc
from sources.tlog_records import BY_NAME, START_US, message, pack, record, rows, run, sender

from yawid.quantities.link import LinkStats


def heartbeat(kind: int) -> Any:
    return BY_NAME["HEARTBEAT"](kind, 3, 0, 0, 4, 3)


def stats(frames: list[bytes]) -> LinkStats:
    _, decoder = run(b"".join(record(START_US + i, frame) for i, frame in enumerate(frames)))
    return decoder.link


def beats(seqs: list[int], sysid: int = 1, compid: int = 1, kind: int = 1) -> list[bytes]:
    link = sender(sysid, compid)
    return [pack(heartbeat(kind), link, seq=seq) for seq in seqs]


RADIO = beats([90, 91, 95], sysid=51, compid=68, kind=0)
VIBRATION = pack(message(BY_NAME["VIBRATION"], b"\x01"), sender(), seq=1)


@pytest.mark.parametrize(
    ("frames", "lost"),
    [
        (beats([0, 1, 2, 3]), 0),
        (beats([254, 255, 0, 1]), 0),
        (beats([5, 7, 8, 11]), 3),
        (beats([250, 4]), 9),
        (beats([10, 138]), 127),
        (beats([10, 139]), 0),  # more than 127 missing is a restart
        (beats([200, 0, 1]), 55),
        (beats([3, 3, 4]), 0),  # a duplicate
        (beats([3, 5, 4, 6]), 0),  # one that came late
        (beats([3, 8, 4, 6, 9]), 2),  # two of four came late
        # A restart by a few, not twenty that came late.
        (beats([*range(60), *range(40, 60)]), 0),
        # Each sender has its own sequence, those of ground stations do not count.
        ([RADIO[0], *beats([0, 1]), RADIO[1], *beats([3]), RADIO[2]], 1 + 3),
        ([*beats([0, 10, 50], 255, 190, 0), *beats([0, 2])], 1),
        ([*beats([0, 10, 50], 254, 190, 6), *beats([0, 2])], 1),
        ([*beats([0]), VIBRATION, *beats([2])], 0),  # though it is not wanted
    ],
)
def test_losses_are_gaps_of_the_sequence_of_each_sender(frames: list[bytes], lost: int) -> None:
    link = stats(frames)
    assert link.lost == lost
    assert sum(link.senders.values()) == link.frames
    assert (link.first_us, link.last_us) == (START_US, START_US + len(frames) - 1)


@pytest.mark.parametrize("cuts", [[], [400], list(range(100, 9000, 100))])
@pytest.mark.parametrize(
    ("skipped", "slowly", "lost"),
    [
        ((155, 196, 153), 1.0, 155 + 196 + 153),  # each takes as long as its frames would have
        ((155, 196, 153), 1.8, 155 + 196 + 153),
        ((155, 196, 153), 0.2, 0),  # too short for so many: the sender started again
        ((155, 196, 153), 3.0, 0),  # too long
        ((100, 155), 1.0, 255),
        ((235, 100), 1.0, 100),  # a step of 236 is one back by 20
    ],
)
def test_a_jump_is_a_loss_if_it_took_as_long_as_the_frames(
    skipped: tuple[int, ...], slowly: float, lost: int, cuts: list[int]
) -> None:
    """Frames every 2 ms, 70 between two losses."""
    seq, at_us, data = 0, START_US, b""
    link = sender(1, 1)
    for missing in (*skipped, 0):
        for _ in range(70):
            beat = BY_NAME["HEARTBEAT"](1, 3, 0, seq, 4, 3)  # no two are the same to the byte
            data += record(at_us, pack(beat, link, seq=seq % 256))
            seq, at_us = seq + 1, at_us + 2000
        seq, at_us = seq + missing, at_us + round(2000 * missing * slowly)

    _, decoder = run(data, cuts=cuts)
    assert decoder.link.lost == lost


def test_damaged_and_unknown_frames_count_for_the_sender_they_name_if_it_was_ever_heard() -> None:
    def damaged(frame: bytes) -> bytes:
        return frame[:-1] + bytes([frame[-1] ^ 1])

    def unknown(frame: bytes) -> bytes:
        return frame[:7] + b"\xff\xff\xff" + frame[10:]

    vehicle, radio = beats([0, 1, 2, 3]), beats([0, 1], sysid=51, compid=68, kind=0)
    old = [pack(heartbeat(1), sender(7, 2), seq=i, v1=True) for i in range(3)]
    noise = unknown(beats([0], sysid=99, compid=9)[0])
    passed = [damaged(vehicle[1]), damaged(vehicle[2]), unknown(radio[1]), damaged(old[1]), noise]
    intact = [vehicle[0], radio[0], old[0], vehicle[3], old[2], vehicle[3]]
    frames = [f for pair in zip(intact[:5], passed, strict=True) for f in pair] + intact[5:]

    link = stats([*frames, *[pack(heartbeat(1), sender(7, 2, signed=True), seq=3)] * 2])

    counted = {key: (s.frames, s.bad_crc, s.unknown) for key, s in link.by_sender.items()}
    assert counted == {(1, 1): (3, 2, 0), (51, 68): (1, 0, 1), (7, 2): (4, 1, 0)}
    assert (link.bad_crc, link.unknown, link.skipped_bytes, link.signed) == (3, 2, 0, 2)


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


def vehicle(count: int, first: int = 0, since_us: int = 0) -> list[bytes]:
    """Return records whose payloads differ, at 250 a second."""
    link = sender()
    payloads = (message(BY_NAME["ATTITUDE"], (i + 1).to_bytes(4, "little")) for i in range(count))
    return [
        record(START_US + since_us + 4000 * i, pack(each, link, seq=(first + i) % 256))
        for i, each in enumerate(payloads)
    ]


BEAT = message(BY_NAME["HEARTBEAT"], b"\1\2\3\4\5\6\7\x08\x03")


def at_times(*times_us: int, count: int = 1) -> list[bytes]:
    """Return equal heartbeats; the sequence turns after 256."""
    return [record(START_US + t, pack(BEAT, sender(), seq=i // count % 256))
            for i, t in enumerate(times_us)]  # fmt: skip


def of_numbers(*numbers: int) -> list[bytes]:
    return [vehicle(i + 1, n - i)[i] for i, n in enumerate(numbers)]


def alike_but_for_their_middle() -> list[bytes]:
    """Two frames of one number whose payloads differ in 30 bytes: the check sum is the same."""
    seen: dict[int, bytes] = {}
    rng = np.random.default_rng(1)
    while True:
        payload = b"\x01" * 10 + rng.bytes(30) + b"\x01" * 11
        if (crc := x25crc(payload).crc) in seen:
            both = seen[crc], payload
            return [
                record(START_US, pack(message(BY_NAME["STATUSTEXT"], each), sender(), seq=9))
                for each in both
            ]
        seen[crc] = payload


@pytest.mark.parametrize(
    ("heard", "duplicates"),
    [
        *[(doubled(vehicle(700), behind, behind), 700) for behind in (0, 1, 40, 100)],
        ([rec for rec in vehicle(300) for _ in range(3)], 600),
        # At 500 messages a second the sequence turns in half a second.
        (at_times(*range(0, 2000 * 768, 2000)), 0),
        (at_times(0, 2_000_001, count=2), 0),
        (at_times(0, 1_999_999, count=2), 1),
        (of_numbers(5, 5, 6, 6, 7, 5), 0),  # another payload under the same number
        (alike_but_for_their_middle(), 0),
        (vehicle(150) + vehicle(400, first=40, since_us=3_000_000), 0),  # a restart
    ],
)
def test_what_comes_again_is_a_duplicate_and_is_left_out(
    heard: list[bytes], duplicates: int
) -> None:
    for cuts in ([], [len(heard[0])]):
        blocks, decoder = run(b"".join(heard), cuts)
        link = decoder.link
        assert len(rows(blocks)) == len(heard) - duplicates
        assert (link.frames, link.duplicates, link.lost) == (len(heard), duplicates, 0)


def test_what_one_link_lost_and_the_other_brought_is_not_lost() -> None:
    heard = doubled(vehicle(1000), 8, seed=5, drop=0.1)
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
    edges: Any = np.cumsum([len(each) for each in heard]).tolist()
    data = b"".join(heard)
    whole, one_go = run(data)
    for places in ([int(cut * len(data)) for cut in cuts], edges[:40]):  # or as of a live link
        pieces, decoder = run(data, places)
        assert rows(pieces) == rows(whole)
        assert decoder.link == one_go.link
