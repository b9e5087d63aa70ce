"""A case: what is noticed, what an update writes and what it refuses."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from case_compare import read_csv
from log_cases import Case, check, update
from places import REPLAY_LOGS as CASES

import yawid


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


def test_an_update_writes_the_answer_of_a_replay_with_the_default_options(updated: Path) -> None:
    answer, found = yawid.replay(updated / "log.tlog").summary.to_json(), read(updated)

    assert found["exit_code"] == 0
    assert answer["flight"]["dutch_roll"] == found["flight"]["dutch_roll"]
    rolls = [of["manoeuvres"][0]["estimates"]["rml"]["dutch_roll"] for of in (answer, found)]
    assert rolls[0] == rolls[1]
    assert "text" not in str(found)


def test_the_options_of_the_second_replay_are_those_of_flight(case: Path) -> None:
    toml = (case / "case.toml").read_text(encoding="utf-8")
    (case / "case.toml").write_text(f'{toml}\n[flight]\nmanoeuvres = "off"\n', encoding="utf-8")

    assert "summary.flown.manoeuvres: only in the reference" in check(Case.read(case))


def test_what_differs_is_said_and_drawn_alike_each_time_and_goes_when_it_matches(
    case: Path, updated: Path
) -> None:
    header, *rows = (case / "expected.csv").read_text(encoding="utf-8").splitlines()
    last = rows[-1].split(",")
    last[header.split(",").index("wn")] = "9.5"
    bent = "\n".join([header, *rows[:-1], ",".join(last), ""])
    (case / "expected.csv").write_text(bent, encoding="utf-8")
    found = read(case)
    first, flight = found["manoeuvres"][0], found["flight"]
    first["estimates"]["rml"]["dutch_roll"]["zeta"] *= 1.0001
    first["verdict"]["reasons"].append({"id": "turns_in_record", "weight": "warning"})
    flight["dutch_roll"]["wn_std"] *= 1.1
    changed = found | {"exit_code": 3, "bare": {"verdict": {"usable": False}}}
    (case / "flight.json").write_text(json.dumps(changed), encoding="utf-8")

    line, *of_flight = check(Case.read(case))
    picture = (case / "actual.svg").read_bytes()
    assert line.startswith("wn: 1 of")
    assert sorted(line.partition(": ")[0] for line in of_flight) == [
        "summary.flown.bare",
        "summary.flown.exit_code",
        "summary.flown.flight.dutch_roll.wn_std",
        "summary.flown.manoeuvres[0].estimates.rml.dutch_roll.zeta",
        "summary.flown.manoeuvres[0].verdict.reasons",
    ]
    columns, rows = read_csv(case / "actual.csv")
    assert columns == header.split(",")
    assert len(rows) == len(read_csv(case / "expected.csv")[1])
    assert b"c172p_gcs_rates: expected and actual" in picture
    check(Case.read(case))
    assert (case / "actual.svg").read_bytes() == picture

    shutil.copytree(updated, case, dirs_exist_ok=True)
    assert check(Case.read(case)) == []
    assert not list(case.glob("actual.*"))


def test_another_log_and_too_few_updates_are_noticed_and_never_become_references(
    case: Path,
) -> None:
    before = (case / "expected.json").read_bytes()
    toml = (case / "case.toml").read_text(encoding="utf-8")
    with (case / "log.tlog").open("ab") as log:
        log.write(b"\0")
    (case / "case.toml").write_text(toml.replace("floor = 500", "floor = 50000"), encoding="utf-8")
    changed = Case.read(case)

    other, few = changed.unsound(changed.replay())
    assert "is not the log of the case" in other
    assert "below the floor of 50000" in few
    with pytest.raises(AssertionError, match="is not the log of the case"):
        update(changed, "hm")
    assert (case / "expected.json").read_bytes() == before


def test_a_folder_with_a_log_and_two_lines_becomes_a_case_that_matches(tmp_path: Path) -> None:
    case = tmp_path / "mine"
    case.mkdir()
    shutil.copy(CASES / "c172p_gcs_rates" / "log.tlog", case / "log.tlog")
    (case / "case.toml").write_text('origin = "ours"\nlicence = "MIT"\n', encoding="utf-8")
    with pytest.raises(AssertionError, match="needs a reason"):
        update(Case.read(case), " ")
    (line,) = check(Case.read(case))
    names = "expected.csv, expected.json, flight.json"
    assert line == f"no reference {names}: --update-cases WHY writes it"

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
