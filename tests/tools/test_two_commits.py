"""Two commits are compared bit by bit: the same tree gives the same, another answer is named."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from cases.two_commits import answers, differences
from places import REPLAY_LOGS, ROOT

pytestmark = pytest.mark.long  # it guards no run of yawid, and replays twelve times


@pytest.fixture(scope="module")
def first() -> dict[str, Any]:
    return answers(ROOT, REPLAY_LOGS / "c172p_gcs_rates")


def test_this_tree_gives_the_same_bits_twice(first: dict[str, Any]) -> None:
    again = answers(ROOT, REPLAY_LOGS / "c172p_gcs_rates")

    assert list(differences(first, again)) == []
    assert first["options.exit_code"] == first["flight.exit_code"] == 0
    assert {"options /yawid/estimate", "flight /yawid/sample"} <= set(first)


def test_another_answer_is_named_by_its_key_and_its_topic(
    first: dict[str, Any], tmp_path: Path
) -> None:
    case = Path(shutil.copytree(REPLAY_LOGS / "c172p_gcs_rates", tmp_path / "case"))
    toml = (case / "case.toml").read_text(encoding="utf-8")
    text = toml.replace("forgetting = 1.0", "forgetting = 0.99999")
    (case / "case.toml").write_text(text, encoding="utf-8")

    found = list(differences(first, answers(ROOT, case)))

    named = {each.partition(":")[0] for each in found}
    assert "options.estimates.rml.dutch_roll.wn_rad_s" in named
    assert "options /yawid/estimate" in named
    assert not any(name.startswith("flight") for name in named)


def test_the_replay_is_that_of_the_tree_asked_for(tmp_path: Path) -> None:
    package = tmp_path / "src" / "yawid"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("", encoding="utf-8")
    (package / "__main__.py").write_text("raise SystemExit(7)\n", encoding="utf-8")

    found = answers(tmp_path, REPLAY_LOGS / "no_rudder")

    assert found["options.exit_code"] == found["flight.exit_code"] == 7
