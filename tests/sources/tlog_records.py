"""Real MAVLink frames made by pymavlink, and tlog records of them."""

from __future__ import annotations

import struct
from itertools import pairwise
from typing import Any

import numpy as np
from flights.surgery import message_of
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from yawid.blocks import FrameBlock
from yawid.sources.mavlink.decoder import Decoder

START_US = 1_700_000_000_000_000
ALL_NAMES = frozenset(cls.msgname for cls in dialect.mavlink_map.values())
CLASSES = sorted(dialect.mavlink_map.values(), key=lambda cls: cls.id)
BY_NAME = {cls.msgname: cls for cls in CLASSES}
KEY = bytes(range(32))


def sender(sysid: int = 1, compid: int = 1, *, signed: bool = False) -> Any:
    """Return pymavlink's encoder for one sender."""
    link = dialect.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    if signed:
        link.signing.secret_key = KEY
        link.signing.link_id = 3
        link.signing.timestamp = 1
        link.signing.sign_outgoing = True
    return link


def message(cls: Any, payload: bytes) -> Any:
    return message_of(cls.msgname, payload)


def pack(msg: Any, link: Any, *, seq: int | None = None, v1: bool = False) -> bytes:
    """Return the frame; the sender's sequence goes on unless ``seq`` is given."""
    if seq is not None:
        link.seq = seq
    frame: bytes = msg.pack(link, force_mavlink1=v1)
    link.seq = (link.seq + 1) % 256
    return frame


def record(stamp_us: int, frame: bytes) -> bytes:
    return struct.pack(">Q", stamp_us) + frame


def decode(frame: bytes) -> Any:
    """Return what pymavlink makes of one frame."""
    return dialect.MAVLink(None).decode(bytearray(frame))


def random_records(
    rng: np.random.Generator,
    count: int,
    names: tuple[str, ...] | None = None,
    start_us: int = START_US,
) -> list[bytes]:
    """Return records of random messages, versions and payload lengths from one vehicle."""
    link, records = sender(), []
    classes = [BY_NAME[name] for name in names] if names else CLASSES
    for i in range(count):
        cls = classes[int(rng.integers(len(classes)))]
        payload = rng.bytes(int(rng.integers(1, cls.unpacker.size + 1)))
        v1 = cls.id < 256 and bool(rng.random() < 0.3)
        records.append(record(start_us + 4000 * i, pack(message(cls, payload), link, v1=v1)))
    return records


def run(
    data: bytes,
    cuts: list[int] | None = None,
    wanted: frozenset[str] = ALL_NAMES,
    decoder: Decoder | None = None,
) -> tuple[list[FrameBlock], Decoder]:
    """Feed ``data`` cut at the given places and return the blocks and the finished decoder."""
    decoder = decoder or Decoder(wanted)
    edges = [0, *sorted(cuts or []), len(data)]
    blocks = [decoder.feed(data[a:b]) for a, b in pairwise(edges)]
    blocks.append(decoder.finish())
    return [block for block in blocks if block is not None], decoder


def rows(blocks: list[FrameBlock]) -> list[tuple[Any, ...]]:
    """Return all messages as rows in the order heard, fields as bytes."""
    found = [
        (
            int(m.order[i]),
            m.name,
            int(m.received_us[i]),
            int(m.sysid[i]),
            int(m.compid[i]),
            m.fields[i].tobytes(),
        )
        for block in blocks
        for m in block.messages.values()
        for i in range(len(m))
    ]
    return sorted(found)


def orders(blocks: list[FrameBlock]) -> list[int]:
    return [row[0] for row in rows(blocks)]


@st.composite
def messages(draw: st.DrawFn) -> Any:
    cls = draw(st.sampled_from(CLASSES))
    return message(cls, draw(st.binary(min_size=0, max_size=cls.unpacker.size)))
