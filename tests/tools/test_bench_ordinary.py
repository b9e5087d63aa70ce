"""The bench of ordinary flights: what it counts of an answer, and which criteria are missed."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bench import verdict as bench
from bench.frame import Row

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll

TRUTH: dict[str, Any] = {
    "aircraft": "T37", "severity": 1, "rate_hz": 25, "rudder": "mixed", "law": "px4",
    "frozen": True, "dutch_roll_open_loop": {"wn_rad_s": 2.0, "zeta": 0.2},
}  # fmt: skip
NAMED = {"log": "jsbsim", "number": 0, "name": "a"}
USABLE = Verdict(usable=True, reasons=[])
REFUSED = Verdict(usable=False, reasons=[Reason("too_short", "", "", "fatal")])


@pytest.fixture
def row_of(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The row of a log with this answer (wn, its sigma, zeta, its sigma) and this truth."""

    def row(*answer: float, verdict: Verdict = USABLE, **facts: Any) -> Row:
        names = "wn_rad_s", "wn_std", "zeta", "zeta_std"
        roll = DutchRoll(**dict(zip(names, answer, strict=True)))
        found = SimpleNamespace(ordinary=OrdinaryAnswer(dutch_roll=roll, verdict=verdict))
        monkeypatch.setattr(bench, "replayed", lambda *_: found)
        [found_row] = bench.ordinary_rows(Path(), TRUTH | facts)
        return NAMED | found_row

    return row


def test_a_hostile_answer_is_wrong_beyond_three_sigma_or_where_nothing_flies(row_of: Any) -> None:
    def is_wrong(*answer: float, **how: Any) -> bool:
        return bench.is_wrong(row_of(*answer, family="x", **how))

    assert not is_wrong(2.05, 0.02, 0.2, 0.01)
    assert is_wrong(2.07, 0.02, 0.2, 0.01)
    assert is_wrong(2.0, 0.02, 0.165, 0.01)
    assert is_wrong(2.0, 0.02, 0.2, 0.01, dutch_roll_open_loop=None)
    assert not is_wrong(2.07, 0.02, 0.2, 0.01, verdict=REFUSED)


def test_a_log_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    [row] = bench.ordinary_rows(tmp_path / "missing.tlog", dict(TRUTH))

    assert (row["usable"], row["fatal"]) == (False, "SourceError")


def test_each_criterion_is_missed_by_what_it_is_about(row_of: Any) -> None:
    good = [row_of(2.0 + 0.02 * (-1) ** i, 0.05, 0.2, 0.02) for i in range(30)]
    refused = [row_of(3.0, 0.02, 0.2, 0.01, verdict=REFUSED) for _ in range(11)]

    def missed(*more: Row, against: tuple[Row, ...] = ()) -> list[str]:
        said = bench.criteria([*good, *more], against)
        return [each.removeprefix("not met: ").replace(" ± 0,", ",") for each in said]

    assert refused[0]["fatal"] == "too_short"
    assert missed(*refused[:10]) == []
    assert missed(*refused) == ["answered %: mean: 73.2, limit 75"]
    assert missed(row_of(2.15, 0.05, 0.2, 0.02)) == ["wn: worst: 7.5, limit 7"]
    assert missed(row_of(2.0, 0.05, 0.28, 0.02)) == ["zeta: beyond: 1, limit 0"]
    narrow = [row_of(2.0, 0.05, 0.2 + 0.02 * (-1) ** i, 0.01) for i in range(30)]
    assert "zeta, all: z: 1.41, limit 1.3" in missed(*narrow)
    few = [row_of(2.0, 0.05, 0.23, 0.014, severity=3) for _ in range(19)]
    assert not any("severity 3" in each for each in missed(*few))
    assert "zeta, severity 3: in 2 sigma %: 0, limit 94" in missed(*few, few[0])
    lie = row_of(3.0, 0.02, 0.2, 0.01, family="a mirror")
    assert missed(against=(lie,)) == ["wrong: a mirror, a: wn 3, zeta 0.200"]
