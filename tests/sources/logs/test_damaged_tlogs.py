"""Every record whose stamp and frame are intact is found and none is invented."""

from __future__ import annotations

import math
import struct
from itertools import accumulate

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pymavlink.generator.mavcrc import x25crc
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
KEPT, SKIPPED, WRONG_CRC, UNKNOWN = "kept", "skipped", "wrong CRC", "unknown"
Part = tuple[bytes, str]


def vibration(stamp_us: int, seq: int, **kinds: bool) -> bytes:
    return record(
        stamp_us, pack(message(BY_NAME["VIBRATION"], b"\x01" * 32), sender(), seq=seq, **kinds)
    )


RECORDS = [vibration(START_US + i, i) for i in range(10)]
SIZE = len(RECORDS[0])


def changed(data: bytes, at: int, to: bytes) -> bytes:
    return data[:at] + to + data[at + len(to) :]


def among(*parts: Part) -> list[Part]:
    """Return parts of a log between five records and five others."""
    whole = [(each, KEPT) for each in RECORDS]
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
    body = changed(RECORDS[1][9:-2], 1, b"\x02")
    crc = x25crc(body)
    crc.accumulate(bytes([BY_NAME["VIBRATION"].crc_extra]))
    return record(START_US, b"\xfd" + body + crc.crc.to_bytes(2, "little"))


def bare(v1: bool) -> bytes:
    msg = message(BY_NAME["SERVO_OUTPUT_RAW"], struct.pack("<I4H", 1, 1500, 1500, 1000, 1500))
    return b"".join(pack(msg, sender(), v1=v1) for _ in range(50))


OLD, NEXT = vibration(START_US, 9, v1=True)[8:], RECORDS[9][8:]
DRIFTED = changed(RECORDS[3], SIZE - 2, bytes([RECORDS[3][-2] ^ 0xFF]))
"""The right id and length under another CRC_EXTRA: the CRC never fits."""
LONGER, TOO_LONG = (changed(RECORDS[2], 8 + 1, bytes([RECORDS[2][9] + n * SIZE])) for n in (1, 2))
NOISE = np.random.default_rng(5).bytes(300_000)
CRLF = random_records(np.random.default_rng(11), 400, start_us=1_500_000_000_000_000)
DAMAGES: dict[str, list[list[Part]]] = {
    "a single record": [[(b"noise", SKIPPED), (RECORDS[0], KEPT)]],
    "garbage alone": [[(NOISE, SKIPPED)]],
    "a torn end": [
        [*among(), (vibration(START_US + 20, 20)[:-cut], SKIPPED)] for cut in (1, 7, 17, 30)
    ],
    "frames inside of a payload": [
        log
        for inner in (NEXT, OLD, RECORDS[9], RECORDS[8] + RECORDS[9], RECORDS[8][8:] + NEXT)
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
            for i, each in enumerate(RECORDS)
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
        [(each.replace(b"\n", b"\r\n"), SKIPPED) for each in RECORDS if b"\n" in each[:8]]
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


@pytest.mark.parametrize("seed", range(2))
def test_all_intact_records_are_found_among_flipped_bytes_and_garbage(seed: int) -> None:
    rng = np.random.default_rng(seed)
    records = random_records(rng, 2500)
    places = sorted(rng.integers(0, len(records), 60).tolist())
    data, truth = b"", []
    for first, last in zip([0, *places], [*places, len(records)], strict=True):
        part, intact = flipped(records[first:last], rng, 3e-4)
        truth += [len(data) + start for start in intact]
        data += part + rng.bytes(int(rng.integers(1, 3000)))
    blocks, decoder = run(data)
    assert orders(blocks) == truth
    assert decoder.link.frames == len(truth)


@given(seed=st.integers(0, 2**32 - 1), rate=st.sampled_from([1e-3, 1e-2]))
def test_all_intact_records_are_found_among_flipped_bytes(seed: int, rate: float) -> None:
    """A stamp that is off by more, next to another one that is off, may be taken for a true one."""
    records = random_records(np.random.default_rng(seed), 40)
    (data, intact), (_, untouched) = (
        flipped(records, np.random.default_rng(seed), rate, days) for days in (3.0, math.inf)
    )
    assume(len(intact) >= 2)
    blocks, _ = run(data)
    assert set(intact) <= set(orders(blocks)) <= set(untouched)
