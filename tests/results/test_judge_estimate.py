"""The verdict as a whole, on flights with a known truth and on logs that cannot answer."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from flightlog import summarised
from flights import quiet as corpus_quiet
from gate import one_in
from lined import lined as lined_flight

from yawid.config.run import RunConfig
from yawid.results.reasons import Verdict
from yawid.runs.choose_orders import with_orders
from yawid.runs.inspect_log import inspect
from yawid.runs.job import open_log

TRUE_WN = 1.287
"""By JSBSim's own linearisation at the mean speed flown, of the flight with the line."""


@pytest.fixture(scope="module")
def lined(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("lined") / "line.tlog"
    path.write_bytes(lined_flight().log)
    return path


def judged(log: Path, config: RunConfig) -> Verdict:
    return summarised(log, config)[1]


def test_a_line_on_the_gyro_is_no_dutch_roll_whatever_the_fit(lined: Path):
    """It was 15.2 rad/s, usable, with fits of 60 and 57 %."""
    stretch = RunConfig(rate=25.0, forgetting=1.0, from_s=35.0, to_s=148.0, manoeuvres="off")

    for config in (RunConfig(manoeuvres="off"), stretch):
        texts = {reason.id: reason.text for reason in judged(lined, config).reasons}
        assert "2.40 Hz" in texts["mode_not_driven"]
        assert "--band 0.0" in texts["mode_not_driven"]


@pytest.mark.slow
def test_choosing_the_orders_by_the_log_does_not_make_the_line_usable(lined: Path):
    with closing(open_log(lined, again=True)) as source:
        verdict = judged(lined, with_orders(source, RunConfig(orders="auto", manoeuvres="off")))

    assert "mode_not_driven" in {reason.id for reason in verdict.reasons}


@pytest.mark.slow
@pytest.mark.parametrize("given", [{}, {"orders": "auto"}], ids=["default", "auto"])
def test_a_second_try_finds_the_mode_below_the_line(lined: Path, given: dict[str, str]):
    with closing(open_log(lined, again=True)) as source:
        summary, verdict = summarised(lined, with_orders(source, RunConfig(**given)))

    assert verdict.usable
    assert summary.manoeuvres is not None
    first, second = (summary.manoeuvres[0].tries or [])[:2]
    assert "mode_not_driven" in first.reasons
    assert second.answers
    assert second.band_hz is not None
    assert second.band_hz[1] < 2.4
    assert summary.flight is not None
    assert summary.flight.dutch_roll is not None
    assert summary.flight.dutch_roll.wn_rad_s == pytest.approx(TRUE_WN, rel=0.03)


@pytest.mark.slow
def test_inspect_recommends_the_replay_whose_second_try_answers(lined: Path):
    report, verdict = inspect(lined, {})

    assert verdict.usable
    assert report.command == f"yawid replay {lined}"
    assert summarised(lined, RunConfig())[1] == verdict


REMEDY = RunConfig(forgetting=1.0, turn="remove", band=(0.15, 3.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", one_in(7, range(len(corpus_quiet.KINDS))), ids=list(corpus_quiet.KINDS)
)
def test_what_nobody_excited_is_not_usable(kind: int, tmp_path: Path):
    """One of each kind; tools/bench.py verdict judges fifteen of each."""
    log = tmp_path / "quiet.tlog"
    log.write_bytes(corpus_quiet.unexcited(kind).log)

    for config in (RunConfig(), RunConfig(forgetting=1.0), REMEDY):
        assert not judged(log, config).usable
