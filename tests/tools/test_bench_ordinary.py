"""The bench of ordinary flights: what it counts of an answer, and which criteria are missed."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bench import accuracy as bench
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


def test_the_cells_of_flights_and_of_hostile_logs_are_those_by_hand(row_of: Any) -> None:
    refused = row_of(3.0, 0.02, 0.2, 0.01, verdict=REFUSED, family="x")
    flights = [row_of(2.04, 0.025, 0.2, 0.01), row_of(1.98, 0.02, 0.23, 0.01), refused]

    # +2 and -1 %, 1.6 and -1 sigma; 0 and .03, 0 and 3 sigma
    assert bench.of_ordinary(flights) == {
        "flights": "3", "answered %": "67", "wn %": "1.50", "RMS": "1.58", "zeta RMS": "0.0212",
        "worst": "2.0 0.030", "z": "1.33 2.12", "in 2 sigma %": "100 50", "beyond 3.5": "0",
    }  # fmt: skip
    assert bench.against_us([row_of(2.07, 0.02, 0.2, 0.01, family="x"), refused]) == {
        "logs": 2, "refused": 1, "right": 0, "wrong": 1, "reasons of refusal": "too_short 1",
    }  # fmt: skip
