"""Nothing that anybody wrote into a log, a name or a run is a command to the terminal.

Escape sequences, BEL, C1 controls, ends of lines and overrides of the reading direction go through
every source and every command; then every byte on stdout and stderr is looked at.
"""

from __future__ import annotations

import json
import os
import re
import sys
import threading
import unicodedata
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from checks.children import free_udp_port
from checks.judge_trend import START_US, flight
from finished_runs import replayed
from fleets import write_fleet
from forged_runs import forge
from hostile import hostile_log, parameter
from live_link import frames, send
from places import SRC
from sources.logs import dataflash_flight, ulog_flight

from yawid.cli.main import main
from yawid.sinks.door import plain
from yawid.trend.days import DAY_US

BAD = "\x1b[2J\x1b]0;own\x07\x9b31m\x7f\x85\u2028\u202e\u2066\u200f[red]x:boom:\r\nFORGED usable"
NAME = f"a{BAD}{os.fsdecode(bytes([0x9B, 0x41]))}"
"""... a file's, which may hold a byte of C1 that is no text."""
TURNS = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI", "R", "AL"}


def commands_in(written: bytes) -> set[str]:
    """Return every character of an output that does more than to be seen, by Unicode's tables."""
    text = written.decode("utf-8", "surrogateescape")
    return {
        ascii(c)
        for c in text
        if (unicodedata.category(c) in ("Cc", "Zl", "Zp") and c != "\n")
        or (unicodedata.category(c) == "Cf" and unicodedata.bidirectional(c) in TURNS)
        or "\udc80" <= c <= "\udc9f"
    }


def assert_shown_only(written: bytes) -> None:
    assert commands_in(written) == set(), written
    assert not re.search(rb"^\s*FORGED", written, re.MULTILINE), written


