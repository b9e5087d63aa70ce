"""``yawid regress`` as a person and a machine use it: codes, reports, updates."""

from __future__ import annotations

import shutil
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from places import REPLAY_LOGS as CASES
from printed import printed

from yawid.cli.main import main
from yawid.runs.regress.case import Case, find_cases
from yawid.runs.regress.check import Outcome, check_case, regress, write_junit
from yawid.runs.regress.table import read_csv


@pytest.fixture(scope="module")
def referenced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two cases whose references this very code wrote."""
    folder = tmp_path_factory.mktemp("referenced")
    for name in ("c172p_gcs_rates", "no_rudder"):
        shutil.copytree(CASES / name, folder / name)
    assert main(["regress", "--update", "--why", "a test", "--folder", str(folder)]) == 0
    return folder


@pytest.fixture
def folder(referenced: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "cases"
    shutil.copytree(referenced, copy)
    return copy


@pytest.fixture
def case(folder: Path) -> Path:
    shutil.rmtree(folder / "no_rudder")
    return folder / "c172p_gcs_rates"


def bend(case: Path, column: str = "wn") -> None:
    """Change one value of the reference."""
    header, *rows = (case / "expected.csv").read_text(encoding="utf-8").splitlines()
    i = header.split(",").index(column)
    last = rows[-1].split(",")
    last[i] = f"{float(last[i]) + 0.5:.9g}"
    (case / "expected.csv").write_text(
        "\n".join([header, *rows[:-1], ",".join(last)]) + "\n", encoding="utf-8"
    )


def test_what_was_just_updated_matches(folder: Path, capsys):
    code = main(["regress", "--folder", str(folder)])

    assert code == 0
    assert [line.split() for line in capsys.readouterr().out.splitlines()] == [
        ["ok", "c172p_gcs_rates"],
        ["ok", "no_rudder"],
    ]
    assert not list(folder.glob("*/actual.*"))


def test_a_mismatch_is_exit_1_and_leaves_rows_and_picture_and_the_way_to_update(case, capsys):
    bend(case)

    code = main(["regress", "--folder", str(case.parent)])

    said = capsys.readouterr().out
    assert code == 1
    assert "FAILED" in said
    assert "wn: 1 of" in said
    assert "--update --why" in said
    columns, rows = read_csv(case / "actual.csv")
    assert columns == read_csv(case / "expected.csv")[0]
    assert len(rows) == len(read_csv(case / "expected.csv")[1])
    picture = ET.parse(case / "actual.svg").getroot()
    assert picture.tag.endswith("svg")
    assert "c172p_gcs_rates: expected and actual" in (case / "actual.svg").read_text(
        encoding="utf-8"
    )


def test_the_picture_of_the_same_difference_is_the_same(case: Path):
    bend(case)
    check_case(Case.read(case))
    first = (case / "actual.svg").read_bytes()
    check_case(Case.read(case))

    assert (case / "actual.svg").read_bytes() == first


def test_a_case_that_matches_again_leaves_no_old_difference(case: Path):
    reference = (case / "expected.csv").read_bytes()
    bend(case)
    assert main(["regress", str(case)]) == 1
    (case / "expected.csv").write_bytes(reference)

    assert main(["regress", str(case)]) == 0
    assert not list(case.glob("actual.*"))


def test_another_log_than_the_cases_own_is_noticed_and_never_becomes_a_reference(case, capsys):
    data = (case / "log.tlog").read_bytes()
    (case / "log.tlog").write_bytes(data + b"\0")
    before = (case / "expected.json").read_bytes()

    assert any("sha256" in line for line in check_case(Case.read(case)).wrong)
    assert main(["regress", "--update", "--why", "hm", "--folder", str(case.parent)]) == 2
    assert "not the log of the case" in capsys.readouterr().err
    assert (case / "expected.json").read_bytes() == before


def test_too_few_updates_are_a_failure_and_never_become_a_reference(case: Path):
    text = (case / "case.toml").read_text(encoding="utf-8")
    (case / "case.toml").write_text(text.replace("floor = 500", "floor = 50000"), encoding="utf-8")

    assert any("floor" in line for line in check_case(Case.read(case)).wrong)
    assert main(["regress", "--update", "--why", "hm", str(case)]) == 2


def test_an_update_wants_a_reason_and_records_it_with_date_and_versions(case: Path, capsys):
    assert main(["regress", "--update", "--folder", str(case.parent)]) == 2
    assert main(["regress", "--update", "--why", " ", "--folder", str(case.parent)]) == 2
    (case / "expected.csv").unlink()
    assert main(["regress", "--folder", str(case.parent)]) == 1

    code = main(["regress", "--update", "--why", 'said "so"', "--folder", str(case.parent)])

    told = (case / "case.toml").read_text(encoding="utf-8").rpartition("[[updates]]")[2]
    assert code == 0
    assert 'why = "said \\"so\\""' in told
    assert "date = 20" in told
    assert "numpy " in told
    assert main(["regress", str(case)]) == 0


def test_checking_never_writes_a_reference(case: Path):
    for name in ("expected.csv", "expected.json"):
        (case / name).unlink()

    assert main(["regress", str(case)]) == 1
    assert not list(case.glob("expected.*"))


def test_json_tells_all_on_one_line(folder, capsys):
    bend(folder / "c172p_gcs_rates")
    assert main(["regress", "--json", "--workers", "1", "--folder", str(folder)]) == 1
    said = capsys.readouterr().out

    assert said.count("\n") == 1
    told = printed("regress", said)
    assert told["exit_code"] == 1
    first, second = told["cases"]
    assert (first["name"], first["ok"], second["ok"]) == ("c172p_gcs_rates", False, True)
    assert Path(first["files"]["actual"]).is_absolute()
    assert first["wrong"][0].startswith("wn: 1 of")


def test_junit_has_a_test_for_each_case_and_tells_why_one_failed(folder: Path, tmp_path: Path):
    bend(folder / "c172p_gcs_rates")
    (folder / "no_rudder" / "log.tlog").unlink()

    code = main(["regress", "--folder", str(folder), "--junit", str(tmp_path / "j.xml")])

    suite = ET.parse(tmp_path / "j.xml").getroot().find("testsuite")
    assert suite is not None
    assert code == 6
    assert [suite.get(name) for name in ("tests", "failures", "errors")] == ["2", "1", "1"]
    differing, unreadable = suite.findall("testcase")
    failure, error = differing.find("failure"), unreadable.find("error")
    assert failure is not None
    assert "wn: 1 of" in (failure.text or "")
    assert error is not None
    assert "does not exist" in (error.get("message") or "")


def test_junit_overwrites_an_earlier_result_and_no_other_file(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    write_junit(tmp_path / "j.xml", [Outcome("a", tmp_path, 0, ())])
    notes = tmp_path / "notes.txt"
    notes.write_text("<mine/>", encoding="utf-8")
    command = ["regress", "--folder", str(folder), "no_rudder", "--junit"]

    assert main([*command, str(notes)]) == 6
    assert capsys.readouterr().err == (
        f"yawid: {notes} exists and does not hold test results: choose another --junit\n"
    )
    assert notes.read_text(encoding="utf-8") == "<mine/>"
    assert main([*command, str(tmp_path / "j.xml")]) == 0
    assert 'name="no_rudder"' in (tmp_path / "j.xml").read_text(encoding="utf-8")


def test_junit_holds_whatever_a_log_puts_into_a_text(tmp_path: Path):
    wrong = ("\x00<script>&\x1b[31m\ud800\N{BELL}",)
    write_junit(tmp_path / "j.xml", [Outcome("a<b", tmp_path, 1, wrong)])

    case = ET.parse(tmp_path / "j.xml").getroot().find("testsuite/testcase")
    assert case is not None
    assert case.get("name") == "a<b"
    assert "<script>&" in (case.findtext("failure") or "")


def test_one_broken_case_does_not_keep_the_others_from_being_told(folder: Path):
    text = (folder / "c172p_gcs_rates" / "case.toml").read_text(encoding="utf-8")
    changed = text.replace("[options]", "[options]\nrate = 90", 1)
    (folder / "c172p_gcs_rates" / "case.toml").write_text(changed, encoding="utf-8")

    outcomes = list(regress(find_cases(folder, [])))

    assert [o.code for o in outcomes] == [2, 0]
    assert "--rate 90 is above the rate of the messages" in outcomes[0].wrong[0]


@pytest.mark.parametrize(
    "line",
    [
        "colour = 3",
        "floor = 'many'",
        "[tolerances]\nwn = -1.0",
        "[tolerances]\nwn = 'much'",
        "[tolerances]\nwm = 1.0",
        "[options]\nspeed = 3",
    ],
)
def test_a_case_that_says_what_is_no_case_is_refused(case: Path, line: str):
    text = (case / "case.toml").read_text(encoding="utf-8")
    head = text.partition("\n[options]")[0]
    (case / "case.toml").write_text(f"{head}\n{line}\n", encoding="utf-8")

    assert main(["regress", "--folder", str(case.parent)]) == 2


def test_no_case_at_all_is_a_usage_error(tmp_path: Path):
    assert main(["regress", "--folder", str(tmp_path)]) == 2
    assert main(["regress", "nosuch", "--folder", str(tmp_path)]) == 2


@pytest.mark.parametrize(
    "options",
    [
        ["--workers", "0"],
        ["--rate", "10"],
        ["--new", "a.tlog"],
        ["--name", "a"],
        ["--why", "a"],
        ["--update", "--why", "a", "--json"],
        ["--new", "a.tlog", "--name", "a", "--update", "--why", "b"],
    ],
)
def test_options_that_do_not_go_together_are_refused(case: Path, options: list[str]):
    assert main(["regress", "--folder", str(case.parent), *options]) == 2
