"""Signing against pymavlink's own: the same frames are accepted, and the key never shows."""

from __future__ import annotations

import hashlib
import logging
import traceback
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sources.tlog_records import BY_NAME, KEY, START_US, message, orders, pack, record, sender

from yawid.errors import ConfigError
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.signing import Check, Signing, SigningKey


def signer(
    stamp: int, *, link_id: int = 3, sysid: int = 1, compid: int = 1, key: bytes = KEY
) -> Any:
    """Return pymavlink's encoder that signs, its next time stamp being ``stamp``."""
    link = sender(sysid, compid, signed=True)
    link.signing.secret_key, link.signing.link_id = key, link_id
    link.signing.timestamp = stamp
    return link


def beat(link: Any, seq: int = 0, **kinds: bool) -> bytes:
    return pack(message(BY_NAME["HEARTBEAT"], b"\1\2\3\4\5\6\7\x08\x03"), link, seq=seq, **kinds)


def log(frames: list[bytes]) -> bytes:
    return b"".join(record(START_US + 1000 * i, frame) for i, frame in enumerate(frames))


def decoded(
    frames: list[bytes], key: bytes | None = KEY, cuts: tuple[int, ...] = ()
) -> tuple[list[int], Decoder]:
    """Return which of the frames come out, and the decoder."""
    decoder = Decoder({"HEARTBEAT"}, None if key is None else Signing(SigningKey(key)))
    data = log(frames)
    edges = [0, *cuts, len(data)]
    blocks = [decoder.feed(data[a:b]) for a, b in pairwise(edges)]
    blocks.append(decoder.finish())
    starts = np.cumsum([0, *(8 + len(frame) for frame in frames)]).tolist()
    found = orders([block for block in blocks if block is not None])
    return [starts.index(order) for order in found], decoder


def accepted_by_pymavlink(frames: list[bytes], key: bytes = KEY) -> list[int]:
    link = dialect.MAVLink(None)
    link.signing.secret_key = key
    link.signing.timestamp = 0
    accepted = []
    for i, frame in enumerate(frames):
        try:
            link.decode(bytearray(frame))
            accepted.append(i)
        except dialect.MAVError:
            pass
    return accepted


def test_signed_frames_of_years_ago_are_accepted_in_order() -> None:
    link = signer(1)
    frames = [beat(link, seq=i) for i in range(20)]
    found, decoder = decoded(frames)
    assert found == list(range(20)) == accepted_by_pymavlink(frames)
    assert decoder.link.unsigned_rejected == 0
    assert decoder.link.signed == 20


def test_unsigned_frames_are_rejected_and_counted() -> None:
    good, plain = signer(1), sender()
    radio = pack(message(BY_NAME["RADIO_STATUS"], b"\x01" * 9), sender(51, 68))
    frames = [beat(good), beat(plain, seq=1), beat(plain, seq=2, v1=True), radio, beat(good, seq=3)]
    found, decoder = decoded(frames)
    assert found == [0, 4]
    assert decoder.link.rejected[Check.UNSIGNED] == decoder.link.unsigned_rejected == 3
    assert decoder.link.frames == 5
    assert decoder.link.by_sender[51, 68].rejected == 1
    assert decoder.link.lost == 2  # what was rejected does not fill the sequence


def test_frames_signed_by_another_key_or_altered_are_rejected() -> None:
    good, stranger = signer(1), signer(5, key=bytes(32))
    altered = bytearray(beat(signer(10), seq=2))
    altered[-1] ^= 1
    frames = [beat(good), beat(stranger, seq=1), bytes(altered), beat(signer(20), seq=3)]
    found, decoder = decoded(frames)
    assert found == [0, 3] == accepted_by_pymavlink(frames)
    assert decoder.link.rejected[Check.WRONG] == decoder.link.unsigned_rejected == 2


def test_a_forged_time_stamp_from_the_future_locks_nobody_out() -> None:
    # pymavlink takes the time stamp over before it looks at the signature.
    good = signer(1)
    forged = bytearray(beat(signer(2**40), seq=1))
    forged[-1] ^= 1
    found, _ = decoded([beat(good), bytes(forged), beat(good, seq=2), beat(good, seq=3)])
    assert found == [0, 2, 3]


def test_replayed_frames_are_rejected_and_counted() -> None:
    link = signer(1)
    frames = [beat(link, seq=i) for i in range(10)]
    heard = [*frames, *frames, beat(link, seq=10)]
    found, decoder = decoded(heard)
    assert found == [*range(10), 20] == accepted_by_pymavlink(heard)
    assert decoder.link.rejected[Check.REPLAYED] == decoder.link.unsigned_rejected == 10
    assert decoder.link.duplicates == 0


def test_each_link_and_sender_has_time_stamps_of_its_own() -> None:
    links = [signer(100), signer(90, link_id=4), signer(80, sysid=2), signer(70, compid=5)]
    frames = [beat(link, seq=i) for i in range(3) for link in links]
    found, _ = decoded(frames)
    assert found == list(range(12)) == accepted_by_pymavlink(frames)


