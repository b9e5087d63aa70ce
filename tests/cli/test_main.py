"""The command line as a user meets it: exit codes, one line for what is wrong, real processes."""

from __future__ import annotations

import io
import json
import os
import socket
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from flightlog import FlightLog, fly
from places import C172P, ROOT
from printed import printed

from yawid.cli.main import main


def yawid(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-m", "yawid", *map(str, arguments)]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env=os.environ | environment,
    )


def inside(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command in this process, which does not start an interpreter for it."""
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        code = main(list(map(str, arguments)))
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def test_a_replay_prints_one_json_object_and_writes_its_files(tmp_path: Path):
    done = yawid("replay", C172P, "--rate", 10, "--out", tmp_path, "--rerun", "save", "--json")

    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    summary = printed("replay", done.stdout)
    assert summary["verdict"]["usable"] is True
    assert summary["log"] == str(C172P)
    for kind in ("mcap", "rrd"):
        assert Path(summary["files"][kind]).is_absolute()
        assert Path(summary["files"][kind]).stat().st_size > 10_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.mcap", "log.rrd"]


def test_a_replay_for_people_says_the_verdict_and_the_dutch_roll(tmp_path: Path):
    done = inside("replay", C172P, "--rate", 10, "--out", tmp_path)

    assert done.returncode == 0
    assert "verdict  usable" in done.stdout
    assert "  flight  wn 2.4" in done.stdout
    assert "Dutch roll wn" not in done.stdout
    assert "\x1b" not in done.stdout
    paths = [line for line in done.stdout.splitlines() if str(tmp_path) in line]
    assert all(len(line) <= 80 for line in done.stdout.splitlines() if line not in paths)


def test_several_logs_give_a_line_each_and_the_highest_code(tmp_path: Path):
    no_rudder = FlightLog()
    no_rudder.heartbeat(1.0, kind=2)
    for i in range(100):
        no_rudder.attitude(1.0 + 0.02 * i, 0.0)
    (tmp_path / "copter.tlog").write_bytes(no_rudder.data)
    out = tmp_path / "out"

    done = inside("replay", C172P, tmp_path / "copter.tlog", "--out", out, "--json", "--rate", 10)

    assert done.returncode == 3
    first, second = (printed("replay", line) for line in done.stdout.splitlines())
    assert first["verdict"]["usable"]
    assert second["verdict"]["reasons"][0]["id"] == "no_rudder"
    assert "quadrotor" in second["verdict"]["reasons"][0]["text"]
    assert (out / "copter.mcap").exists()


def test_logs_of_the_same_name_do_not_write_over_each_other(tmp_path: Path):
    other = ROOT / "replay_logs" / "c172p_gcs_rates" / "log.tlog"

    done = inside("replay", C172P, other, "--out", tmp_path, "--json", "--manoeuvres", "off")

    assert done.returncode == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["c172p_3211-log.mcap", "c172p_gcs_rates-log.mcap"]


def test_a_recording_in_the_way_leaves_no_half_written_mcap(tmp_path: Path):
    (tmp_path / "log.rrd").write_bytes(b"precious")

    done = inside("replay", C172P, "--rerun", "save", "--manoeuvres", "off", "--out", tmp_path)

    assert done.returncode == 6
    assert "--force" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["log.rrd"]


def bad_inputs(tmp_path: Path) -> dict[str, Path]:
    (tmp_path / "empty.tlog").touch()
    (tmp_path / "text.tlog").write_text("Build started.\nBuild succeeded.\n" * 40, encoding="utf-8")
    (tmp_path / "folder").mkdir()
    return {
        "empty": tmp_path / "empty.tlog",
        "text": tmp_path / "text.tlog",
        "folder": tmp_path / "folder",
        "missing": tmp_path / "missing.tlog",
    }


@pytest.mark.parametrize("kind", ["empty", "text", "folder", "missing"])
def test_what_is_no_log_gets_one_line_and_leaves_nothing(kind: str, tmp_path: Path):
    path = bad_inputs(tmp_path)[kind]
    out = tmp_path / "out"

    done = inside("replay", path, "--out", out, "--json")

    assert done.returncode == 6
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"yawid: {path}")
    assert not out.exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_log_without_permission_gets_one_line(tmp_path: Path):
    path = tmp_path / "log.tlog"
    path.write_bytes(b"x")
    path.chmod(0)

    done = inside("replay", path, "--out", tmp_path / "out")

    assert done.returncode == 6
    assert "permission" in done.stderr


def test_an_output_folder_that_cannot_be_written_gets_one_line(tmp_path: Path):
    (tmp_path / "file").touch()

    done = inside("replay", C172P, "--out", tmp_path / "file" / "out")

    assert done.returncode == 6
    assert done.stderr.count("\n") == 1
    assert str(tmp_path / "file" / "out") in done.stderr


def test_a_log_without_heartbeat_has_no_vehicle(tmp_path: Path):
    log = FlightLog()
    for i in range(100):
        log.attitude(1.0 + 0.02 * i, 0.0)
    path = tmp_path / "mute.tlog"
    path.write_bytes(log.data)

    done = inside("replay", path, "--out", tmp_path / "out", "--json")

    assert done.returncode == 3
    assert printed("replay", done.stdout)["verdict"]["reasons"][0]["id"] == "no_vehicle"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--orders", "3,3,2"], "na,nb,nc,nk"),
        (["--orders", "3,3,2,0"], "nk"),
        (["--orders", "a,b,c,d"], "orders"),
        (["--method", "arx"], "els, rml"),
        (["--memory", "0"], "> 0"),
        (["--rate", "-1"], "--rate"),
        (["--rate", "nan"], "--rate"),
        (["--rate", "80"], "--rate 50"),
        (["--rudder", "servo:99"], "servo:N"),
        (["--inputs", "elevator"], "rudder,aileron"),
        (["--from", "9", "--to", "3"], "--to"),
        (["--rerun", "maybe"], "rerun+http"),
        (["--config", "missing.toml"], "missing.toml"),
    ],
)
def test_a_setting_outside_its_limits_is_named_with_the_limit(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    try:
        code: object = main(["replay", str(C172P), "--out", str(tmp_path / "out"), *arguments])
    except SystemExit as ended:  # by the parser
        code = ended.code

    captured = capsys.readouterr()
    assert code == 2
    assert said in captured.err
    assert captured.err.count("\n") == 1
    assert not list(tmp_path.glob("out/*"))


def test_every_option_can_stand_in_a_toml_file_and_the_command_line_wins(tmp_path: Path):
    settings = tmp_path / "run.toml"
    settings.write_text(
        'orders = [2, 2, 2, 1]\nrate = 10\nmemory = inf\nalso = "none"\n', encoding="utf-8"
    )

    done = inside("replay", C172P, "--config", settings, "--rate", 5, "--out", tmp_path, "--json")

    estimates = json.loads(done.stdout)["estimates"]
    assert list(estimates) == ["els"]
    assert estimates["els"]["orders"] == {"na": 2, "nb": 2, "nc": 2, "nk": 1}
    assert estimates["els"]["sample_time_s"] == 0.2


@pytest.mark.parametrize("text", ["rates = 10", 'rate = "fast"', "rate = [", "orders = [1.5]"])
def test_a_toml_file_with_a_mistake_is_refused(text: str, tmp_path: Path):
    settings = tmp_path / "run.toml"
    settings.write_text(text, encoding="utf-8")

    assert main(["replay", str(C172P), "--config", str(settings), "--out", str(tmp_path)]) == 2


@pytest.mark.parametrize("endpoint", ["udp:", "14560", "udpin:14560", "127.0.0.1:14560", "x:y:z"])
def test_a_malformed_endpoint_is_refused_with_the_right_spellings(endpoint, capsys, tmp_path):
    code = main(["live", endpoint, "--out", str(tmp_path)])

    said = capsys.readouterr().err
    assert code == 2
    assert "udpin:127.0.0.1:14560" in said
    assert "udpin:0.0.0.0:14560" in said


def test_a_port_in_use_is_said_with_its_remedy(capsys, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]

        code = main(["live", f"udpin:127.0.0.1:{port}", "--out", str(tmp_path)])

    said = capsys.readouterr().err
    assert code == 6
    assert str(port) in said
    assert said.count("\n") == 1


def test_a_rate_above_the_logs_own_leaves_nothing_in_the_way_of_the_next_run(tmp_path: Path):
    log = fly(lambda t: 0.1, lambda t: 1500, 8.0, attitude_s=0.1, servo_s=0.1)
    path = tmp_path / "slow.tlog"
    path.write_bytes(log.data)
    arguments = ["replay", str(path), "--out", str(tmp_path / "out")]

    assert main([*arguments, "--rate", "20"]) == 2
    assert main([*arguments, "--rate", "10"]) == 5


def test_a_replay_loads_only_what_it_uses(tmp_path: Path):
    program = (
        "import sys, yawid.cli.main\n"
        "yawid.cli.main.main(sys.argv[1:])\n"
        "unused = ('scipy.linalg', 'scipy.signal', 'scipy.stats', 'matplotlib', 'filterpy',\n"
        "          'pandas', 'rich', 'jsbsim', 'rerun', 'numba', 'yawid.offline',\n"
        "          'pymavlink.mavutil', 'mcap.reader', 'email')\n"
        "print([name for name in unused if name in sys.modules], file=sys.stderr)"
    )
    arguments = ["replay", str(C172P), "--rate", "10", "--out", str(tmp_path), "--json"]
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert done.stderr.splitlines()[-1] == "[]"


def test_help_does_not_import_what_only_a_run_needs():
    program = (
        "import sys, yawid.cli.main\n"
        "try: yawid.cli.main.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({m.split('.')[0] for m in sys.modules} & set(sys.argv[1:])), file=sys.stderr)"
    )
    heavy = ["numba", "scipy", "rerun", "mcap", "pymavlink", "matplotlib", "filterpy", "rich"]
    done = subprocess.run(
        [sys.executable, "-c", program, *heavy],
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip

    assert done.stderr.strip() == "[]"


def test_the_overview_of_the_commands_fits_a_terminal_of_80_columns(capsys):
    assert main(["--help"]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 30
    assert [line for line in lines if len(line) > 80] == []
