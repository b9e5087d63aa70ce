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
from places import C172P, REPLAY_LOGS

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


GAPS = REPLAY_LOGS / "c172p_gaps" / "log.tlog"
"""Four manoeuvres; between them samples are held, where the log has gaps."""
ALONE = ("--ordinary", "off", "--lateral", "off")
IN_RAD = ("--rudder-max-deg", "25")
"""What only Parquet says in its metadata: how far the rudder moves. Both say in which sense."""


@pytest.fixture(scope="module")
def through_the_tlog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(GAPS, tmp_path_factory.mktemp("tlog"), *ALONE, *IN_RAD)


@pytest.mark.parametrize("door", ["csv", "parquet", "mcap"])
def test_a_flight_gives_the_same_answers_through_its_tables(
    door: str, through_the_tlog: Path, tmp_path: Path
) -> None:
    record = tmp_path / f"flight.{door}"
    if door == "mcap":
        record.write_bytes(through_the_tlog.read_bytes())
    else:
        assert main(["export", str(through_the_tlog), "-o", str(record)]) == 0

    more = IN_RAD if door == "csv" else ()
    again, run = (
        open_run(each)
        for each in (replayed(record, tmp_path / "again", *ALONE, *more), through_the_tlog)
    )

    assert answers(again.summary) == answers(run.summary)
    assert again.summary.flight.verdict.usable
    assert (again.grid, len(again.summary.manoeuvres)) == (run.grid, 4)
    if door != "mcap":  # a table has no vehicle and no frames
        assert (again.summary.vehicle, again.summary.link.frames) == (None, None)


@pytest.mark.parametrize("log", [C172P, GAPS], ids=lambda log: log.parent.name)
def test_a_flight_gives_the_same_answers_over_a_live_link(log: Path, tmp_path: Path) -> None:
    """It flies a hundred times as fast as recorded, so that the times of reception are others."""
    with listening(tmp_path, RunConfig()) as session:
        session.fly([frame for _, frame in split(log.read_bytes())])

    [(summary, _)] = session.ended
    assert answers(summary) == answers(open_run(replayed(log, tmp_path / "log")).summary)
