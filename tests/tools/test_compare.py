"""Two commits are compared: bit by bit on a case, and by what counts of each log of a folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from cases.compare import answers, changed, comparison, differences, row_of
from places import REPLAY_LOGS, ROOT


@pytest.mark.long
def test_another_answer_is_named_by_its_key_and_its_topic_and_the_same_is_not(
    tmp_path: Path,
) -> None:
    first = answers(ROOT, REPLAY_LOGS / "c172p_gcs_rates")
    case = Path(shutil.copytree(REPLAY_LOGS / "c172p_gcs_rates", tmp_path / "case"))
    toml = (case / "case.toml").read_text(encoding="utf-8")
    text = toml.replace("forgetting = 1.0", "forgetting = 0.99999")
    (case / "case.toml").write_text(text, encoding="utf-8")

    named = {each.partition(":")[0] for each in differences(first, answers(ROOT, case))}

    assert "options.estimates.rml.dutch_roll.wn_rad_s" in named
    assert "options /yawid/estimate" in named
    assert not any(name.startswith("flight") for name in named)


def answered(
    wn: float, wn_std: float = 0.1, zeta: float = 0.2, code: int = 0, *reasons: str, used: int = 2
) -> dict[str, Any]:
    """The row of a flight with two manoeuvres, of which some are usable."""
    made = [{"verdict": {"usable": n < used}} for n in range(2)]
    said = {"usable": code == 0, "reasons": [{"id": reason} for reason in reasons]}
    roll = {"wn_rad_s": wn, "wn_std": wn_std, "zeta": zeta, "zeta_std": 0.02}
    return row_of(code, {"flight": {"verdict": said, "dutch_roll": roll}, "manoeuvres": made})


@pytest.mark.parametrize(
    ("new", "ways", "said"),
    [
        # a step of .005 is .05 of the sigma .1 and .25 % of 2; one of .05 is .5 and 2.5 %
        (answered(2.005), {"wn moved by at most 0.1 sigma"}, "+0.25 %, 0.05 sigma"),
        (answered(2.05), {"wn moved by at most 1 sigma"}, "+2.50 %, 0.50 sigma"),
        (answered(2.0, zeta=0.15), {"zeta moved more"}, "-25.00 %, 2.50 sigma"),
        (answered(2.0, 0.2), {"wn moved by at most 0.1 sigma"}, "(2.0, 0.1) to (2.0, 0.2)"),
        (
            answered(2.0, 0.1, 0.2, 5),
            {"wn came or went", "zeta came or went", "other exit code"},
            "exit code 0 to 5",
        ),
        (answered(2.0, 0.1, 0.2, 0, "rate_low"), {"other reasons"}, "none to rate_low"),
        (answered(2.0, used=1), {"other usable of manoeuvres"}, "(2, 2) to (1, 2)"),
    ],
)
def test_a_changed_answer_is_counted_by_its_kind_and_said(
    new: dict[str, Any], ways: set[str], said: str
) -> None:
    old = answered(2.0)
    found = {"a.tlog": list(changed(old, new)), "b.tlog": list(changed(old, answered(2.0)))}

    head, _, none, *counts, blank, named = comparison(found)

    assert (head, none, blank) == ("| change | logs |", "| none | 1 |", "")
    assert set(counts) == {f"| {way} | 1 |" for way in ways}
    assert named.startswith("a.tlog: ")
    assert said in named
