"""The bench of ordinary flights: what it counts of an answer, and which criteria are missed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from bench import ordinary as bench
from checks.judge import Row
from flights.fly import Made

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll
from yawid.errors import SourceError

BARE = {"wn_rad_s": 2.0, "zeta": 0.2}
TRUTH: dict[str, Any] = {
    "aircraft": "T37", "severity": 1, "rate_hz": 25, "rudder": "mixed", "law": "px4",
    "frozen": True,
}  # fmt: skip
USABLE = Verdict(usable=True, reasons=[])
REFUSED = Verdict(usable=False, reasons=[Reason("too_short", "", "", "fatal")])


@pytest.fixture
def row_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The row of a log with this answer (wn, its sigma, zeta, its sigma) and this truth."""

    def row(*answer: float, bare: Any = BARE, verdict: Verdict = USABLE, **facts: Any) -> Row:
        number = len(list(tmp_path.glob("*.json")))
        log = "hostile" if "family" in facts else "JSBSim"
        truth = TRUTH | facts | {"dutch_roll_open_loop": bare}
        monkeypatch.setitem(bench.MAKERS, log, lambda *_: Made(b"", truth))
        roll = DutchRoll(
            **dict(zip(("wn_rad_s", "wn_std", "zeta", "zeta_std"), answer, strict=True))
        )
        found = OrdinaryAnswer(dutch_roll=roll, verdict=verdict)
        monkeypatch.setattr(bench, "ordinary_of_log", lambda path: found)
        [found_row] = bench.rows_of(2000, 900.0, tmp_path, (log, number))
        return found_row

    return row


def test_a_hostile_answer_is_wrong_beyond_three_sigma_or_where_nothing_flies(row_of: Any) -> None:
    def is_wrong(*answer: float, **how: Any) -> bool:
        return bench.is_wrong(row_of(*answer, family="x", **how))

    assert not is_wrong(2.05, 0.02, 0.2, 0.01)
    assert is_wrong(2.07, 0.02, 0.2, 0.01)
    assert is_wrong(2.0, 0.02, 0.165, 0.01)
    assert is_wrong(2.0, 0.02, 0.2, 0.01, bare=None)
    assert not is_wrong(2.07, 0.02, 0.2, 0.01, verdict=REFUSED)


def test_a_log_that_cannot_be_read_is_refused(
    row_of: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row_of(2.0, 0.02, 0.2, 0.01)

    def fails(path: Path) -> None:
        raise SourceError("no attitude")

    monkeypatch.setattr(bench, "ordinary_of_log", fails)
    [row] = bench.rows_of(2000, 900.0, tmp_path, ("JSBSim", 0))

    assert not row["usable"]
    assert row["fatal"] == "SourceError"


def test_each_criterion_is_missed_by_what_it_is_about(row_of: Any) -> None:
    good = [row_of(2.0 + 0.02 * (-1) ** i, 0.05, 0.2, 0.02) for i in range(30)]
    refused = [row_of(3.0, 0.02, 0.2, 0.01, verdict=REFUSED) for _ in range(11)]

    def missed(*more: Row, against: tuple[Row, ...] = ()) -> str:
        return "; ".join(bench.missed([*good, *more], list(against)))

    assert missed(*refused[:10]) == ""
    assert missed(*refused) == "% refused 26.8"
    assert missed(row_of(2.15, 0.05, 0.2, 0.02)) == "wn off by 7.5"
    assert missed(row_of(2.0, 0.05, 0.28, 0.02)) == "z of zeta up to 4"
    narrow = [row_of(2.0, 0.05, 0.2 + 0.02 * (-1) ** i, 0.01) for i in range(30)]
    assert "z of zeta, all 1.41" in missed(*narrow)
    few = [row_of(2.0, 0.05, 0.23, 0.014, severity=3) for _ in range(19)]
    assert "severity 3" not in missed(*few)
    assert "% of zeta in 2 sigma, severity 3 -0" in missed(*few, few[0])
    lie = row_of(3.0, 0.02, 0.2, 0.01, family="a")
    assert missed(against=(lie,)) == "false answers 1"
