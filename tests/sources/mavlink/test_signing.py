"""Signing against pymavlink's own: the same frames are accepted, and the key never shows."""

from __future__ import annotations

import hashlib
import logging
import traceback
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sources.tlog_records import BY_NAME, KEY, START_US, message, orders, pack, record, run, sender

from yawid.errors import ConfigError
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.signing import Check, Signing, SigningKey

OURS = SigningKey(KEY)


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


def altered(frame: bytes) -> bytes:
    return frame[:-1] + bytes([frame[-1] ^ 1])


def decoded(
    frames: list[bytes], key: SigningKey | None = OURS, cuts: tuple[int, ...] = ()
) -> tuple[list[int], Decoder]:
    """Return which of the frames come out, and the decoder."""
    decoder = Decoder({"HEARTBEAT"}, None if key is None else Signing(key))
    data = b"".join(record(START_US + 1000 * i, frame) for i, frame in enumerate(frames))
    blocks, _ = run(data, [cut % (len(data) + 1) for cut in cuts], decoder=decoder)
    starts = np.cumsum([0, *(8 + len(frame) for frame in frames)]).tolist()
    return [starts.index(order) for order in orders(blocks)], decoder


def accepted_by_pymavlink(frames: list[bytes]) -> list[int]:
    link = dialect.MAVLink(None)
    link.signing.secret_key = KEY
    link.signing.timestamp = 0
    accepted = []
    for i, frame in enumerate(frames):
        try:
            link.decode(bytearray(frame))
            accepted.append(i)
        except dialect.MAVError:
            pass
    return accepted


def test_unsigned_altered_and_other_frames_are_rejected_and_counted() -> None:
    good, plain = signer(1), sender()
    radio = pack(message(BY_NAME["RADIO_STATUS"], b"\x01" * 9), sender(51, 68))
    frames = [
        *(beat(good), beat(plain, seq=1), beat(plain, seq=2, v1=True), radio, beat(good, seq=3)),
        *(beat(signer(5, key=bytes(32)), seq=4), altered(beat(signer(10), seq=5))),
        # pymavlink takes the time stamp of a forged frame over before it looks at the signature.
        *(altered(beat(signer(2**40), seq=6)), beat(good, seq=7)),
    ]
    found, decoder = decoded(frames)
    link = decoder.link
    assert found == [0, 4, 8]
    assert (link.rejected[Check.UNSIGNED], link.rejected[Check.WRONG]) == (3, 3)
    assert (link.unsigned_rejected, link.frames, link.by_sender[51, 68].rejected) == (6, 9, 1)
    assert link.lost == 5  # what was rejected does not fill the sequence
    everything, without = decoded(frames, key=None)
    assert len(everything) == 8
    assert (without.link.signed, without.link.unsigned_rejected) == (6, 0)


def test_replayed_frames_are_rejected_and_counted() -> None:
    link = signer(1)
    frames = [beat(link, seq=i) for i in range(10)]
    heard = [*frames, *frames, beat(link, seq=10)]
    found, decoder = decoded(heard)
    assert found == [*range(10), 20] == accepted_by_pymavlink(heard)
    assert decoder.link.rejected[Check.REPLAYED] == decoder.link.unsigned_rejected == 10
    assert decoder.link.duplicates == 0


MINUTE = 60 * 100_000


@pytest.mark.parametrize(
    ("links", "each", "found"),
    [
        ([signer(100), signer(90, link_id=4), signer(80, sysid=2), signer(70, compid=5)], 3, 12),
        # A new stream may not lie more than a minute behind.
        ([signer(10 * MINUTE), signer(9 * MINUTE, link_id=4), signer(9 * MINUTE - 1, link_id=5)],
         1, 2),
    ],
)  # fmt: skip
def test_each_link_and_sender_has_time_stamps_of_its_own(
    links: list[Any], each: int, found: int
) -> None:
    frames = [beat(link, seq=i) for i in range(each) for link in links]
    accepted, decoder = decoded(frames)
    assert accepted == list(range(found)) == accepted_by_pymavlink(frames)
    assert decoder.link.rejected[Check.REPLAYED] == len(frames) - found


@given(
    sent=st.lists(
        st.tuples(
            st.integers(0, 40),
            st.fixed_dictionaries(dict.fromkeys(("link_id", "sysid", "compid"), st.integers(1, 2))),
            st.sampled_from(["signed", "signed", "signed", "plain", "v1"]),
        ),
        min_size=2,
        max_size=25,
    ),
    cuts=st.lists(st.integers(0, 10**4), max_size=4).map(tuple),
)
def test_the_frames_accepted_are_those_pymavlink_accepts(
    sent: list[tuple[int, dict[str, int], str]], cuts: tuple[int, ...]
) -> None:
    frames = [
        beat(
            sender(place["sysid"]) if kind == "plain" else signer(stamp * 1_000_000, **place),
            seq=i,
            v1=kind == "v1",
        )
        for i, (stamp, place, kind) in enumerate(sent)
    ]
    found, decoder = decoded(frames, cuts=cuts)
    assert found == accepted_by_pymavlink(frames)
    assert decoder.link.unsigned_rejected == len(frames) - len(found)


PHRASE = "Überschall am Morgen".encode()
FILES = {
    "raw": (KEY, KEY),
    "raw that ends like a line": (KEY[:31] + b"\n", KEY[:31] + b"\n"),
    "hex": (KEY.hex().encode(), KEY),
    "hex as a line": (KEY.hex().upper().encode() + b"\r\n", KEY),
    "passphrase": (PHRASE, hashlib.sha256(PHRASE).digest()),
    "passphrase as a line": (PHRASE + b"\n", hashlib.sha256(PHRASE).digest()),
}
SECRET = b"open sesame"
NO_KEYS = {
    "empty": b"",
    "a line end": b"\r\n",
    "two lines": SECRET + b"\n" + SECRET + b"\n",
    "binary": SECRET + b"\xff\xfe" * 20,
    "zeros": SECRET + bytes(5),
    "long": SECRET * 1000,
}


@pytest.mark.parametrize("name", FILES)
def test_a_key_file_holds_bytes_or_hex_digits_or_a_passphrase(name: str, tmp_path: Path) -> None:
    content, key = FILES[name]
    (tmp_path / "key").write_bytes(content)
    frames = [beat(signer(1 + i, key=key), seq=i) for i in range(3)]
    assert decoded(frames, SigningKey.from_file(tmp_path / "key"))[0] == [0, 1, 2]


@pytest.mark.parametrize("name", NO_KEYS)
def test_a_file_that_holds_no_key_is_refused_without_a_word_of_it(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / "key").write_bytes(NO_KEYS[name])
    with pytest.raises(ConfigError, match="must hold 32 bytes, 64 hex digits or one line") as info:
        SigningKey.from_file(tmp_path / "key")
    assert SECRET.decode() not in "".join(traceback.format_exception(info.value))
    assert info.value.__cause__ is None
    for path in (tmp_path / "none", tmp_path):
        with pytest.raises(ConfigError, match=f"signing key file {path}"):
            SigningKey.from_file(path)


def test_a_key_shows_itself_nowhere(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    key = SigningKey(KEY)
    _, decoder = decoded([beat(signer(1)), beat(sender(), seq=1)], key)
    shown = [f"{thing!r} {thing!s}" for thing in (key, decoder, decoder.link)]
    shown += [caplog.text, repr([vars(decoder), [getattr(key, name) for name in key.__slots__]])]
    for secret in (KEY.hex(), repr(KEY)):
        assert secret not in "".join(shown)
    with pytest.raises(ConfigError, match="32 bytes, not 3"):
        SigningKey(b"abc")
