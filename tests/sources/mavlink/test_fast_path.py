"""The short way of the decoder and the long one: of a few records both make the same."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sources.tlog_records import (
    ALL_NAMES,
    BY_NAME,
    START_US,
    message,
    pack,
    random_records,
    record,
    sender,
)

from yawid.blocks import FrameBlock, MessageBlock
from yawid.channels.stage import WANTED
from yawid.sources.mavlink import decoder as frames
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.definitions import definitions
from yawid.sources.mavlink.fast_path import PlainReader

SENDERS = [(1, 1, False), (1, 158, True), (255, 190, False), (51, 68, False)]
DAMAGE = st.sampled_from(["byte", "cut", "twice", "late", "stamp", "unknown", "tail"])


def stream(seed: int, count: int) -> list[bytes]:
    """Records of four senders: signed and version 1 frames, payloads cut short, a ground station's
    HEARTBEAT, numbers that start anywhere and now and then leave some out."""
    rng = np.random.default_rng(seed)
    links = [sender(sysid, compid, signed=signed) for sysid, compid, signed in SENDERS]
    for link in links:
        link.seq = int(rng.integers(256))
    names, made = sorted(ALL_NAMES), []
    for i in range(count):
        link = links[int(rng.choice(4, p=[0.6, 0.2, 0.1, 0.1]))]
        cls = BY_NAME[names[int(rng.integers(len(names)))]]
        if rng.random() < 0.2:
            cls = BY_NAME["HEARTBEAT"]
        payload = rng.bytes(int(rng.integers(0, cls.unpacker.size + 1)))
        if cls.msgname == "HEARTBEAT" and rng.random() < 0.5:
            payload = b"\0\0\0\0\6\x08\0\0\3"
        v1 = cls.id < 256 and rng.random() < 0.3
        if rng.random() < 0.1:
            link.seq = (link.seq + int(rng.integers(1, 200))) % 256
        frame = pack(message(cls, payload), link, v1=bool(v1))
        made.append(record(START_US + 4000 * i, frame))
    return made


def harmed(records: list[bytes], where: float, kind: str) -> list[bytes]:
    """The records with one of them damaged, repeated, late, with another stamp or cut short."""
    i = int(where * (len(records) - 1))
    one = records[i]
    changed: dict[str, list[bytes]] = {
        "byte": [one[:-4] + bytes(b ^ 0x10 for b in one[-4:-3]) + one[-3:]],
        "cut": [one[:11], one[14:]],
        "twice": [one, one],
        "late": [],
        "stamp": [b"\0\x01" + one[2:]],
        "unknown": [one[:15] + b"\xfa\xff" + one[17:]],
        "tail": [one, b"\xfd\x20"],
    }
    rest = records[i + 1 :]
    if kind == "late":
        rest.insert(min(3, len(rest)), one)
    return [*records[:i], *changed[kind], *rest]


def both(pieces: list[bytes], few: int) -> tuple[list[FrameBlock | None], list[Any]]:
    """What each feed returns, and the counts after it, where so many bytes are called few."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(frames, "FEW", few)
        decoder, blocks, counts = Decoder(ALL_NAMES), [], []
        for piece in pieces:
            blocks.append(decoder.feed(piece))
            counts.append(decoder.link)
        blocks.append(decoder.finish())
        return blocks, [*counts, decoder.link]


def columns(blocks: list[FrameBlock | None]) -> list[list[tuple[Any, ...]]]:
    def of(m: MessageBlock) -> tuple[Any, ...]:
        arrays = (m.order, m.received_us, m.sysid, m.compid, m.fields)
        return (m.name, *((a.dtype, a.shape, a.tobytes()) for a in arrays))

    return [[of(m) for m in (block.messages if block else {}).values()] for block in blocks]


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    damage=st.lists(st.tuples(st.floats(0, 1), DAMAGE), max_size=3),
    sizes=st.lists(st.integers(1, 12), min_size=1, max_size=8),
)
def test_a_few_records_come_out_as_they_do_among_many(
    seed: int, damage: list[tuple[float, str]], sizes: list[int]
) -> None:
    records = stream(seed, 60)
    for where, kind in damage:
        records = harmed(records, where, kind)
    edges = [0]
    while edges[-1] < len(records):
        edges.append(edges[-1] + sizes[len(edges) % len(sizes)])
    pieces = [b"".join(records[a:b]) for a, b in pairwise(edges)]
    (short, short_counts), (long, long_counts) = both(pieces, 1 << 13), both(pieces, 0)
    assert columns(short) == columns(long)
    assert short_counts == long_counts


def test_the_short_way_is_the_one_taken_and_stops_at_what_is_odd() -> None:
    reader, records = PlainReader(definitions()), random_records(np.random.default_rng(1), 40)
    whole = reader.read(b"".join(records), START_US)
    assert whole is not None
    assert [end - begin + 8 for begin, _, end, *_ in whole] == [len(one) for one in records]
    for i, kind in enumerate(["byte", "cut", "stamp", "unknown", "tail"]):
        assert reader.read(b"".join(harmed(records, i / 8, kind)), START_US) is None, kind
    assert reader.read(b"".join(records), START_US - 4 * 86400 * 1_000_000) is None


def test_what_a_live_link_sends_takes_the_short_way(monkeypatch: pytest.MonkeyPatch) -> None:
    decoder, data = Decoder(WANTED), random_records(np.random.default_rng(2), 200)
    first = 10  # the first records of all, and of a sender, are the long way's
    decoder.feed(b"".join(data[:first]))
    monkeypatch.delattr(Decoder, "_decode")
    for at in range(first, 200, 5):
        decoder.feed(b"".join(data[at : at + 5]))
    assert decoder.link.frames == 200
