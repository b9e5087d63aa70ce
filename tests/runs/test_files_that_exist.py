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
QUICK = ("flight.tlog", "--rate", "5", "--manoeuvres", "off")
RUN = Path("yawid-out/flight.mcap")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> Path:
    """The folder of the runs; next to it lie a log, flight.tlog, and another one of that name."""
    monkeypatch.chdir(tmp_path)
    Path("other").mkdir()
    shutil.copy(C172P, "flight.tlog")
    shutil.copy(OTHER, "other/flight.tlog")
    return tmp_path / "yawid-out"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_same_log_with_the_same_options_is_replaced_with_its_recording_and_its_report_alone(
    folder: Path, capsys
) -> None:
    assert main(["replay", *QUICK]) in (0, 5)
    made = list[dict[str, int]]()
    for more in ([], ["--json"]):
        assert main(["replay", *QUICK, "--rerun", "save", *more]) in (0, 5)
        assert main(["report", str(RUN)]) == 0
        made.append({name: (folder / name).stat().st_ino for name in names(folder)})
    assert list(made[0]) == list(made[1]) == ["flight.html", "flight.mcap", "flight.rrd"]
    assert not {*made[0].values()} & {*made[1].values()}
    assert capsys.readouterr().err == ""

    assert main(["replay", *QUICK, "--memory", "30"]) in (0, 5)
    kept = (folder / "flight.html").read_bytes()
    other = ["report", "yawid-out/flight-2.mcap", "-o", "yawid-out/flight.html"]
    assert main(other) == 6
    assert "flight.html exists: --force overwrites it" in capsys.readouterr().err
    assert (folder / "flight.html").read_bytes() == kept


def test_other_options_get_a_number_each_and_a_line_says_so(folder: Path, capsys) -> None:
    for options, number in (
        ("", ""), ("--rate 10", "-2"), ("--memory 30", "-3"), ("--rate 10", "-2"), ("", ""),
    ):  # fmt: skip
        assert main(["replay", "flight.tlog", *options.split()]) == 0
        said = capsys.readouterr()
        assert WN.search(said.out)
        assert f"{folder / f'flight{number}.mcap'}\n" in said.out
        assert (f"this is flight{number}.mcap" in said.err) == bool(number)

    assert names(folder) == ["flight-2.mcap", "flight-3.mcap", "flight.mcap"]
    runs = [yawid.load(folder / name).config for name in names(folder)]
    assert [(each.rate, each.memory) for each in runs[:2]] == [(10.0, 60.0), (runs[2].rate, 30.0)]


def test_frames_that_a_key_leaves_out_are_another_option(folder: Path) -> None:
    shutil.copy(REPLAY_LOGS / "c172p_signed" / "log.tlog", "flight.tlog")
    Path("key").write_text("00" * 32, encoding="utf-8")
    for _ in range(2):
        main(["replay", "flight.tlog"])
        assert main(["replay", "flight.tlog", "--signing-key-file", "key"]) == 3

    assert names(folder) == ["flight-2.mcap", "flight.mcap"]


def test_another_log_is_answered_and_not_written_unless_forced(folder: Path, capsys) -> None:
    main(["replay", "flight.tlog", "--rerun", "save"])
    kept, first = RUN.read_bytes(), WN.search(capsys.readouterr().out)[1]
    for more in ([], ["--report"]):
        assert main(["replay", "other/flight.tlog", *more]) == 6
        said = capsys.readouterr()
        assert WN.search(said.out)[1] != first
        assert "mcap  " not in said.out
        assert "flight.mcap exists and is of another log: --force overwrites it" in said.err
        assert (RUN.read_bytes(), names(folder)) == (kept, ["flight.mcap", "flight.rrd"])

    assert main(["replay", "other/flight.tlog", "--force"]) == 0
    said = "of another run than flight.mcap will be, and kept: flight.rrd"
    assert said in capsys.readouterr().err
    assert yawid.load(RUN).summary.log.endswith("other/flight.tlog")


def test_a_file_that_is_no_run_stays_and_the_answer_is_printed_as_json_too(
    folder: Path, capsys
) -> None:
    folder.mkdir()
    RUN.write_text("mine", encoding="utf-8")

    assert main(["replay", "flight.tlog", "--json"]) == 6

    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert (answer["verdict"]["usable"], "files" in answer) == (True, False)
    assert "flight.mcap exists and is no run of this log: --force overwrites it" in said.err
    assert RUN.read_text(encoding="utf-8") == "mine"


def test_a_run_that_is_replayed_is_not_replaced_by_itself_but_may_have_another_next_to_it(
    folder: Path, capsys
) -> None:
    main(["replay", "flight.tlog"])
    kept = RUN.read_bytes()
    for options, code in (([], 6), (["--force"], 6), (["--orders", "2,2,2,1"], 0)):
        capsys.readouterr()
        assert main(["replay", str(RUN), *options]) == code
        said = capsys.readouterr()
        assert "wn " in said.out
        assert ("choose another --out" in said.err) == (code == 6)

    assert names(folder) == ["flight-2.mcap", "flight.mcap"]
    assert RUN.read_bytes() == kept
