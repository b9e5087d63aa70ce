"""Cases of on-board logs: made from them, replayed and compared as those of telemetry logs."""

from __future__ import annotations

from pathlib import Path

import pytest
from sources.logs import dataflash_flight, ulog_flight
from sources.logs.onboard_flight import WN, flown

from yawid.cli.main import main
from yawid.runs.regress.case import Case

LOGS = {".bin": dataflash_flight, ".ulg": ulog_flight}


@pytest.mark.parametrize("suffix", LOGS)
def test_an_on_board_log_makes_a_case_that_passes_once_updated(tmp_path: Path, suffix: str):
    log, folder = tmp_path / "flight", tmp_path / "mine"
    log.write_bytes(LOGS[suffix].logged(flown(40.0)).data)

    made = ["regress", "--new", str(log), "--name", "first", "--folder", str(folder)]
    assert main([*made, "--from", "22", "--forgetting", "1"]) == 0

    case = Case.read(folder / "first")
    assert case.log.name == f"log{suffix}"
    assert case.log.read_bytes() == log.read_bytes()
    assert main(["regress", "--folder", str(folder), "--update", "--why", "first"]) == 0
    assert main(["regress", "--folder", str(folder)]) == 0
    found = case.replay().summary["estimates"]["rml"]["dutch_roll"]["wn_rad_s"]
    assert found == pytest.approx(WN, rel=0.02)


def test_an_on_board_log_is_not_cut_and_must_be_small(tmp_path: Path, capsys):
    log = tmp_path / "long.bin"
    log.write_bytes(dataflash_flight.logged(flown(20.0)).data + bytes(1_000_000))

    made = ["regress", "--new", str(log), "--name", "big", "--folder", str(tmp_path / "mine")]

    assert main(made) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert "a case has less than 1000000" in line
    assert not (tmp_path / "mine").exists()
