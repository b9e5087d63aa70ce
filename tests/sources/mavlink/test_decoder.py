"""The decoder against pymavlink, on drawn and recorded frames, and against itself cut anywhere."""

from __future__ import annotations

import contextlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flights.surgery import split
from fuzz_inputs import KINDS, damage
from hypothesis import example, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc
from recorded_flights import recorded
from sources.tlog_records import (
    BY_NAME,
    CLASSES,
    START_US,
    decode,
    message,
    messages,
    pack,
    random_records,
    record,
    rows,
    run,
    sender,
)

from yawid.channels.stage import WANTED
from yawid.errors import ConfigError
from yawid.sources.mavlink.crc import crc_of_frames
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.definitions import definitions, dtype_of


def as_pymavlink(value: Any) -> Any:
    """Return a column's value the way pymavlink presents it."""
    if isinstance(value, bytes):
        return value.split(b"\0", 1)[0].decode("ascii", errors="replace")
    return value.tolist()


@example(sent=[(message(cls, bytes(range(1, 256))), "v2") for cls in CLASSES], sysid=1, compid=1)
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
        pack(msg, links[kind], seq=i % 256, v1=kind == "v1" and msg.get_msgId() < 256)
        for i, (msg, kind) in enumerate(sent)
    ]
    blocks, decoder = run(b"".join(record(START_US + i, frame) for i, frame in enumerate(frames)))
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
        ids = (block.received_us[row], block.sysid[row], block.compid[row])
        assert ids == (START_US + i, sysid, compid)
        assert set(block.fields.dtype.names or ()) == set(expected.get_fieldnames())
        for field in expected.get_fieldnames():
            ours = as_pymavlink(block.fields[field][row])
            np.testing.assert_array_equal(ours, getattr(expected, field), err_msg=field)


@given(
    seed=st.integers(0, 2**32 - 1),
    damages=st.lists(st.tuples(st.floats(0, 1), KINDS), max_size=6),
    cuts=st.lists(st.floats(0, 1), max_size=12),
    step=st.sampled_from([1, 17, 10**6]),
)
def test_no_cut_changes_what_comes_out(
    seed: int, damages: list[tuple[float, str]], cuts: list[float], step: int
) -> None:
    rng = np.random.default_rng(seed)
    log = bytearray(b"".join(random_records(rng, 12)))
    for where, kind in damages:
        damage(log, where, kind, rng)
    data = bytes(log)
    whole, one_go = run(data)
    places = [int(cut * len(data)) for cut in cuts] + list(range(step, min(len(data), 400), step))
    pieces, decoder = run(data, places)
    assert rows(pieces) == rows(whole)
    assert decoder.link == one_go.link


def test_a_log_longer_than_what_is_worked_on_at_once_comes_out_whole() -> None:
    records = random_records(np.random.default_rng(0), 300)
    data = b"".join(records) * (1 + (5 << 20) // sum(map(len, records)))
    names = frozenset({"ATTITUDE", "PARAM_VALUE", "TUNNEL"})
    (whole, one_go), (pieces, decoder) = (
        run(data, list(range(size, len(data), size)), wanted=names)
        for size in (len(data), (1 << 21) + 1)
    )
    assert decoder.link == one_go.link
    assert decoder.link.frames == len(data) // sum(map(len, records)) * 300
    assert rows(pieces) == rows(whole)
    assert {name for _, name, *_ in rows(whole)} <= names  # others are counted alone


@pytest.mark.parametrize("extra", [b"", b"new field"])
def test_a_payload_longer_than_known_keeps_the_known_fields(extra: bytes) -> None:
    # A newer dialect may add extensions; CRC_EXTRA does not change with them.
    cls, known = BY_NAME["ATTITUDE"], bytes(range(1, 29))
    payload = known + extra
    body = bytes([len(payload), 0, 0, 7, 1, 1]) + cls.id.to_bytes(3, "little") + payload
    crc = x25crc(body + bytes([cls.crc_extra])).crc
    (block,), decoder = run(record(START_US, b"\xfd" + body + crc.to_bytes(2, "little")))
    assert decoder.link.frames == 1
    assert block.messages["ATTITUDE"].fields.tobytes() == known


def test_the_arrays_of_a_block_own_their_memory() -> None:
    records = random_records(np.random.default_rng(3), 40)
    decoder = Decoder(WANTED)
    attitude = pack(message(BY_NAME["ATTITUDE"], b"\x01" * 28), sender())
    block = decoder.feed(record(START_US, attitude) * 2)
    before = block.messages["ATTITUDE"].fields.tobytes()
    decoder.feed(b"".join(records))
    assert block.messages["ATTITUDE"].fields.tobytes() == before


@pytest.mark.parametrize(("count", "longest"), [(0, 3), (1, 265), (31, 3), (32, 20), (900, 265)])
def test_it_equals_pymavlinks_at_every_length_and_place(count: int, longest: int) -> None:
    rng = np.random.default_rng(count + longest)
    data = rng.integers(0, 256, 20_000, dtype=np.uint8)
    first = rng.integers(7, len(data) - longest, count)
    end = first + np.resize(np.arange(2, longest + 1), count)
    extra = rng.integers(0, 256, count, dtype=np.uint8)
    found = crc_of_frames(data, first, end, extra)
    expected = [
        x25crc(data[a:b].tobytes() + bytes([e])).crc
        for a, b, e in zip(first, end, extra, strict=True)
    ]
    assert found.tolist() == expected


@pytest.mark.parametrize(
    ("name", "base"),
    [("ATTITUDE", 28), ("SERVO_OUTPUT_RAW", 21), ("SYS_STATUS", 31), ("STATUSTEXT", 51)],
)
def test_mavlink_1_has_the_base_payload_or_extensions_but_nothing_else(
    name: str, base: int
) -> None:
    known = definitions()
    fits = np.flatnonzero(known.fits_v1[known.names[name]])
    assert (fits[0], fits[-1]) == (base, BY_NAME[name].unpacker.size)


def test_a_name_that_the_dialect_does_not_know_is_refused() -> None:
    for ask in (dtype_of, lambda name: Decoder({name})):
        with pytest.raises(ConfigError, match="ATITUDE"):
            ask("ATITUDE")


def walked(data: bytes) -> Counter[str]:
    """Count messages by pymavlink's decoder, walking from frame to frame.

    pymavlink's own log reader loses good frames where versions mix: it is no oracle.
    """
    counts: Counter[str] = Counter()
    for _, frame in split(data):
        with contextlib.suppress(dialect.MAVError):
            counts[decode(frame).get_type()] += 1
    return counts


@recorded(
    "alfa_carbonz_engine_failure", "vtol_quadplane", "sitl_fbwa_gcs_4hz", "sitl_auto_mavproxy_4hz"
)
def test_every_message_type_is_found_as_often_as_pymavlink_finds_it(log: Path) -> None:
    data = log.read_bytes()
    blocks, decoder = run(data, cuts=[100_000, 100_001, 654_321])
    link, found = decoder.link, Counter[str]()
    for block in blocks:
        found.update({key: len(messages) for key, messages in block.messages.items()})
    assert found == walked(data)
    assert link.frames == sum(link.senders.values())
    assert (link.bad_crc, link.unknown, link.duplicates, link.signed) == (0, 0, 0, 0)
    assert link.skipped_bytes == 0
