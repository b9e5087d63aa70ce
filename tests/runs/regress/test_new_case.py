"""``yawid regress --new``: a case from a log of one's own."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from flightlog import FlightLog, fly

from yawid.cli.main import main
from yawid.runs.regress.case import Case


def flight(seconds: float = 40.0) -> FlightLog:
    log = fly(lambda t: 0.2 * (t % 3 > 1), lambda t: 1500 + 150 * (t % 3 > 1), seconds)
    log.parameter(10.0, "SERVO4_FUNCTION", 21.0)
    return log


def test_a_new_case_from_a_small_log_is_the_log_itself_and_passes_once_updated(tmp_path, capsys):
    log, folder = tmp_path / "my flight.tlog", tmp_path / "mine"
    log.write_bytes(flight().data)

    made = ["regress", "--new", str(log), "--name", "first", "--folder", str(folder)]
    assert main([*made, "--rate", "10"]) == 0

    case = Case.read(folder / "first")
    assert case.log.read_bytes() == log.read_bytes()
    assert case.sha256 == hashlib.sha256(log.read_bytes()).hexdigest()
    assert case.config.rate == 10.0
    assert 0 < case.floor < 400
    assert "--update --why" in capsys.readouterr().out
    assert main(["regress", "--folder", str(folder)]) == 1
    assert main(["regress", "--folder", str(folder), "--update", "--why", "first"]) == 0
    assert main(["regress", "--folder", str(folder)]) == 0


def test_a_new_case_of_a_stretch_keeps_it_with_parameters_and_nothing_yawid_does_not_read(
    tmp_path: Path,
):
    log, folder = tmp_path / "long.tlog", tmp_path / "mine"
    whole = flight(150.0)
    log.write_bytes(whole.data)

    made = ["regress", "--new", str(log), "--name", "cut", "--folder", str(folder)]
    assert main([*made, "--from", "100", "--to", "130"]) == 0

    case = Case.read(folder / "cut")
    replayed = case.replay()
    assert len(case.log.read_bytes()) < 0.4 * len(whole.data)
    assert replayed.summary["channels"]["rudder"]["how"] == "parameter, travel assumed"
    times = [row[replayed.columns.index("t")] for row in replayed.rows]
    assert (min(times), max(times)) == (100.0, 130.0)


def test_a_log_that_stays_large_wants_a_stretch(tmp_path: Path, capsys):
    log = tmp_path / "long.tlog"
    log.write_bytes(flight(300.0).data)
    assert log.stat().st_size > 1_000_000

    made = ["regress", "--new", str(log), "--name", "big", "--folder", str(tmp_path / "mine")]

    assert main(made) == 2
    assert "--from and --to" in capsys.readouterr().err
    assert not (tmp_path / "mine").exists()


def test_a_new_case_that_cannot_be_replayed_leaves_nothing_behind(tmp_path: Path):
    log = tmp_path / "flight.tlog"
    log.write_bytes(flight().data)
    made = ["regress", "--new", str(log), "--name", "x", "--folder", str(tmp_path / "mine")]

    assert main([*made, "--rate", "90"]) == 2
    assert not (tmp_path / "mine" / "x").exists()


@pytest.mark.parametrize("name", ["../out", "a/b", "", ".", "..", "-x", "a\0b", "x" * 200, "ä"])
def test_the_name_of_a_new_case_is_one_plain_name(name: str, tmp_path: Path):
    log = tmp_path / "flight.tlog"
    log.write_bytes(flight().data)
    before = sorted(tmp_path.rglob("*"))

    made = ["regress", "--new", str(log), f"--name={name}", "--folder", str(tmp_path / "mine")]

    assert main(made) == 2
    assert sorted(tmp_path.rglob("*")) == before


def test_a_new_case_never_takes_the_place_of_another(tmp_path: Path):
    log, folder = tmp_path / "flight.tlog", tmp_path / "mine"
    log.write_bytes(flight().data)
    made = ["regress", "--new", str(log), "--name", "first", "--folder", str(folder)]
    assert main(made) == 0
    before = {path: path.read_bytes() for path in (folder / "first").iterdir()}
    log.write_bytes(flight(50.0).data)

    assert main(made) == 2
    assert {path: path.read_bytes() for path in (folder / "first").iterdir()} == before
