"""Windows and macOS as yawid's files see them (support/other_system.py): the answers are the same.

This is no run on these systems: what Python and the libraries do there is not tested.
"""

from __future__ import annotations

import ast
import json
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import other_system
import pyarrow.parquet as pq
import pytest
from checks.children import child
from fleet_cluster import make_logs
from live_link import frames
from places import ROOT

FOREIGN = ("darwin", "win32")
LOG, FLEET = "logs/00.tlog", ("fleet", "logs", "--out", "out/data", "--workers", "1")
RUNS = f"""
import contextlib, io, json, sys
from yawid.cli.main import main
for words in (
    ("replay", "{LOG}", "--out", "out", "--rerun", "save", "--json"),
    ("replay", "logs/nothing.tlog"), {FLEET}, {FLEET},
):
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = main(words)
    answer = json.loads(said.getvalue()) if "--json" in words else None
    print(json.dumps([code, answer]))
"""
LIVE = "import sys; from yawid.cli.main import main; sys.exit(main(sys.argv[1:]))"
PAGES = f"""
import pathlib, sys, yawid
from yawid.cli.main import main
pages = [["replay", "{LOG}"], ["inspect", "{LOG}"], ["inspect", "--card", "{LOG}"], ["explain"]]
manual = pathlib.Path(yawid.__file__).parent / "manual"
sys.exit(max(*map(main, pages), *(bool(print(p.read_text("utf-8"))) for p in manual.glob("*.md"))))
"""
KEPT = """
from yawid.estimation.machine import kept
code = bytes(range(256))
print(kept.keep("code", code), kept.find("code") == code)
print(kept.passed_by())
"""


def started(
    platform: str, folder: Path, *command: str, encoding: str = "utf-8", **more: str
) -> AbstractContextManager[subprocess.Popen[str]]:
    environment = other_system.environment(folder / "hook", platform)
    environment |= {"NUMBA_DISABLE_JIT": "1", "HOME": str(folder), "XDG_CACHE_HOME": ""} | more
    return child(
        [sys.executable, *command], env=environment, cwd=folder, encoding=encoding,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def ended(run: AbstractContextManager[subprocess.Popen[str]]) -> str:
    with run as process:
        said, errors = process.communicate(timeout=300)
    assert "Traceback" not in errors, errors
    assert process.returncode == 0, errors
    return str(said)


@pytest.mark.long  # three processes that interpret what others run compiled
def test_a_replay_and_a_fleet_give_the_same_answers_and_files_on_each_system(tmp_path: Path):
    make_logs(tmp_path / "logs", 2)
    found: dict[str, Any] = {}
    for platform in ("linux", *FOREIGN):
        folder = tmp_path / platform
        folder.mkdir()
        (folder / "logs").symlink_to(tmp_path / "logs")
        said = ended(started(platform, folder, "-c", RUNS)).replace(str(folder), "")
        answers = [json.loads(line) for line in said.splitlines()]
        outcomes = pq.read_table(folder / "out/data/logs.parquet")["outcome"].to_pylist()
        names = {path.relative_to(folder).as_posix() for path in folder.rglob("out/**/*")}
        found[platform] = answers, outcomes, names

    answers, outcomes, names = found["linux"]
    assert [code for code, _ in answers] == [answers[0][0], 6, 0, 0]
    assert len(outcomes) == 2
    assert {"out/00.mcap", "out/00.rrd", "out/data/logs.parquet"} <= names
    assert found["darwin"] == found["win32"] == found["linux"]


@pytest.mark.slow
@pytest.mark.parametrize("platform", [pytest.param("darwin", marks=pytest.mark.long), "win32"])
def test_a_live_session_takes_datagrams_on_each_system(platform: str, tmp_path: Path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        address = f"udpout:127.0.0.1:{vehicle.getsockname()[1]}"
        words = ("live", address, "--seconds", "3", "--json", "--request-rates", "--out", "out")
        with started(platform, tmp_path, "-c", LIVE, *words) as run:
            vehicle.settimeout(60)
            _, asker = vehicle.recvfrom(2000)
            sent = frames(1.0)
            for frame in sent:
                vehicle.sendto(frame, asker)
            said, errors = run.communicate(timeout=60)

    assert "Traceback" not in errors
    summary = json.loads(said)
    assert summary["link"]["frames"] == len(sent)
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".tlog", ".mcap"}


def test_compiled_code_is_kept_in_the_users_folder_and_locked_on_windows(tmp_path: Path):
    home, other = tmp_path / "home", tmp_path / "other"
    home.mkdir()
    mine = ended(started("win32", home, "-c", KEPT, NUMBA_CACHE_DIR=str(home / "mine")))
    assert mine.splitlines() == [f"{home / 'mine'} True", "None"]
    others = ended(started("win32", home, "-c", KEPT, NUMBA_CACHE_DIR=str(other))).splitlines()
    assert others[0] == f"{home / '.cache' / 'yawid'} True"
    assert others[1] == f"NUMBA_CACHE_DIR is not used: {other} is not in your own folder {home}"
    assert not other.exists()


def test_a_console_of_cp1252_shows_every_page(tmp_path: Path):
    """The code page has ± and no zeta, box or arrow; what it lacks must not end the command."""
    make_logs(tmp_path / "logs", 1)
    run = started("win32", tmp_path, "-c", PAGES, PYTHONIOENCODING="cp1252", encoding="cp1252")
    said = ended(run)

    assert "\u00b1" in said


MODE = {"open": 0, "fdopen": 1, "read_text": -1, "write_text": -1}
"""The position of the mode among the arguments of a method; -1: it always opens a text."""
MAYBE = re.compile(r"(?:open|read_text|write_text)\((?!.*\bencoding=)")
"""A line that may open a text without its encoding: only the files that have one are parsed."""


BINARY = {"StoredPath(path).open()", "StoredPath(log.path).open()", "self.open()"}
"""Calls of a store's own method, which opens bytes."""


def without_encoding(source: str) -> Iterator[str]:
    """Name every call of a method that opens a text and leaves its encoding to the system."""
    for call in ast.walk(ast.parse(source)) if MAYBE.search(source) else ():
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)):
            continue
        place = MODE.get(call.func.attr)
        if place is None or {"encoding", "fileobj", None} & {each.arg for each in call.keywords}:
            continue
        modes = [each.value for each in call.keywords if each.arg == "mode"] + call.args[place:]
        mode = getattr(modes[0], "value", None) if modes and place >= 0 else "r"
        if isinstance(mode, str) and set(mode) <= set("rwxa+t"):
            yield ast.unparse(call)


@pytest.mark.parametrize("folder", ["src", "tests", "tools"])
def test_every_text_is_opened_with_its_encoding(folder: str) -> None:
    found = {
        (path.relative_to(ROOT).as_posix(), call)
        for path in (ROOT / folder).rglob("*.py")
        for call in without_encoding(path.read_text(encoding="utf-8"))
        if call not in BINARY
    }
    assert found == set()


@pytest.mark.parametrize(
    "line",
    [
        "page.read_text()",
        "page.write_text(text)",
        "page.open('a')",
        "page.open()",
        "os.fdopen(0, mode='w')",
    ],
)
def test_a_text_without_its_encoding_is_found(line: str) -> None:
    assert [*without_encoding(line)]
    assert not [*without_encoding(line[:-1] + ", encoding='utf-8')".replace("(, ", "("))]
    assert not [*without_encoding("page.open('ab')")]
