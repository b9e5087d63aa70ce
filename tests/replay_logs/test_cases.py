"""A case: what is noticed, what an update writes and what it refuses."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from case_table import read_csv
from log_cases import Case, check, update
from places import REPLAY_LOGS as CASES

from yawid.cli.main import main

NAMES = sorted(path.parent.name for path in CASES.glob("*/case.toml"))


@pytest.fixture(scope="module")
def updated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case whose references this very code wrote."""
    folder = tmp_path_factory.mktemp("updated") / "c172p_gcs_rates"
    shutil.copytree(CASES / folder.name, folder)
    (folder / "flight.json").unlink()
    update(Case.read(folder), "a test")
    return folder


@pytest.fixture
def case(updated: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(updated, tmp_path / updated.name))


def read(case: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((case / "flight.json").read_text(encoding="utf-8"))
    return found


def test_an_update_writes_the_answer_of_a_replay_with_the_default_options(
    case: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(case / "log.tlog")
    code = main(["replay", log, "--out", str(tmp_path / "run"), "--json"])
    answer = json.loads(capsys.readouterr().out)

    found = read(case)

    assert found["exit_code"] == code == 0
    rolls = [
        (of["manoeuvres"][0]["estimates"]["rml"]["dutch_roll"], of["flight"]["dutch_roll"])
        for of in (answer, found)
    ]
    assert rolls[0] == rolls[1]
    assert "text" not in str(found)


@pytest.mark.parametrize(
    ("keys", "change"),
    [
        (("manoeuvres", 0, "estimates", "rml", "dutch_roll", "zeta"), lambda old: old * 1.0001),
        (("flight", "dutch_roll", "wn_std"), lambda old: old * 1.1),
        (("manoeuvres", 0, "verdict", "reasons"), lambda old: [*old, {"id": "turns_in_record"}]),
        (("exit_code",), lambda old: 3),
        (("bare",), lambda old: {"verdict": {"usable": False}}),
    ],
)
def test_a_changed_answer_is_noticed(
    keys: tuple[Any, ...], change: Callable[[Any], Any], case: Path
) -> None:
    found = inner = read(case)
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = change(inner.get(keys[-1]))
    (case / "flight.json").write_text(json.dumps(found), encoding="utf-8")

    named = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    assert any(f"summary.flown{named}:" in line for line in check(Case.read(case)))


@pytest.mark.parametrize("name", ["expected.csv", "expected.json", "flight.json"])
def test_a_case_without_a_reference_does_not_match_and_none_is_written(
    name: str, case: Path
) -> None:
    (case / name).unlink()

    [line] = check(Case.read(case))
    assert line == f"no reference {name}: --update-cases WHY writes it"
    assert not (case / name).exists()


def test_the_options_of_the_second_replay_are_those_of_flight(case: Path) -> None:
    toml = (case / "case.toml").read_text(encoding="utf-8")
    (case / "case.toml").write_text(f'{toml}\n[flight]\nmanoeuvres = "off"\n', encoding="utf-8")

    assert "summary.flown.manoeuvres: only in the reference" in check(Case.read(case))


def test_every_case_has_the_answer_and_two_the_bare_airframe() -> None:
    found = {name: read(CASES / name) for name in NAMES}

    assert {name for name, each in found.items() if not each.get("manoeuvres")} == {
        "no_rudder",
        "sitl_auto",
        "turns_calm",
        "turns_gusts",
    }
    assert {each["exit_code"] for each in found.values()} == {0, 3, 5}
    assert {name for name, each in found.items() if "bare" in each} == {
        "sitl_fbwa_50hz",
        "sitl_fbwa_stock_33hz",
    }


def bend(case: Path, column: str = "wn") -> None:
    """Change one value of the reference."""
    header, *rows = (case / "expected.csv").read_text(encoding="utf-8").splitlines()
    i = header.split(",").index(column)
    last = rows[-1].split(",")
    last[i] = f"{float(last[i]) + 0.5:.9g}"
    text = "\n".join([header, *rows[:-1], ",".join(last)]) + "\n"
    (case / "expected.csv").write_text(text, encoding="utf-8")


def test_what_differs_is_said_and_drawn_alike_each_time_and_goes_when_it_matches(
    case: Path,
) -> None:
    reference = (case / "expected.csv").read_bytes()
    assert check(Case.read(case)) == []
    bend(case)

    [line] = check(Case.read(case))
    picture = (case / "actual.svg").read_bytes()
    assert line.startswith("wn: 1 of")
    columns, rows = read_csv(case / "actual.csv")
    assert columns == read_csv(case / "expected.csv")[0]
    assert len(rows) == len(read_csv(case / "expected.csv")[1])
    assert ET.fromstring(picture).tag.endswith("svg")
    assert b"c172p_gcs_rates: expected and actual" in picture
    check(Case.read(case))
    assert (case / "actual.svg").read_bytes() == picture

    (case / "expected.csv").write_bytes(reference)
    assert check(Case.read(case)) == []
    assert not list(case.glob("actual.*"))


def test_another_log_and_too_few_updates_are_noticed_and_never_become_references(
    case: Path,
) -> None:
    before = (case / "expected.json").read_bytes()
    toml = (case / "case.toml").read_text(encoding="utf-8")
    log = (case / "log.tlog").read_bytes()
    (case / "log.tlog").write_bytes(log + b"\0")
    assert any("is not the log of the case" in line for line in check(Case.read(case)))
    with pytest.raises(AssertionError, match="is not the log of the case"):
        update(Case.read(case), "hm")
    (case / "log.tlog").write_bytes(log)
    (case / "case.toml").write_text(toml.replace("floor = 500", "floor = 50000"), encoding="utf-8")
    with pytest.raises(AssertionError, match="below the floor of 50000"):
        update(Case.read(case), "hm")
    assert (case / "expected.json").read_bytes() == before


def test_a_folder_with_a_log_and_two_lines_becomes_a_case_that_matches(tmp_path: Path) -> None:
    case = tmp_path / "mine"
    case.mkdir()
    shutil.copy(CASES / "c172p_gcs_rates" / "log.tlog", case / "log.tlog")
    (case / "case.toml").write_text('origin = "ours"\nlicence = "MIT"\n', encoding="utf-8")
    with pytest.raises(AssertionError, match="needs a reason"):
        update(Case.read(case), " ")

    update(Case.read(case), 'said "so"')

    told = (case / "case.toml").read_text(encoding="utf-8")
    assert 'why = "said \\"so\\""' in told
    assert "date = 20" in told
    assert "numpy " in told
    assert Case.read(case).settings["floor"] > 100
    assert check(Case.read(case)) == []


@pytest.mark.parametrize(
    "line", ['orders = "3,3,2,1"', "tolerances = 3", 'options = "fast"', "floor = 3.5"]
)
def test_a_case_that_says_what_is_no_case_is_refused(case: Path, line: str) -> None:
    toml = (case / "case.toml").read_text(encoding="utf-8")
    key = line.partition(" ")[0]
    kept = [each for each in toml.splitlines() if not each.startswith(f"{key} ")]
    (case / "case.toml").write_text("\n".join([line, *kept]), encoding="utf-8")
    with pytest.raises((AssertionError, ValueError)):
        Case.read(case)