def poisoned(value: Any) -> Any:
    """Return a summary in which every text that is no word of yawid's own ends in ``BAD``."""
    if isinstance(value, dict):
        return {key: poisoned(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [poisoned(entry) for entry in value]
    is_word = isinstance(value, str) and re.fullmatch(r"[a-z_]+", value)
    return value if is_word or not isinstance(value, str) else value + BAD


def record(path: Path, columns: dict[str, Any]) -> None:
    pq.write_table(pa.table({name: pa.array(values) for name, values in columns.items()}), path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of each source, hostile in its name and wherever it may hold a text."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / f"{NAME}.tlog").write_bytes(hostile_log() + parameter(BAD.encode()[:16]))
    (folder / f"{NAME}.ulg").write_bytes(
        ulog_flight.logged(ulog_flight.flight(), **{BAD: 1.0}).data
    )
    onboard = dataflash_flight.with_imu()
    onboard.add("PARM", 10**7, BAD.encode()[:16].decode("latin-1"), 1.0, 0)
    (folder / f"{NAME}.bin").write_bytes(onboard.data)
    t = np.arange(0.0, 30.0, 0.05)
    moves = {"t": t, f"rud{BAD}": 0.1 * np.sin(3 * t), f"r{BAD}": 0.1 * np.cos(3 * t)}
    record(folder / "a.parquet", moves | {"mode": [f"AUTO{BAD}"] * len(t), BAD: t})
    record(folder / "held.parquet", moves | {"held": [BAD] * len(t)})
    rows = "".join(f"{k / 20},{np.sin(k)},{np.cos(k)},AUTO{BAD[:-14]}\n" for k in range(9000))
    (folder / "a.csv").write_text(f"t,rud\x9b\u202e,r\x9b\u202e,mode\n{rows}", encoding="utf-8")
    (folder / "cell.csv").write_text(
        f"t,rudder_deg,r_deg_s\n0,1,\x9b31m\u202e\n{rows[:500]}", encoding="utf-8"
    )
    (folder / "bad.toml").write_text(json.dumps(BAD) + " = 3\n", encoding="utf-8")
    (folder / "bad2.toml").write_text(
        "rudder = " + json.dumps(BAD.replace("\x7f", "")) + "\n", encoding="utf-8"
    )
    (folder / "noise.tlog").write_bytes(BAD.encode())
    run = replayed(folder / f"{NAME}.tlog", folder, "--rate", 10)
    run.rename(folder / f"{NAME}.mcap")
    forge(folder / f"{NAME}.mcap", folder / "forged.mcap", summary=poisoned)
    vehicle = [flight(1, i, START_US + i * 7 * DAY_US, zeta=0.15, zeta_std=0.01) for i in range(9)]
    (folder / f"set{BAD}").mkdir()
    write_fleet(folder / f"set{BAD}", [each | {"vehicle": f"sn:{BAD}"} for each in vehicle])
    return folder


NAMED = ["--columns", f"rudder=rud{BAD},r=r{BAD}", "--rudder-unit", "rad", "--units", "rad"]
NAMED += ["--rudder-sign", "nose-right"]
IN_CSV = [*NAMED[:1], "rudder=rud\x9b\u202e,r=r\x9b\u202e", *NAMED[2:]]
COMMANDS: dict[str, list[str]] = {
    "replay of a tlog": ["replay", f"{NAME}.tlog", "--rate", "10"],
    "replay as JSON": ["replay", f"{NAME}.tlog", "--rate", "10", "--json"],
    "replay of a ULog": ["replay", f"{NAME}.ulg", "--manoeuvres", "off"],
    "replay of dataflash": ["replay", f"{NAME}.bin", "--manoeuvres", "off"],
    "replay of Parquet": ["replay", "a.parquet", *NAMED],
    "replay of CSV": ["replay", "a.csv", *IN_CSV],
    "replay of a run": ["replay", "forged.mcap"],
    "replay of nothing": ["replay", f"none{BAD}"],
    "replay of noise": ["replay", "noise.tlog"],
    "columns that are not said": ["replay", "a.parquet"],
    "columns of a CSV that are not said": ["replay", "a.csv"],
    "a reason that is none": ["replay", "held.parquet", *NAMED],
    "a cell that is no number": ["replay", "cell.csv", *NAMED[-2:]],
    "inspect": ["inspect", f"{NAME}.tlog"],
    "inspect of Parquet": ["inspect", "a.parquet", *NAMED],
    "inspect as JSON": ["inspect", "a.parquet", *NAMED, "--json"],
    "a card": ["inspect", f"{NAME}.tlog", "--card"],
    "orders": ["orders", "a.parquet", *NAMED],
    "view": ["view", f"{NAME}.mcap", "--out", f"OUT/{BAD}.rrd"],
    "report": ["report", f"{NAME}.mcap", "-o", f"OUT/{BAD}.html"],
    "report of a forged run": ["report", "forged.mcap", "-o", "OUT/r.html"],
    "export": ["export", "forged.mcap", "-o", f"OUT/{BAD}.csv"],
    "diff": ["diff", "forged.mcap", f"{NAME}.mcap"],
    "diff with a data set": ["diff", "forged.mcap", f"set{BAD}"],
    "trend": ["trend", f"set{BAD}"],
    "trend as JSON": ["trend", f"set{BAD}", "--json"],
    "trend of a vehicle that is not there": ["trend", f"set{BAD}", "--vehicle", BAD],
    "fleet": ["fleet", f"{NAME}.tlog", "--out", "OUT/set", "--dry-run"],
    "fleet of nothing": ["fleet", f"none{BAD}", "--out", "OUT/set", "--dry-run"],
    "step": ["step", "cell.csv"],
    "simulate": ["simulate", "yaw", "--seconds", "5", "--out", f"OUT/{BAD}.csv"],
    "live": ["live", f"udpin:{BAD}:1"],
    "a setting nobody knows": ["replay", f"{NAME}.tlog", "--config", "bad.toml"],
    "a setting of no sense": ["replay", f"{NAME}.tlog", "--config", "bad2.toml"],
    "an option nobody knows": ["replay", f"{NAME}.tlog", f"--{BAD}"],
    "a command nobody knows": [BAD],
}


LONG = {"report", "report of a forged run", "view", "orders", "fleet",
        "replay of a ULog", "replay of dataflash", "a card", "diff with a data set"}  # fmt: skip
"""Whose way to the terminal another one in the gate goes, too."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] if n in LONG else []) for n in COMMANDS]
)
def test_no_text_from_outside_is_a_command_to_the_terminal(
    folder: Path,
    tmp_path: Path,
    name: str,
    capfdbinary: pytest.CaptureFixture[bytes],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(folder)
    argv = [each.replace("OUT/", f"{tmp_path}/") for each in COMMANDS[name]]
    if argv[0] == "replay":
        argv += ["--out", str(tmp_path)]
    try:
        main(argv)
    except SystemExit as ended:
        assert ended.code == 2  # only a wrong command line ends that way
    written = capfdbinary.readouterr()

    assert_shown_only(written.out)
    assert_shown_only(written.err)
    assert written.out + written.err
    assert b"Traceback" not in written.err


def test_no_frame_of_a_link_is_a_command_to_the_terminal(
    tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    port = free_udp_port()
    argv = [f"udpin:127.0.0.1:{port}", "--seconds", "2", "--out", str(tmp_path)]
    hostile = [parameter(BAD.encode()[k : k + 16]) for k in range(0, 40, 8)]
    sender = threading.Timer(0.7, send, ([*hostile, *frames(12.0)], port))
    sender.start()
    main(["live", *argv, "--manoeuvres", "off", "--rate", "10"])
    sender.join(60.0)
    written = capfdbinary.readouterr()

    assert b"verdict" in written.out
    assert_shown_only(written.out)
    assert_shown_only(written.err)


def test_on_a_terminal_there_are_yawid_s_own_colours_and_nothing_else(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Colours are ``ESC [ numbers m``; the one asked for by a flight mode is shown as text."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    main(["inspect", "a.parquet", *NAMED])
    written = capsys.readouterr().out.encode("utf-8", "surrogateescape")
    own = re.sub(rb"\x1b\[[0-9;]*m", b"", written)

    assert len(own) < len(written)
    assert b"\\x1b[2J" in own
    assert_shown_only(own)


def test_what_is_text_stays_text() -> None:
    for text in ("wn 2.05 ± .04 rad/s", "größe", "Ωω²", "Персона", "日本", "a\\b", "caf\udce9"):
        assert plain(text) == text
    assert plain("a\tb\x1b\x9b\u202e\udc9b\U000e0041") == r"a\tb\x1b\x9b\u202e\x9b\ue0041"


def test_nothing_is_written_past_the_door() -> None:
    """Prints are found by ruff's T20; here writes, and consoles of rich that take [red]."""
    for path in SRC.rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        if path != SRC / "sinks" / "door.py":
            assert not re.search(r"sys\.std(out|err)\.write", source), path
        for made in re.finditer(r"\bConsole\(\s*(file|force_terminal)=", source):
            assert "markup=False" in source[made.end() : made.end() + 300], path
