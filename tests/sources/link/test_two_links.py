"""Two links carry the same vehicle: a doubled stream gives what a single one gives."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
from flightlog import fly, samples_of
from flights.surgery import join, split
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.generator.mavcrc import x25crc
from sources.tlog_records import BY_NAME, START_US, message, pack, record, rows, run, sender


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


def beats(*times_us: int, count: int = 1) -> list[bytes]:
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
        (beats(*range(0, 2000 * 768, 2000)), 0),
        (beats(0, 2_000_001, count=2), 0),
        (beats(0, 1_999_999, count=2), 1),
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


def test_a_doubled_flight_gives_the_same_samples() -> None:
    log = fly(lambda t: 0.3 * np.sin(2.0 * t), lambda t: 1500 + 100 * (int(t) % 2), 12.0)
    records = [join([each]) for each in split(log.data)]
    once, both = samples_of(log.data), samples_of(b"".join(doubled(records, 6, seed=3)))
    assert len(both) == len(once) > 100
    for name in ("k", "boot_us", "u", "y", "held"):
        np.testing.assert_array_equal(getattr(both, name), getattr(once, name))


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
