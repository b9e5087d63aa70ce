"""Signing through the command line: what counts, and where no key may be found."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flightlog import finished, fly
from flights.surgery import join, rewrite, split
from live_link import listening
from pymavlink.dialects.v20 import ardupilotmega as dialect

from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions

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
SIGNED = rewrite(RECORDS, key=KEY)


def intruders() -> list[tuple[int, bytes]]:
    """Return unsigned records of the same vehicle that have another rudder."""
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    forged = []
    for i, (stamp, _) in enumerate(SIGNED[5::7]):
        link.seq = (3 * i) % 256
        us = round(1e6 * (10.0 + 0.1 * i))
        servos = dialect.MAVLink_servo_output_raw_message(us, 0, *[1900] * 8)
        forged.append((stamp, bytes(servos.pack(link))))
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
    forged = [*plain, *rewrite(plain, key=WRONG), *SIGNED[:40]]
    for i, rec in enumerate(forged):
        mixed.insert(5 + 3 * i, rec)
    options = ["--rerun", "save", "--signing-key-file", str(tmp_path / "key")]

    code, clean, _ = replayed(tmp_path / "log.tlog", SIGNED, capsys)
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


@pytest.mark.parametrize("content", ["two\nlines\n", None])
def test_a_key_file_that_cannot_be_used_is_one_line_and_exit_code_2(
    content: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if content is not None:
        (tmp_path / "key").write_text(content, encoding="utf-8")
    for command in (["replay", "x.tlog"], ["live", "udpin:127.0.0.1:14999"]):
        assert main([*command, "--signing-key-file", str(tmp_path / "key")]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert str(tmp_path / "key") in said
        assert "two" not in said


def test_a_live_session_with_a_key_replays_to_the_same_bits(tmp_path: Path) -> None:
    frames = [frame for _, frame in SIGNED[:500]]
    plain = intruders()
    wrong = rewrite(plain[7:14], key=WRONG)
    forged = [*frames[:6], *(frame for _, frame in (*plain[:7], *wrong))]
    mixed = [[f, forged[i // 25]] if i % 25 == 24 else [f] for i, f in enumerate(frames)]
    options = ReadOptions(SigningKey(KEY))
    with listening(tmp_path, RunConfig(rate=10.0), read_options=options) as session:
        session.fly([frame for each in mixed for frame in each])

    log = (tmp_path / "live.tlog").read_bytes()
    live = session.ended[0].summary.to_json()
    again = finished(log, session.config, options=options).to_json()
    assert live["link"] == again["link"]
    assert live["link"]["unsigned_rejected"] == 20
    assert live["link"]["frames"] == 520
    assert live["estimates"] == again["estimates"]
    assert KEY not in log


def test_a_live_session_without_a_key_says_one_time_that_frames_are_signed(tmp_path: Path) -> None:
    with listening(tmp_path) as session:
        session.fly([frame for _, frame in SIGNED[:100]])

    (event,) = [
        e for e in session.ended[0].summary.to_json()["live"]["events"] if "signatures" in e
    ]
    assert "--signing-key-file" in event
