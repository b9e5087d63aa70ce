"""Two commits are compared bit by bit, and what differs is named."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cases.compare import answers, differences
from places import REPLAY_LOGS, ROOT


@pytest.mark.long
def test_another_answer_is_named_by_its_key_and_its_topic_and_the_same_is_not(
    tmp_path: Path,
) -> None:
    first = answers(ROOT, REPLAY_LOGS / "c172p_gcs_rates" / "log.tlog")
    case = Path(shutil.copytree(REPLAY_LOGS / "c172p_gcs_rates", tmp_path / "case"))
    toml = (case / "case.toml").read_text(encoding="utf-8")
    text = toml.replace("memory = inf", "memory = 60.0")
    (case / "case.toml").write_text(text, encoding="utf-8")

    named = dict(differences(first, answers(ROOT, case / "log.tlog")))

    assert "options.estimates.rml.dutch_roll.wn_rad_s" in named
    assert "options./yawid/estimate" in named
    assert not any(name.startswith("flight") for name in named)
    (case / "case.toml").unlink()
    assert answers(ROOT, case / "log.tlog") == {"flight": first["flight"]}


def test_what_differs_is_named_down_to_its_last_key_with_both_values() -> None:
    old = {"exit_code": 0, "flight": {"wn": 2.0, "reasons": [{"id": "a"}], "K": float("nan")}}
    new = {"exit_code": 5, "flight": {"wn": 2, "reasons": [{"id": "b"}, 3], "K": float("nan")}}

    assert dict(differences(old, new)) == {
        "exit_code": "0, 5",
        "flight.wn": "2.0, 2",
        "flight.reasons.0.id": "'a', 'b'",
        "flight.reasons.1": "None, 3",
    }
    assert not dict(differences(old, old))
