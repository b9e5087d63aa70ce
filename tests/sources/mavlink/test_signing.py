"""Signing against pymavlink's own: what counts, also in sessions; the key never shows."""

from __future__ import annotations

import contextlib
import hashlib
import json
import traceback
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flightlog import fly
from flights.surgery import Encoder, edited, join, split
from hypothesis import given
from hypothesis import strategies as st
from live_link import listening
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sources.tlog_records import BY_NAME, START_US, message, orders, pack, record, run, sender
from sources.tlog_records import KEY as OWN

from yawid.cli.main import main
from yawid.errors import ConfigError
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.signing import Check, Signing, SigningKey

OURS = SigningKey(OWN)


def signer(
    stamp: int, *, link_id: int = 3, sysid: int = 1, compid: int = 1, key: bytes = OWN
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
    link.signing.secret_key = OWN
    link.signing.timestamp = 0
    accepted = []
    for i, frame in enumerate(frames):
        with contextlib.suppress(dialect.MAVError):
            link.decode(bytearray(frame))
            accepted.append(i)
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
    "raw": (OWN, OWN),
    "raw that ends like a line": (OWN[:31] + b"\n", OWN[:31] + b"\n"),
    "hex": (OWN.hex().encode(), OWN),
    "hex as a line": (OWN.hex().upper().encode() + b"\r\n", OWN),
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
    "a folder": None,
    "missing": None,
}


@pytest.mark.parametrize("name", FILES)
def test_a_key_file_holds_bytes_or_hex_digits_or_a_passphrase(name: str, tmp_path: Path) -> None:
    content, key = FILES[name]
    (tmp_path / "key").write_bytes(content)
    frames = [beat(signer(1 + i, key=key), seq=i) for i in range(3)]
    assert decoded(frames, SigningKey.from_file(tmp_path / "key"))[0] == [0, 1, 2]


@pytest.mark.parametrize("name", NO_KEYS)
def test_a_file_that_holds_no_key_is_one_line_without_a_word_of_it_and_exit_code_2(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, path = NO_KEYS[name], tmp_path if name == "a folder" else tmp_path / "key"
    said = f"signing key file {path}:"
    if content is not None:
        path.write_bytes(content)
        said += " must hold 32 bytes, 64 hex digits or one line"
    with pytest.raises(ConfigError, match=said) as info:
        SigningKey.from_file(path)
    assert SECRET.decode() not in "".join(traceback.format_exception(info.value))
    assert content is None or info.value.__cause__ is None
    for command in (["replay", "x.tlog"], ["live", "udpin:127.0.0.1:14999"]):
        assert main([*command, "--signing-key-file", str(path)]) == 2
        [line] = capsys.readouterr().err.splitlines()
        assert said in line
        assert SECRET.decode() not in line


def test_a_key_shows_itself_nowhere() -> None:
    key = SigningKey(OWN)
    _, decoder = decoded([beat(signer(1)), beat(sender(), seq=1)], key)
    shown = f"{key!r} {key} {vars(decoder)} {[getattr(key, name) for name in key.__slots__]}"
    assert not any(secret in shown for secret in (OWN.hex(), repr(OWN)))
    with pytest.raises(ConfigError, match="32 bytes, not 3"):
        SigningKey(b"abc")


PASSPHRASE = "correct horse battery staple"
KEY, WRONG = hashlib.sha256(PASSPHRASE.encode()).digest(), bytes(32)
STICKS = 1500 + 150 * np.random.default_rng(1).choice([-1, 1], 80)
RECORDS = split(
    fly(
        lambda t: 0.4 * np.sin(2.0 * t) * np.cos(0.7 * t),
        lambda t: int(STICKS[int(4 * t)]),
        20.0,
        attitude_s=0.05,
        servo_s=0.05,
    ).data
)
SIGNED = edited(RECORDS, key=KEY)


def intruders() -> list[tuple[int, bytes]]:
    """Return unsigned records of the same vehicle that have another rudder."""
    encoder, forged = Encoder(), []
    for i, (stamp, _) in enumerate(SIGNED[5::7]):
        us = round(1e6 * (10.0 + 0.1 * i))
        servos = dialect.MAVLink_servo_output_raw_message(us, 0, *[1900] * 8)
        forged.append((stamp, encoder.frame(servos)))
    return forged


def replayed(
    log: Path, records: list[tuple[int, bytes]], capsys: Any, *options: str
) -> tuple[int, dict[str, Any], str]:
    """Return the exit code of a replay, its summary, and what it wrote to both streams."""
    log.write_bytes(join(records))
    out = str(log.parent / "out")
    code = main(["replay", str(log), "--out", out, "--force", "--json", *options])
    said = capsys.readouterr()
    return code, json.loads(said.out), said.err


def test_with_a_key_forged_frames_change_nothing_and_the_key_is_in_no_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "key").write_text(PASSPHRASE + "\n", encoding="utf-8")
    plain, mixed = intruders(), list(SIGNED)
    forged = [*plain, *edited(plain, key=WRONG), *SIGNED[:40]]
    for i, rec in enumerate(forged):
        mixed.insert(5 + 3 * i, rec)
    options = ["--manoeuvres", "off", "--ordinary", "off"]

    code, clean, _ = replayed(tmp_path / "log.tlog", SIGNED, capsys, *options)
    options += ["--rerun", "save", "--signing-key-file", str(tmp_path / "key")]
    again, summary, err = replayed(tmp_path / "log.tlog", mixed, capsys, *options)

    assert again == code
    assert summary["estimates"] == clean["estimates"]
    assert summary["estimates"]["els"]["updates"] > 100
    assert summary["link"]["unsigned_rejected"] == len(forged) > 200
    assert clean["link"]["unsigned_rejected"] == 0
    written = [path.read_bytes() for path in (tmp_path / "out").iterdir()]
    assert len(written) == 2
    for content in [*written, json.dumps(summary).encode(), err.encode()]:
        for secret in (KEY, KEY.hex().encode(), PASSPHRASE.encode()):
            assert secret not in content


@pytest.mark.parametrize(
    ("records", "key", "code", "rejected", "said"),
    [
        (SIGNED, None, 5, 0, "signatures were not checked"),
        (SIGNED, KEY, 5, 0, ""),
        (RECORDS, None, 5, 0, ""),
        (SIGNED, WRONG, 3, len(SIGNED), ""),
    ],
)
def test_frames_count_by_the_key_and_that_signatures_were_not_checked_is_said(
    records: list[tuple[int, bytes]],
    key: bytes | None,
    code: int,
    rejected: int,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "key").write_bytes(key or b"")
    options = [] if key is None else ["--signing-key-file", str(tmp_path / "key")]
    options += ["--manoeuvres", "off"]
    found, summary, err = replayed(tmp_path / "log.tlog", records, capsys, *options)
    assert (found == 3) == (code == 3)
    assert summary["link"]["unsigned_rejected"] == rejected
    assert (said in err) if said else "signed" not in err
    main(["inspect", str(tmp_path / "log.tlog"), *options])
    page = capsys.readouterr().out
    assert ("signatures were not checked" in page) == bool(said)


def test_a_live_session_without_a_key_says_one_time_that_frames_are_signed(tmp_path: Path) -> None:
    with listening(tmp_path) as session:
        session.fly([frame for _, frame in SIGNED[:100]])

    (event,) = [
        e for e in session.ended[0].summary.to_json()["live"]["events"] if "signatures" in e
    ]
    assert "--signing-key-file" in event
