"""A case: what is noticed, what an update writes and what it refuses."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from case_compare import read_csv
from log_cases import Case, check, update
from places import REPLAY_LOGS as CASES

import yawid

TWO_LINES = 'origin = "ours"\nlicence = "MIT"\n'


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case of a log, two lines and an option, whose references this very code wrote."""
    folder = tmp_path_factory.mktemp("made") / "mine"
    folder.mkdir()
    shutil.copy(CASES / "c172p_gcs_rates" / "log.tlog", folder)
    options = '[options]\nmanoeuvres = "off"\n'
    (folder / "case.toml").write_text(f"{TWO_LINES}{options}", encoding="utf-8")
    update(Case.read(folder), 'said "so"')
    return folder


@pytest.fixture
def case(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / made.name))


def read(case: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((case / "flight.json").read_text(encoding="utf-8"))
    return found


def test_an_update_makes_a_case_of_a_log_with_the_answer_of_a_replay_and_the_reason(
    made: Path,
) -> None:
    answer, found = yawid.replay(made / "log.tlog").summary.to_json(), read(made)

    assert found["exit_code"] == 0
    assert answer["flight"]["dutch_roll"] == found["flight"]["dutch_roll"]
    rolls = [of["manoeuvres"][0]["estimates"]["rml"]["dutch_roll"] for of in (answer, found)]
    assert rolls[0] == rolls[1]
    assert "text" not in str(found)
    told = (made / "case.toml").read_text(encoding="utf-8")
    assert 'why = "said \\"so\\""' in told
    assert "date = 20" in told
    assert "numpy " in told
    assert Case.read(made).settings["floor"] > 100


def test_the_options_of_the_second_replay_are_those_of_flight(case: Path) -> None:
    toml = (case / "case.toml").read_text(encoding="utf-8")
    (case / "case.toml").write_text(f'{toml}\n[flight]\nmanoeuvres = "off"\n', encoding="utf-8")

    assert "summary.flown.manoeuvres: only in the reference" in check(Case.read(case))


def test_what_differs_is_said_and_drawn_alike_each_time_and_goes_when_it_matches(
    case: Path, made: Path
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
    changed = {name: x for name, x in found.items() if name != "bare"} | {"exit_code": 3}
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
    assert b"mine: expected and actual" in picture
    check(Case.read(case))
    assert (case / "actual.svg").read_bytes() == picture

    shutil.copytree(made, case, dirs_exist_ok=True)
    assert check(Case.read(case)) == []
    assert not list(case.glob("actual.*"))


def test_another_log_too_few_updates_and_no_reason_are_noticed_and_never_become_references(
    case: Path,
) -> None:
    (case / "expected.json").unlink()
    toml = (case / "case.toml").read_text(encoding="utf-8")
    with (case / "log.tlog").open("ab") as log:
        log.write(b"\0")
    (case / "case.toml").write_text(re.sub(r"floor = \d+", "floor = 50000", toml), encoding="utf-8")
    changed = Case.read(case)

    other, few, missing = check(changed)
    assert "is not the log of the case" in other
    assert "below the floor of 50000" in few
    assert missing == "no reference expected.json: --update-cases WHY writes it"
    for why, said in ((" ", "needs a reason"), ("hm", "is not the log of the case")):
        with pytest.raises(AssertionError, match=said):
            update(changed, why)
    assert not (case / "expected.json").exists()


@pytest.mark.parametrize(
    "line", ['orders = "3,3,2,1"', "tolerances = 3", 'options = "fast"', "floor = 3.5"]
)
def test_two_lines_are_a_case_and_what_says_more_than_a_case_has_is_refused(
    line: str, tmp_path: Path
) -> None:
    (tmp_path / "case.toml").write_text(TWO_LINES, encoding="utf-8")
    assert Case.read(tmp_path).settings.keys() == {"origin", "licence"}
    (tmp_path / "case.toml").write_text(f"{TWO_LINES}{line}\n", encoding="utf-8")
    with pytest.raises((AssertionError, ValueError)):
        Case.read(tmp_path)
