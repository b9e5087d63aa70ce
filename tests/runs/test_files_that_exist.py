"""What a replay and a report do with files that exist: the answer comes first in every case."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from places import C172P, REPLAY_LOGS

import yawid
from yawid.cli.main import main

OTHER = REPLAY_LOGS / "c172p_gcs_rates" / "log.tlog"
WN = re.compile(r"^  flight  wn (\d\.\d+)", re.MULTILINE)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """A folder with a log, flight.tlog, and another one of that name."""
    monkeypatch.chdir(tmp_path)
    Path("other").mkdir()
    shutil.copy(C172P, "flight.tlog")
    shutil.copy(OTHER, "other/flight.tlog")
    return tmp_path / "yawid-out"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_same_log_with_the_same_options_is_replaced_with_its_recording_and_report(
    folder: Path, capsys
) -> None:
    quick = ["flight.tlog", "--rate", "5", "--manoeuvres", "off"]
    assert main(["replay", *quick]) in (0, 5)
    assert main(["replay", *quick, "--rerun", "save"]) in (0, 5)
    assert main(["report", "yawid-out/flight.mcap"]) == 0
    before = {name: (folder / name).stat().st_ino for name in names(folder)}
    assert list(before) == ["flight.html", "flight.mcap", "flight.rrd"]

    assert main(["replay", *quick, "--rerun", "save", "--json"]) in (0, 5)
    assert main(["report", "yawid-out/flight.mcap"]) == 0

    assert not {*capsys.readouterr().err.splitlines()}
    assert names(folder) == list(before)
    assert all((folder / name).stat().st_ino != before[name] for name in before)


def test_other_options_get_a_number_each_and_a_line_says_so(folder: Path, capsys) -> None:
    assert main(["replay", "flight.tlog"]) == 0
    first = (folder / "flight.mcap").read_bytes()
    for options in ("--rate 10", "--memory 30", "--rate 10", ""):
        capsys.readouterr()
        assert main(["replay", "flight.tlog", *options.split()]) == 0
        said = capsys.readouterr()
        assert WN.search(said.out)
        number = {"--rate 10": "-2", "--memory 30": "-3", "": ""}[options]
        assert f"{folder / f'flight{number}.mcap'}\n" in said.out
        assert (f"this is flight{number}.mcap" in said.err) == bool(number)

    assert names(folder) == ["flight-2.mcap", "flight-3.mcap", "flight.mcap"]
    assert yawid.load(folder / "flight-2.mcap").config.rate == 10.0
    assert yawid.load(folder / "flight-3.mcap").config.memory == 30.0
    assert yawid.load(folder / "flight.mcap").samples.t.size
    assert len((folder / "flight.mcap").read_bytes()) == len(first)


def test_frames_that_a_key_leaves_out_are_another_option(folder: Path) -> None:
    shutil.copy(REPLAY_LOGS / "c172p_signed" / "log.tlog", "flight.tlog")
    Path("key").write_text("00" * 32, encoding="utf-8")
    for _ in range(2):
        main(["replay", "flight.tlog"])
        assert main(["replay", "flight.tlog", "--signing-key-file", "key"]) == 3

    assert names(folder) == ["flight-2.mcap", "flight.mcap"]


@pytest.mark.parametrize("more", [[], ["--report"]])
def test_another_log_is_answered_and_not_written_unless_forced(
    folder: Path, capsys, more: list[str]
) -> None:
    main(["replay", "flight.tlog", "--rerun", "save"])
    kept = (folder / "flight.mcap").read_bytes()
    of_first = WN.search(capsys.readouterr().out)

    assert main(["replay", "other/flight.tlog", *more]) == 6

    said = capsys.readouterr()
    found = WN.search(said.out)
    assert of_first is not None
    assert found is not None
    assert found[1] != of_first[1]
    assert "mcap  " not in said.out
    assert "flight.mcap exists and is of another log: --force overwrites it" in said.err
    assert (folder / "flight.mcap").read_bytes() == kept
    assert names(folder) == ["flight.mcap", "flight.rrd"]

    assert main(["replay", "other/flight.tlog", "--force"]) == 0
    assert (
        "of another run than flight.mcap will be, and kept: flight.rrd" in capsys.readouterr().err
    )
    assert yawid.load(folder / "flight.mcap").summary.log.endswith("other/flight.tlog")


def test_a_file_that_is_no_run_stays_and_the_answer_is_printed_as_json_too(
    folder: Path, capsys
) -> None:
    folder.mkdir()
    (folder / "flight.mcap").write_text("mine", encoding="utf-8")

    assert main(["replay", "flight.tlog", "--json"]) == 6

    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert answer["verdict"]["usable"]
    assert "files" not in answer
    assert "flight.mcap exists and is no run of this log: --force overwrites it" in said.err
    assert (folder / "flight.mcap").read_text(encoding="utf-8") == "mine"


def test_a_run_that_is_replayed_is_not_replaced_by_itself_but_may_have_another_next_to_it(
    folder: Path, capsys
) -> None:
    main(["replay", "flight.tlog"])
    kept = (folder / "flight.mcap").read_bytes()
    for options, code in (([], 6), (["--force"], 6), (["--orders", "2,2,2,1"], 0)):
        capsys.readouterr()
        assert main(["replay", "yawid-out/flight.mcap", *options]) == code
        said = capsys.readouterr()
        assert "wn " in said.out
        assert ("choose another --out" in said.err) == (code == 6)

    assert names(folder) == ["flight-2.mcap", "flight.mcap"]
    assert (folder / "flight.mcap").read_bytes() == kept


def test_a_report_of_another_run_is_never_replaced(folder: Path, capsys) -> None:
    quick = ["--rate", "5", "--manoeuvres", "off"]
    main(["replay", "flight.tlog", *quick])
    main(["replay", "flight.tlog", *quick, "--memory", "30"])
    assert main(["report", "yawid-out/flight.mcap", "-o", "r.html"]) == 0
    kept = Path("r.html").read_bytes()

    assert main(["report", "yawid-out/flight-2.mcap", "-o", "r.html"]) == 6
    assert "r.html exists: --force overwrites it" in capsys.readouterr().err
    assert Path("r.html").read_bytes() == kept
    assert main(["report", "yawid-out/flight.mcap", "-o", "r.html"]) == 0
