"""Signing and raw logs through the command line: what counts, and where no key may be found."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks.children import child
from flightlog import fly
from flights.surgery import join, split
from pymavlink.dialects.v20 import ardupilotmega as dialect

from yawid.cli.main import main

PASSPHRASE = "correct horse battery staple"
KEY = hashlib.sha256(PASSPHRASE.encode()).digest()


def flight() -> list[bytes]:
    """Return the unsigned records of a flight of 20 s."""
    rng = np.random.default_rng(1)
    sticks = 1500 + 150 * rng.choice([-1, 1], 80)
    data = fly(
        lambda t: 0.4 * np.sin(2.0 * t) * np.cos(0.7 * t),
        lambda t: int(sticks[int(4 * t)]),
        20.0,
        attitude_s=0.05,
        servo_s=0.05,
    ).data
    return [join([each]) for each in split(data)]


def signed(record: bytes, link: Any) -> bytes:
    """Return the record with its frame signed by pymavlink."""
    msg = dialect.MAVLink(None).decode(bytearray(record[8:]))
    link.seq = msg.get_seq()
    frame: bytes = msg.pack(link)
    return record[:8] + frame


def signer(key: bytes = KEY) -> Any:
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.timestamp = key, 5
    link.signing.sign_outgoing = True
    return link


@pytest.fixture(scope="module")
def records() -> list[bytes]:
    return flight()


@pytest.fixture(scope="module")
def signed_records(records: list[bytes]) -> list[bytes]:
    link = signer()
    return [signed(rec, link) for rec in records]


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "key.txt"
    path.write_text(PASSPHRASE + "\n", encoding="utf-8")
    return path


def intruders(records: list[bytes]) -> list[bytes]:
    """Return unsigned frames of the same vehicle that tell another rudder."""
    attitude = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    forged = []
    for i, rec in enumerate(records[5::7]):
        attitude.seq = (3 * i) % 256
        servos = dialect.MAVLink_servo_output_raw_message(
            round(1e6 * (10.0 + 0.1 * i)), 0, *[1900] * 8
        )
        forged.append(rec[:8] + servos.pack(attitude))
    return forged


def summary_of(out: str) -> dict[str, Any]:
    summary: dict[str, Any] = json.loads(out)
    return summary


def test_with_a_key_forged_frames_change_nothing_and_the_key_is_in_no_output(
    signed_records: list[bytes],
    key_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    forged = intruders(signed_records)
    mixed = list(signed_records)
    for i, rec in enumerate(forged):
        mixed.insert(5 + 8 * i, rec)
    (tmp_path / "clean.tlog").write_bytes(b"".join(signed_records))
    (tmp_path / "mixed.tlog").write_bytes(b"".join(mixed))
    out = tmp_path / "out"
    code = main(["replay", str(tmp_path / "clean.tlog"), "--out", str(out), "--json"])
    clean = summary_of(capsys.readouterr().out)
    arguments = ["--out", str(out), "--json", "--rerun", "save", "--signing-key-file"]

    again = main(["replay", str(tmp_path / "mixed.tlog"), *arguments, str(key_file)])

    said = capsys.readouterr()
    summary = summary_of(said.out)
    assert again == code
    assert summary["estimates"] == clean["estimates"]
    assert summary["estimates"]["els"]["updates"] > 100
    assert summary["link"]["unsigned_rejected"] == len(forged) > 50
    assert clean["link"]["unsigned_rejected"] == 0
    written = [path.read_bytes() for path in out.iterdir()]
    assert len(written) == 3
    for content in [*written, said.out.encode(), said.err.encode()]:
        for secret in (KEY, KEY.hex().encode(), PASSPHRASE.encode()):
            assert secret not in content


def test_without_a_key_signed_frames_are_read_and_that_nobody_checked_them_is_said(
    signed_records: list[bytes],
    records: list[bytes],
    key_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = tmp_path / "log.tlog"
    arguments = [str(log), "--out", str(tmp_path / "out"), "--force", "--json"]
    said = {}
    for name, recs, options in (
        ("signed", signed_records, []),
        ("checked", signed_records, ["--signing-key-file", str(key_file)]),
        ("plain", records, []),
    ):
        log.write_bytes(b"".join(recs))
        main(["replay", *arguments, *options])
        heard = capsys.readouterr()
        assert summary_of(heard.out)["estimates"]["els"]["updates"] > 100
        said[name] = heard.err

    assert "signatures were not checked" in said["signed"]
    assert said["signed"].count("\n") == 1
    assert "signed" not in said["checked"] + said["plain"]

    log.write_bytes(b"".join(signed_records))
    main(["inspect", str(log), "--json"])
    report = summary_of(capsys.readouterr().out)
    assert report["link"]["signed"] == len(signed_records)
    main(["inspect", str(log)])
    assert "signatures were not checked" in capsys.readouterr().out


def test_a_live_session_without_a_key_says_one_time_that_frames_are_signed(
    signed_records: list[bytes], tmp_path: Path
) -> None:
    frames = [rec[8:] for rec in signed_records[:100]]
    size = sum(8 + len(frame) for frame in frames)

    said = heard_live(frames, ["--json", "--out", str(tmp_path)], tmp_path, size)

    events = [e for e in summary_of(said)["live"]["events"] if "signatures" in e]
    assert len(events) == 1
    assert "--signing-key-file" in events[0]


def test_the_wrong_key_leaves_no_vehicle_and_counts_every_frame(
    signed_records: list[bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "log.tlog").write_bytes(b"".join(signed_records))
    (tmp_path / "key").write_bytes(bytes(32))
    arguments = ["--out", str(tmp_path / "out"), "--signing-key-file", str(tmp_path / "key")]

    code = main(["replay", str(tmp_path / "log.tlog"), *arguments, "--json"])

    summary = summary_of(capsys.readouterr().out)
    assert code == 3
    assert summary["link"]["unsigned_rejected"] == len(signed_records)


def test_a_key_file_that_cannot_be_used_is_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "key").write_text("two\nlines\n", encoding="utf-8")
    for command in (["replay", "x.tlog"], ["live", "udpin:127.0.0.1:14999"]):
        for path in (tmp_path / "key", tmp_path / "none"):
            assert main([*command, "--signing-key-file", str(path)]) == 2
            said = capsys.readouterr().err
            assert said.count("\n") == 1
            assert str(path) in said
            assert "two" not in said


def heard_live(frames: list[bytes], arguments: list[str], folder: Path, size: int) -> str:
    """Send datagrams to a live session until its log has grown to a size; return its stdout."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with child(
        [sys.executable, "-m", "yawid", "live", f"udpin:127.0.0.1:{port}", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as process:
        for line in process.stderr:
            if "listening" in line:
                break
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for frame in frames:
                out.sendto(frame, ("127.0.0.1", port))
        for _ in range(300):
            if sum(path.stat().st_size for path in folder.glob("*.tlog.part")) >= size:
                break
            threading.Event().wait(0.05)
        process.send_signal(signal.SIGTERM)
        said: str = process.communicate(timeout=60)[0]
    return said


def test_a_live_session_with_a_key_replays_to_the_same_bits(
    signed_records: list[bytes],
    key_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    frames = [rec[8:] for rec in signed_records[:500]]
    plain = [rec[8:] for rec in intruders(signed_records)[:7]]
    stranger = signer(bytes(32))
    wrong = [signed(rec, stranger)[8:] for rec in intruders(signed_records)[7:14]]
    replayed = frames[:6]
    forged = [*replayed, *plain, *wrong]
    mixed = [f + forged[i // 25] if i % 25 == 24 else f for i, f in enumerate(frames)]
    size = sum(8 + len(frame) for frame in frames + forged)
    arguments = ["--rate", "10", "--json", "--signing-key-file", str(key_file)]

    said = heard_live(mixed, [*arguments, "--out", str(tmp_path / "a")], tmp_path / "a", size)
    (log,) = (tmp_path / "a").glob("*.tlog")
    main(["replay", str(log), *arguments, "--out", str(tmp_path / "b")])

    summary, again = summary_of(said), summary_of(capsys.readouterr().out)
    assert summary["link"] == again["link"]
    assert summary["link"]["unsigned_rejected"] == 20
    assert summary["link"]["frames"] == 520
    assert summary["estimates"] == again["estimates"]
    assert KEY not in log.read_bytes()
