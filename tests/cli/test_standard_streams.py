"""Stdout and stderr full, closed, a pipe without a reader, ASCII only: one line, exit code 6."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from finished_runs import replayed
from hostile import FLIGHT
from places import REPLAY_LOGS

FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short flight, its run, a case and a step response."""
    folder = tmp_path_factory.mktemp("streams")
    (folder / "a.tlog").write_bytes(FLIGHT)
    replayed(folder / "a.tlog", folder, "--rate", 10)
    shutil.copytree(REPLAY_LOGS / "no_rudder", folder / "no_rudder")
    rows = [f"{t},{1.0 - math.exp(-t / 5.0)}" for t in range(40)]
    (folder / "step.csv").write_text("\n".join(["t,y", *rows]) + "\n", encoding="utf-8")
    return folder


COMMANDS = {
    "help": ["--help"],
    "replay": ["replay", "a.tlog", "--out", "OUT"],
    "replay --json": ["replay", "a.tlog", "--out", "OUT", "--json"],
    "replay --help": ["replay", "--help"],
    "version": ["--version"],
    "inspect": ["inspect", "a.tlog"],
    "orders": ["orders", "a.tlog"],
    "step": ["step", "step.csv"],
    "simulate": ["simulate", "yaw", "--seconds", "5", "--out", "OUT/s.csv"],
    "view": ["view", "a.mcap", "--out", "OUT/v.rrd"],
}
IN_THE_GATE = ("help", "replay")
"""The other commands, which print through the same door, are in the long list: each is a child."""
NAMES = [
    pytest.param(name, marks=() if name in IN_THE_GATE else pytest.mark.long) for name in COMMANDS
]
NO_SPACE = b"yawid: stdout: No space left on device\n"
ACCIDENTS = {
    "full": ("> /dev/full", {}, NO_SPACE),
    "full, without a buffer": ("> /dev/full", {"PYTHONUNBUFFERED": "1"}, NO_SPACE),
    "closed": (">&-", {}, b"yawid: stdout is closed"),
    "a pipe without a reader": (">&{unread}", {}, b""),
}
"""What a shell does to stdout, the environment, and what begins the one line on stderr."""


@pytest.fixture
def unread() -> Iterator[int]:
    """A pipe without a reader: the descriptor of its end for writing."""
    read, write = os.pipe()
    os.close(read)
    os.set_inheritable(write, True)
    yield write
    os.close(write)


def yawid(
    folder: Path, out: Path, arguments: list[str], redirected: str = "", **environment: str
) -> tuple[int, bytes, bytes]:
    """Run a command as a shell does; return its code and what came on both streams."""
    usual = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHONIO", "PYTHONUNB"))}
    arguments = [argument.replace("OUT", str(out)) for argument in arguments]
    done = subprocess.run(
        [
            "bash",
            "-c",
            f'exec "$@" {redirected}',
            "bash",
            sys.executable,
            "-m",
            "yawid",
            *arguments,
        ],
        cwd=folder,
        capture_output=True,
        check=False,
        close_fds=False,
        timeout=120,
        env=usual | {"PYTHONPATH": os.pathsep.join(sys.path)} | environment,
    )
    return done.returncode, done.stdout, done.stderr


@FULL
@pytest.mark.parametrize("accident", ACCIDENTS)
@pytest.mark.parametrize("name", NAMES)
def test_a_stdout_that_takes_nothing_is_one_line_or_quiet_and_exit_6(
    folder: Path, tmp_path: Path, unread: int, name: str, accident: str
) -> None:
    redirected, environment, said = ACCIDENTS[accident]
    code, _, error = yawid(
        folder, tmp_path, COMMANDS[name], redirected.format(unread=unread), **environment
    )

    assert code == 6, error
    assert (error[: len(said)], error.count(b"\n")) == (said, said != b"")
    if name == "replay":  # what was finished before is there; a closed one is seen at the begin
        left = [path.name for path in tmp_path.iterdir()]
        assert left == ([] if accident == "closed" else ["a.mcap"])


@FULL
@pytest.mark.parametrize(
    "redirected", ["2> /dev/full", pytest.param("2>&-", marks=pytest.mark.long)]
)
@pytest.mark.parametrize(("arguments", "expected"), [(["step", "none.csv"], 6), (["--what"], 2)])
def test_a_stderr_that_takes_nothing_changes_no_exit_code(
    folder: Path, tmp_path: Path, redirected: str, arguments: list[str], expected: int
) -> None:
    assert yawid(folder, tmp_path, arguments, redirected) == (expected, b"", b"")


@pytest.mark.parametrize(
    "environment",
    [
        pytest.param({"PYTHONIOENCODING": "ascii"}, marks=pytest.mark.long),
        {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    ],
    ids=["PYTHONIOENCODING", "LC_ALL"],
)
def test_a_terminal_of_ascii_only_gets_plain_words(
    folder: Path, tmp_path: Path, environment: dict[str, str]
) -> None:
    code, out, error = yawid(folder, tmp_path, COMMANDS["replay"], **environment)
    assert code == 5, error  # this rudder moves nothing
    assert b"+- is one sigma" in out
    assert out.isascii()
    code, out, _ = yawid(folder, tmp_path, COMMANDS["step"], **environment)
    assert code == 0
    assert b" +- " in out


def test_a_name_that_is_no_text_is_printed_as_its_bytes(folder: Path, tmp_path: Path) -> None:
    log = os.fsdecode(b"caf\xe9.tlog")
    (folder / log).write_bytes(FLIGHT)
    code, out, error = yawid(folder, tmp_path, ["replay", log, "--out", "OUT"])

    assert code == 5, error  # this rudder moves nothing
    assert b"caf\xe9.tlog\n" in out
    assert b"caf\xe9.mcap\n" in out
