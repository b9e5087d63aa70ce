"""The command line as a user meets it: exit codes, one line for what is wrong, real processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from flightlog import FlightLog, fly
from hostile import FLIGHT
from places import C172P
from printed import printed

import yawid.runs.job
from yawid.cli.main import main
from yawid.errors import EXIT_CODES


def test_several_logs_give_a_line_each_files_of_their_own_and_the_highest_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    no_rudder, no_vehicle, slow = FlightLog(), FlightLog(), tmp_path / "slow" / "log.tlog"
    no_rudder.heartbeat(1.0, kind=2)
    for i in range(100):
        no_rudder.attitude(1.0 + 0.02 * i, 0.0)
        no_vehicle.attitude(1.0 + 0.02 * i, 0.0)
    slow.parent.mkdir()
    slow.write_bytes(fly(lambda t: 0.1, lambda t: 1500, 8.0, attitude_s=0.1, servo_s=0.1).data)
    for name, log in (("copter", no_rudder), ("mute", no_vehicle)):
        (tmp_path / f"{name}.tlog").write_bytes(log.data)
    logs = [C172P, tmp_path / "copter.tlog", tmp_path / "mute.tlog", slow]
    replay = ["replay", *map(str, logs), "--out", str(tmp_path / "out"), "--json"]

    assert main([*replay, "--rate", "20", "--to", "80"]) == 3
    said = capsys.readouterr()
    reasons = [printed("replay", line)["verdict"]["reasons"] for line in said.out.splitlines()]
    assert [each[0]["id"] for each in reasons[1:]] == ["no_rudder", "no_vehicle"]
    assert "quadrotor" in reasons[1][0]["text"]
    assert said.err.count("\n") == 1  # a rate above the log's own, which leaves nothing in the way
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["c172p_3211-log.mcap", "copter.mcap", "mute.mcap"]
    assert main(["replay", str(slow), "--out", str(tmp_path / "out"), "--rate", "10"]) == 5


def test_a_recording_in_the_way_leaves_no_half_written_mcap(tmp_path: Path, capsys):
    (tmp_path / "log.rrd").write_bytes(b"precious")
    options = ["--rerun", "save", "--manoeuvres", "off", "--out", str(tmp_path)]

    assert main(["replay", str(C172P), *options]) == 6
    assert "--force" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["log.rrd"]


OF_A_RUN = ("scipy.linalg", "scipy.signal", "scipy.stats", "matplotlib", "filterpy", "pandas",
            "rich", "jsbsim", "rerun", "numba", "pymavlink.mavutil", "mcap.reader", "email",
            "yawid.offline")  # fmt: skip
LOADED = """
import sys
from yawid.cli.main import main
main(sys.argv[2:])
print([name for name in sys.argv[1].split() if name in sys.modules], file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("unused", "words"),
    [
        ((*OF_A_RUN, "numpy", "scipy", "mcap", "pymavlink", "msgspec", "logging"), ["--help"]),
        (OF_A_RUN, ["replay", str(C172P), "--rate", "10", "--json", "--out"]),
    ],
)
def test_a_command_loads_only_what_it_uses(unused: tuple[str, ...], words: list[str], tmp_path):
    words = [*words, str(tmp_path)] if "--out" in words else words
    command = [sys.executable, "-c", LOADED, " ".join(unused), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert done.stderr.splitlines()[-1] == "[]"


@pytest.fixture
def faulty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log whose run hits a fault of yawid's own: here one that is put into it."""

    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a line\nand \x1b[2Jmore")

    monkeypatch.setattr(yawid.runs.job, "summarise", fail)
    (tmp_path / "a.tlog").write_bytes(FLIGHT)
    return tmp_path / "a.tlog"


def test_what_is_unforeseen_is_one_line_and_exit_70_with_a_traceback_for_who_asks(
    faulty: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("YAWID_DEBUG", raising=False)
    replay = ["replay", str(faulty), str(tmp_path / "none.tlog"), "--out", str(tmp_path / "out")]
    assert main(replay) == 70 in EXIT_CODES

    first, second = capsys.readouterr().err.splitlines()
    assert "ZeroDivisionError: a line and \\x1b[2Jmore; YAWID_DEBUG=1" in first
    assert "none.tlog" in second  # a log behind one that fails is run all the same
    assert not list((tmp_path / "out").glob("*.mcap"))
    monkeypatch.setenv("YAWID_DEBUG", "1")
    assert main(replay) == 70
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert "\x1b" not in said
