"""The decoder against pymavlink, field by field, and against itself cut anywhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from drawn import examples
from hypothesis import given
from hypothesis import strategies as st
from sources.tlog_records import (
    BY_NAME,
    START_US,
    damaged,
    decode,
    message,
    messages,
    orders,
    pack,
    random_records,
    record,
    rows,
    run,
    sender,
)

from yawid.channels.stage import WANTED
from yawid.errors import ConfigError
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.definitions import definitions


def as_pymavlink(value: Any) -> Any:
    """Return a column's value the way pymavlink presents it."""
    if isinstance(value, bytes):
        return value.split(b"\0", 1)[0].decode("ascii", errors="replace")
    return value.tolist()


@given(
    sent=st.lists(st.tuples(messages(), st.sampled_from(["v1", "v2", "signed"])), max_size=5),
    sysid=st.integers(0, 255),
    compid=st.integers(0, 255),
)
def test_every_field_of_every_message_equals_pymavlinks(
    sent: list[tuple[Any, str]], sysid: int, compid: int
) -> None:
    links = {
        kind: sender(sysid, compid, signed=kind == "signed") for kind in ("v1", "v2", "signed")
    }
    frames = [
        pack(msg, links[kind], seq=i, v1=kind == "v1" and msg.get_msgId() < 256)
        for i, (msg, kind) in enumerate(sent)
    ]
    data = b"".join(record(START_US + i, frame) for i, frame in enumerate(frames))
    blocks, decoder = run(data)
    found = {
        (int(order), name): (m, i)
        for block in blocks
        for name, m in block.messages.items()
        for i, order in enumerate(m.order)
    }
    assert decoder.link.frames == len(found) == len(frames)
    at = 0
    for i, frame in enumerate(frames):
        expected = decode(frame)
        block, row = found[at, expected.get_type()]
        at += 8 + len(frame)
        assert block.received_us[row] == START_US + i
        assert (block.sysid[row], block.compid[row]) == (sysid, compid)
        assert set(block.fields.dtype.names or ()) == set(expected.get_fieldnames())
        for field in expected.get_fieldnames():
            ours = as_pymavlink(block.fields[field][row])
            np.testing.assert_array_equal(ours, getattr(expected, field), err_msg=field)


@given(
    seed=st.integers(0, 2**32 - 1),
    damage=st.lists(st.tuples(st.floats(0, 1), st.sampled_from("xgid")), max_size=6),
    cuts=st.lists(st.floats(0, 1), max_size=12),
)
def test_no_cut_changes_what_comes_out(
    seed: int, damage: list[tuple[float, str]], cuts: list[float]
) -> None:
    data = damaged_log(seed, damage)
    whole, one_go = run(data)
    places = [int(cut * len(data)) for cut in cuts]
    pieces, decoder = run(data, places)
    assert rows(pieces) == rows(whole)
    assert decoder.link == one_go.link


@examples(6)
@given(
    seed=st.integers(0, 2**32 - 1),
    damage=st.lists(st.tuples(st.floats(0, 1), st.sampled_from("xgid")), max_size=4),
)
def test_feeding_byte_by_byte_changes_nothing(seed: int, damage: list[tuple[float, str]]) -> None:
    data = damaged_log(seed, damage)
    whole, one_go = run(data)
    pieces, decoder = run(data, list(range(1, len(data))))
    assert rows(pieces) == rows(whole)
    assert decoder.link == one_go.link


def damaged_log(seed: int, damage: list[tuple[float, str]]) -> bytes:
    rng = np.random.default_rng(seed)
    return bytes(damaged(rng, b"".join(random_records(rng, 12)), damage))


@pytest.mark.parametrize("sizes", [1 << 12, (1 << 21) + 1])
def test_a_log_longer_than_what_is_worked_on_at_once_comes_out_whole(sizes: int) -> None:
    records = random_records(np.random.default_rng(0), 300)
    data = b"".join(records) * (1 + (5 << 20) // sum(map(len, records)))
    names = frozenset({"ATTITUDE", "PARAM_VALUE", "TUNNEL"})
    whole, one_go = run(data, wanted=names)
    pieces, decoder = run(data, list(range(sizes, len(data), sizes)), wanted=names)
    assert decoder.link == one_go.link
    assert decoder.link.frames == len(data) // sum(map(len, records)) * 300
    assert rows(pieces) == rows(whole)


def test_messages_that_are_not_wanted_are_counted_but_not_returned() -> None:
    msg = message(BY_NAME["VIBRATION"], b"\x01" * 32)
    blocks, decoder = run(record(START_US, pack(msg, sender())), wanted=frozenset({"ATTITUDE"}))
    assert blocks == []
    assert decoder.link.frames == 1


def test_a_payload_longer_than_known_keeps_the_known_fields() -> None:
    # A newer dialect may add extensions; CRC_EXTRA does not change with them.
    cls = BY_NAME["ATTITUDE"]
    known = bytes(range(1, 29))
    frame = longer_frame(cls, known + b"new field")
    (block,), decoder = run(record(START_US, frame))
    assert decoder.link.frames == 1
    assert block.messages["ATTITUDE"].fields.tobytes() == known


def longer_frame(cls: Any, payload: bytes) -> bytes:
    from pymavlink.generator.mavcrc import x25crc

    body: bytes = bytes([len(payload), 0, 0, 7, 1, 1]) + cls.id.to_bytes(3, "little") + payload
    crc = x25crc(body)
    crc.accumulate(bytes([cls.crc_extra]))
    return b"\xfd" + bytes(body) + int(crc.crc).to_bytes(2, "little")


def test_text_keeps_its_bytes_without_trailing_zeros() -> None:
    msg = BY_NAME["PARAM_VALUE"](b"SERVO4_FUNCTION\0", 21.0, 2, 100, 7)
    (block,), _ = run(record(START_US, pack(msg, sender())))
    fields = block.messages["PARAM_VALUE"].fields
    assert fields["param_id"].dtype == np.dtype("S16")
    assert fields["param_id"][0] == b"SERVO4_FUNCTION"
    assert fields["param_value"][0] == 21.0


def test_a_name_the_dialect_does_not_know_is_refused() -> None:
    with pytest.raises(ConfigError, match="ATITUDE"):
        Decoder({"ATITUDE"})


def test_the_dialect_knows_every_message_that_the_channels_read() -> None:
    assert definitions().names.keys() >= WANTED


def test_order_is_the_byte_at_which_the_record_starts() -> None:
    records = random_records(np.random.default_rng(3), 40)
    blocks, _ = run(b"".join(records), cuts=[100, 1000])
    assert orders(blocks) == np.cumsum([0, *map(len, records[:-1])]).tolist()


def test_the_arrays_returned_own_their_memory() -> None:
    records = random_records(np.random.default_rng(4), 30)
    decoder = Decoder({"ATTITUDE"})
    msg = pack(message(BY_NAME["ATTITUDE"], b"\x01" * 28), sender())
    block = decoder.feed(record(START_US, msg) * 2)
    assert block is not None
    before = block.messages["ATTITUDE"].fields.tobytes()
    decoder.feed(b"".join(records))
    assert block.messages["ATTITUDE"].fields.tobytes() == before