def test_a_new_stream_may_not_lie_more_than_a_minute_behind() -> None:
    minute = 60 * 100_000
    newest = 10 * minute
    frames = [
        beat(signer(newest)),
        beat(signer(newest - minute, link_id=4)),
        beat(signer(newest - minute - 1, link_id=5)),
    ]
    found, decoder = decoded(frames)
    assert found == [0, 1] == accepted_by_pymavlink(frames)
    assert decoder.link.rejected[Check.REPLAYED] == 1


@given(data=st.data())
def test_the_frames_accepted_are_those_pymavlink_accepts(data: st.DataObject) -> None:
    frames = []
    for i in range(data.draw(st.integers(2, 25))):
        stamp = data.draw(st.integers(0, 40)) * 1_000_000
        place = {name: data.draw(st.integers(1, 2)) for name in ("link_id", "sysid", "compid")}
        kind = data.draw(st.sampled_from(["signed", "signed", "signed", "plain", "v1"]))
        link = sender(place["sysid"]) if kind == "plain" else signer(stamp, **place)
        frames.append(beat(link, seq=i, v1=kind == "v1"))
    cuts = data.draw(st.lists(st.integers(0, len(log(frames))), max_size=4))
    found, decoder = decoded(frames, cuts=tuple(sorted(cuts)))
    assert found == accepted_by_pymavlink(frames)
    assert decoder.link.unsigned_rejected == len(frames) - len(found)


def test_without_a_key_signed_frames_are_read_and_counted() -> None:
    frames = [beat(signer(1)), beat(signer(1, key=bytes(32)), seq=1), beat(sender(), seq=2)]
    found, decoder = decoded(frames, key=None)
    assert found == [0, 1, 2]
    assert (decoder.link.signed, decoder.link.unsigned_rejected) == (2, 0)


PASSPHRASE = "Überschall am Morgen"
FILES = {
    "raw": (KEY, KEY),
    "raw that ends like a line": (KEY[:31] + b"\n", KEY[:31] + b"\n"),
    "hex": (KEY.hex().encode(), KEY),
    "hex as a line": (KEY.hex().upper().encode() + b"\r\n", KEY),
    "passphrase": (PASSPHRASE.encode(), hashlib.sha256(PASSPHRASE.encode()).digest()),
    "passphrase as a line": (
        PASSPHRASE.encode() + b"\n",
        hashlib.sha256(PASSPHRASE.encode()).digest(),
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_a_key_file_holds_bytes_or_hex_digits_or_a_passphrase(name: str, tmp_path: Path) -> None:
    content, key = FILES[name]
    path = tmp_path / "key"
    path.write_bytes(content)
    frames = [beat(signer(1 + i, key=key), seq=i) for i in range(3)]
    decoder = Decoder({"HEARTBEAT"}, Signing(SigningKey.from_file(path)))
    decoder.feed(log(frames))
    decoder.finish()
    assert (decoder.link.frames, decoder.link.unsigned_rejected) == (3, 0)


SECRET = "open sesame"
NO_KEYS = {
    "empty": b"",
    "a line end": b"\r\n",
    "two lines": f"{SECRET}\n{SECRET}\n".encode(),
    "binary": SECRET.encode() + b"\xff\xfe" * 20,
    "zeros": SECRET.encode() + bytes(5),
    "long": SECRET.encode() * 1000,
}


@pytest.mark.parametrize("name", NO_KEYS)
def test_a_file_that_holds_no_key_is_refused_without_a_word_of_it(
    name: str, tmp_path: Path
) -> None:
    path = tmp_path / "key"
    path.write_bytes(NO_KEYS[name])
    with pytest.raises(ConfigError, match="must hold 32 bytes, 64 hex digits or one line") as info:
        SigningKey.from_file(path)
    assert SECRET not in "".join(traceback.format_exception(info.value))
    assert info.value.__cause__ is None


def test_a_key_file_that_is_missing_or_a_folder_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none", tmp_path):
        with pytest.raises(ConfigError, match=f"signing key file {path}"):
            SigningKey.from_file(path)


def test_a_key_shows_itself_nowhere(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    key = SigningKey(KEY)
    signing = Signing(key)
    decoder = Decoder({"HEARTBEAT"}, signing)
    decoder.feed(log([beat(signer(1)), beat(sender(), seq=1)]))
    shown = [f"{thing!r} {thing!s}" for thing in (key, signing, decoder, decoder.link)]
    shown.append(caplog.text)
    for text in shown:
        assert KEY.hex() not in text
        assert repr(KEY) not in text
    reachable = [vars(signing), vars(decoder), [getattr(key, name) for name in key.__slots__]]
    assert KEY not in repr(reachable).encode()
    with pytest.raises(ConfigError, match="32 bytes, not 3"):
        SigningKey(b"abc")
