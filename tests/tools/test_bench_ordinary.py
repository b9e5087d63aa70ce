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


def cells(lines: Any, name: str) -> list[str]:
    [found] = [each for each in lines if each.startswith(f"| {name} |")]
    return found.strip("| ").split(" | ")[1:]


def test_the_figures_are_of_the_usable_answers_of_each_condition(row_of: Any) -> None:
    rows = [
        row_of(2.03, 0.02, 0.21, 0.01), row_of(1.98, 0.02, 0.20, 0.01, severity=0),
        row_of(3.0, 0.02, 0.4, 0.01, verdict=REFUSED),
    ]  # fmt: skip

    lines = list(bench.flight_lines(rows))

    assert cells(lines, "all") == [
        "3", "67", "1.25", "1.27", "0.0071", "1.5 0.010", "1.27 0.71", "100 100", "0",
    ]  # fmt: skip
    assert cells(lines, "severity 0")[:3] == ["1", "100", "1.00"]
    assert cells(lines, "severity 1")[:3] == ["2", "50", "1.50"]
    names = [each.split(" | ")[0].strip("| ") for each in lines[3:]]
    assert names == [
        "JSBSim", "severity 0", "severity 1", "25 Hz", "mixed", "px4", "frozen field", "T37",
    ]  # fmt: skip


def test_a_hostile_answer_is_wrong_beyond_three_sigma_or_where_nothing_flies(row_of: Any) -> None:
    def is_wrong(*answer: float, **how: Any) -> bool:
        return bench.is_wrong(row_of(*answer, family="x", **how))

    assert not is_wrong(2.05, 0.02, 0.2, 0.01)
    assert is_wrong(2.07, 0.02, 0.2, 0.01)
    assert is_wrong(2.0, 0.02, 0.165, 0.01)
    assert is_wrong(2.0, 0.02, 0.2, 0.01, bare=None)
    assert not is_wrong(2.07, 0.02, 0.2, 0.01, verdict=REFUSED)


def test_the_hostile_logs_are_counted_by_family_with_their_reasons(row_of: Any) -> None:
    rows = [
        row_of(2.0, 0.02, 0.2, 0.01, family="a"), row_of(3.0, 0.02, 0.2, 0.01, family="a"),
        row_of(3.0, 0.02, 0.2, 0.01, family="a", verdict=REFUSED),
        row_of(3.0, 0.2, 0.6, 0.1, bare={"wn_rad_s": 3.1, "zeta": 0.5}),
    ]  # fmt: skip

    lines = list(bench.hostile_lines(rows))

    assert cells(lines, "a") == ["3", "1", "1", "1", "too_short 1"]
    assert cells(lines, "zeta above 0.45")[:4] == ["1", "0", "1", "0"]
    assert lines[-1] == "wrong: a, hostile 1: wn 3, zeta 0.200"


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
