"""One flight through five doors: its tlog, a run's MCAP, the exported CSV and Parquet, a live link.

The samples are the same, so are manoeuvres and answers, to the bit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from finished_runs import replayed
from flights.surgery import split
from live_link import listening
from places import C172P

from yawid.answers.run_summary import RunSummary
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.sinks.mcap.reader import open_run


def answers(summary: RunSummary) -> dict[str, Any]:
    """Return manoeuvres, flight and verdicts, without the date: a live session flies today."""
    told = summary.to_json()
    for each in (told["flight"], *told["manoeuvres"]):
        each.pop("date", None)
    kept = ("manoeuvres", "flight", "estimates", "verdict")
    return {name: told[name] for name in kept}


@pytest.fixture(scope="module")
def through_the_tlog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("tlog"))


@pytest.mark.parametrize("door", ["csv", "parquet", "mcap"])
def test_a_flight_gives_the_same_answers_through_its_tables(
    door: str, through_the_tlog: Path, tmp_path: Path
) -> None:
    record = tmp_path / f"flight.{door}"
    if door == "mcap":
        record.write_bytes(through_the_tlog.read_bytes())
    else:
        assert main(["export", str(through_the_tlog), "-o", str(record)]) == 0

    again = open_run(replayed(record, tmp_path / "again")).summary

    assert answers(again) == answers(open_run(through_the_tlog).summary)
    assert again.flight is not None
    assert again.flight.verdict.usable


def test_a_flight_gives_the_same_answers_over_a_live_link(
    through_the_tlog: Path, tmp_path: Path
) -> None:
    with listening(tmp_path, RunConfig()) as session:
        session.fly([frame for _, frame in split(C172P.read_bytes())])

    [(summary, _)] = session.ended
    assert answers(summary) == answers(open_run(through_the_tlog).summary)
