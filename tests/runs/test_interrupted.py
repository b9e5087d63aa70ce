"""SIGINT and SIGTERM: what is finished is kept under its own name, and nothing passes for whole."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from checks.children import child
from finished_runs import replayed
from interrupting import repeated, yawid_with
from places import C172P
from printed import printed

from yawid.cli.main import main
from yawid.runs import replay as session
from yawid.runs.outputs import Outputs
from yawid.runs.stop import Interrupted, StopFlag
from yawid.sinks.base import Sink

CODES = {"SIGINT": 130, "SIGTERM": 143}
ENV = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return repeated(C172P, tmp_path_factory.mktemp("long") / "long.tlog", 4)


@pytest.mark.parametrize(("name", "of", "at"), [("SIGINT", "log", 3), ("SIGTERM", "run", 1)])
def test_a_replay_that_was_stopped_is_not_usable_and_bears_its_own_name(
    name: str, of: str, at: int, long: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of three it gets the signal in the first; what was kept is replayed, and no answer."""
    whole, out = long, tmp_path / "out"
    if of == "run":  # of two blocks of samples
        log = repeated(C172P, tmp_path / "long.tlog", 1)
        whole = replayed(log, tmp_path, "--rate", 50, "--manoeuvres", "off")
    options = ("--out", out, "--rerun", "save", "--json", "--manoeuvres", "off")
    done = yawid_with(name, at, "replay", whole, C172P, "x.tlog", *options)

    assert done.returncode == CODES[name], done.stderr
    assert done.stderr == f"yawid: {name}: not reached: {C172P}, x.tlog\n"
    summary = printed("replay", done.stdout)
    reason = summary["verdict"]["reasons"][0]
    assert (reason["id"], reason["weight"]) == ("interrupted", "fatal")
    assert name in reason["text"]
    assert (summary["verdict"]["usable"], "sha256" in summary) == (False, False)
    assert 0 < summary["bytes_read"] < whole.stat().st_size
    names = ["long.interrupted.mcap", "long.interrupted.rrd"]
    assert sorted(path.name for path in out.iterdir()) == names
    assert sorted(Path(path).name for path in summary["files"].values()) == names
    again = ["replay", str(out / names[0]), "--orders", "2,2,2,1"]
    assert main([*again, "--out", str(tmp_path / "again")]) == 130
    assert f"interrupted: {name} after" in capsys.readouterr().out


def test_a_signal_that_comes_when_all_is_read_changes_nothing(tmp_path: Path) -> None:
    done = yawid_with("SIGINT", 1, "replay", C172P, "--rate", "10", "--out", tmp_path, "--json")

    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["verdict"]["usable"]
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def test_a_whole_run_is_never_overwritten_by_one_that_was_stopped(
    long: Path, tmp_path: Path
) -> None:
    command = ("replay", long, "--manoeuvres", "off", "--out", tmp_path)
    (tmp_path / "long.mcap").write_bytes(b"whole")
    done = yawid_with("SIGINT", 3, *command, "--force")
    assert done.returncode == 130
    assert (tmp_path / "long.mcap").read_bytes() == b"whole"

    (tmp_path / "long.mcap").unlink()
    (tmp_path / "long.interrupted.mcap").write_bytes(b"earlier")
    done = yawid_with("SIGINT", 3, *command)
    assert done.returncode == 6
    assert "long.interrupted.mcap exists: --force" in done.stderr
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"earlier"]


STOPPED = """
import os, signal, sys
from yawid.cli import main as cli
from yawid.channels import stage
from yawid.sinks.mcap import reader as mcap_run
def signalled(*arguments):
    os.kill(os.getpid(), getattr(signal, sys.argv[1]))
stage.Channels.finish = mcap_run.McapRun.blocks = signalled
sys.exit(cli.main(sys.argv[2:]))
"""
"""A command that gets the signal when it has read its log, or goes to draw its rows."""


@pytest.mark.parametrize(
    ("command", "name"), [("inspect", "SIGTERM"), ("orders", "SIGINT"), ("report", "SIGTERM")]
)
def test_a_command_that_makes_one_answer_ends_without_it(
    tmp_path: Path, name: str, command: str
) -> None:
    arguments = [command, str(C172P)]
    if command == "report":
        run = replayed(C172P, tmp_path, "--rate", 10, "--manoeuvres", "off")
        arguments = [command, str(run)]
    done = subprocess.run(
        [sys.executable, "-c", STOPPED, name, *arguments],
        capture_output=True, text=True, check=False, timeout=120, env=ENV,
    )  # fmt: skip

    assert done.returncode == CODES[name], done.stderr
    assert done.stdout == ""
    assert done.stderr == "yawid: interrupted: there was nothing to save\n"
    assert not [path for path in tmp_path.iterdir() if path.suffix in (".html", ".part")]


STOPS = """
import time
from yawid.runs.stop import StopFlag
with StopFlag().installed() as stop:
    print("ready", flush=True)
    while not stop.is_set: time.sleep(0.01)
    print(stop.name, flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize(
    ("ignored", "first", "second"),
    [("", "SIGINT", "SIGINT"), ("", "SIGINT", "SIGTERM"), ("INT", "SIGTERM", "SIGTERM")],
)
def test_a_second_signal_ends_at_once_and_one_that_is_ignored_from_the_start_stays_so(
    ignored: str, first: str, second: str
) -> None:
    """Also what never looks whether it is to stop, as a loop of numba's does not.

    A shell starts a script's jobs in the background so: a ctrl-C is not meant for them.
    """
    python = [sys.executable, "-c", STOPS]
    shell = ["bash", "-c", f"trap '' {ignored}; exec \"$@\"", "bash"] if ignored else []
    with child([*shell, *python], stdout=subprocess.PIPE, text=True, env=ENV) as process:
        assert process.stdout.readline() == "ready\n"
        for name, said in ((first, f"{first}\n"), (second, "")):
            if ignored:
                process.send_signal(signal.SIGINT)
            process.send_signal(signal.Signals[name])
            assert process.stdout.readline() == said
        assert process.wait(60.0) == -signal.Signals[second]


def test_the_flag_is_looked_at_or_raises_and_leaves_the_handlers_as_they_were() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with StopFlag().installed() as stop:
        assert not stop.is_set
        signal.raise_signal(signal.SIGTERM)
        assert (stop.is_set, stop.exit_code, stop.name) == (True, 143, "SIGTERM")
        with pytest.raises(Interrupted), stop.raising():
            pytest.fail("it has been told before")
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_replay_told_to_stop_before_its_first_bytes_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop, real = StopFlag(), session.open_sinks

    def told_while_opening(*arguments: Any) -> list[Sink]:
        stop.is_set = True
        return real(*arguments)

    monkeypatch.setattr(session, "open_sinks", told_while_opening)
    with pytest.raises(Interrupted):
        session.replay(C172P, {}, Outputs(tmp_path, "log"), stop)

    assert list(tmp_path.iterdir()) == []
