"""``flight.json``: what a case's log answers with the default options is a reference, too."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from places import REPLAY_LOGS as CASES

from yawid.cli.main import main

NAMES = sorted(path.parent.name for path in CASES.glob("*/case.toml"))


@pytest.fixture(scope="module")
def updated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case whose references this very code wrote."""
    folder = tmp_path_factory.mktemp("updated") / "c172p_gcs_rates"
    shutil.copytree(CASES / folder.name, folder)
    (folder / "flight.json").unlink()
    assert main(["regress", str(folder), "--update", "--why", "a test"]) == 0
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


def of_manoeuvre(found: dict[str, Any]) -> None:
    found["manoeuvres"][0]["estimates"]["rml"]["dutch_roll"]["zeta"] *= 1.0001


def of_sigma(found: dict[str, Any]) -> None:
    found["flight"]["dutch_roll"]["wn_std"] *= 1.1


def of_verdict(found: dict[str, Any]) -> None:
    reasons = found["manoeuvres"][0]["verdict"]["reasons"]
    reasons.append({"id": "turns_in_record", "weight": "warning"})


def of_exit_code(found: dict[str, Any]) -> None:
    found["exit_code"] = 3


def of_bare(found: dict[str, Any]) -> None:
    found["bare"] = {"verdict": {"usable": False}}


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (of_manoeuvre, "flown.manoeuvres[0].estimates.rml.dutch_roll.zeta"),
        (of_sigma, "flown.flight.dutch_roll.wn_std"),
        (of_verdict, "flown.manoeuvres[0].verdict.reasons"),
        (of_exit_code, "flown.exit_code"),
        (of_bare, "flown.bare"),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_a_changed_answer_is_noticed(
    change: Callable[[dict[str, Any]], None],
    named: str,
    case: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = read(case)
    change(found)
    (case / "flight.json").write_text(json.dumps(found), encoding="utf-8")

    assert main(["regress", str(case)]) == 1

    assert f"summary.{named}:" in capsys.readouterr().out


def test_a_case_without_flight_json_does_not_match(
    case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (case / "flight.json").unlink()

    assert main(["regress", str(case)]) == 1
    assert "flight.json" in capsys.readouterr().out


def test_the_options_of_the_second_replay_are_those_of_flight(
    case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    toml = (case / "case.toml").read_text(encoding="utf-8")
    (case / "case.toml").write_text(f'{toml}\n[flight]\nmanoeuvres = "off"\n', encoding="utf-8")

    assert main(["regress", str(case)]) == 1

    assert "summary.flown.manoeuvres: only in the reference" in capsys.readouterr().out


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
