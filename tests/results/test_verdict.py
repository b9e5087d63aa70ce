"""A run has one verdict: the flight's, or why the log has no answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flightlog import FlightLog, finished, fly, summarised
from flights import quiet as corpus_quiet
from gate import one_in
from places import C172P, REPLAY_LOGS
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.answers.run_summary import RunSummary
from yawid.config.run import RunConfig

OFF = RunConfig(manoeuvres="off")


def texts(summary: RunSummary) -> dict[str, str]:
    return {reason.id: reason.text for reason in summary.deciding.reasons}


def wings_level(
    seconds: float = 60.0,
    rudder: float = 0.0,
    aileron: float = 0.0,
    copies: float = 0.0,
    hz: float = 20.0,
    speed: float | None = None,
) -> FlightLog:
    """Return a log in which the rudder (servo 4) swings by itself, and copies the aileron."""
    log = FlightLog()
    log.heartbeat(10.0)
    for t in np.arange(10.0, 10.0 + seconds, 1.0 / hz).tolist():
        if speed is not None:
            log.add(t, mavlink.MAVLink_vfr_hud_message(speed, speed, 0, 50, 0.0, 0.0))
        stick = aileron * np.sin(1.3 * t) * np.cos(0.4 * t)
        own = rudder * np.sin(2.0 * t)
        log.attitude(t, 0.02 * np.sin(2.4 * t))
        pwm = [1500 + round(400 * stick), 1500, 1500, 1500 + round(400 * (own + copies * stick))]
        log.servos(t + 0.004, pwm)
    return log


def test_of_a_flight_the_verdict_is_the_flights_and_estimates_have_none() -> None:
    summary = summarised(C172P, RunConfig())

    assert summary.flight is not None
    assert summary.verdict == summary.flight.verdict
    assert summary.verdict.usable
    assert summary.exit_code == 0
    assert set(summary.estimates or {}) == {"els", "rml"}
    assert "verdict" not in summary.to_json()["estimates"]["els"]


def test_settings_of_the_stream_change_no_verdict() -> None:
    usual, other = (
        summarised(C172P, config)
        for config in (RunConfig(), RunConfig(memory=5.0, method="rml", also="none"))
    )

    assert usual.estimates != other.estimates
    assert usual.verdict == other.verdict


def test_without_a_search_for_manoeuvres_there_are_numbers_and_no_verdict() -> None:
    summary = summarised(C172P, OFF)

    assert summary.verdict is None
    assert "verdict" not in summary.to_json()
    assert (summary.exit_code, summary.deciding.word) == (0, "not judged")
    roll = summary.dutch_roll
    assert roll is not None
    assert roll.wn_rad_s == pytest.approx(2.404, rel=0.03)  # by JSBSim's own linearisation


def test_what_a_log_is_doubted_for_is_not_lost_where_nothing_is_judged() -> None:
    log = FlightLog()  # an ArduPilot plane without parameters: servo 4 is only assumed
    log.heartbeat(10.0)
    for t in np.arange(10.0, 40.0, 0.05).tolist():
        log.attitude(t, 0.1 * np.sin(t))
        log.servos(t, [1500, 1500, 1500, 1500 + round(100 * np.sin(2.0 * t))])
    summary = finished(log.data, OFF)

    assert summary.verdict is None
    assert [reason.id for reason in summary.warnings or []] == [
        "disarmed",
        "rudder_assumed",
    ]


@pytest.mark.parametrize("config", [RunConfig(), OFF], ids=["auto", "off"])
def test_a_log_without_rudder_or_yaw_is_refused_either_way(config: RunConfig) -> None:
    for case, id_ in (("no_rudder", "no_rudder"),):
        summary = summarised(REPLAY_LOGS / case / "log.tlog", config)
        assert summary.exit_code == 3
        assert summary.deciding.why == id_
    blind = FlightLog()
    blind.heartbeat(10.0)
    for t in np.arange(10.0, 40.0, 0.05).tolist():
        blind.servos(t, [1500] * 4)
    assert finished(blind.data, config).deciding.why == "no_yaw"


@pytest.mark.parametrize("config", [RunConfig(), OFF], ids=["auto", "off"])
def test_a_rate_below_5_hz_is_exit_4_either_way(config: RunConfig) -> None:
    summary = finished(wings_level(hz=3.0).data, config)

    assert summary.exit_code == 4
    assert "at least 5 Hz are needed" in texts(summary)["rate_too_low"]
    assert "SRn_EXTRA1" in str(summary.deciding.next)


def test_a_rudder_that_rests_is_not_excited_and_how_far_it_moved_is_said() -> None:
    summary = finished(wings_level(rudder=0.02).data)

    assert summary.exit_code == 5
    assert summary.flight is None
    said = texts(summary)["not_excited"]
    assert "within 5 s is 4.0 % of half its travel: at least 10 % is needed" in said


def test_a_rudder_that_copies_the_aileron_is_mixed() -> None:
    summary = finished(wings_level(aileron=0.5, copies=0.6).data)

    assert summary.exit_code == 5
    assert "the rudder follows the aileron" in texts(summary)["mixed_rudder"]
    assert "--card" in str(summary.deciding.next)


def test_a_log_on_the_ground_says_that_its_samples_are_held_and_how_to_take_them() -> None:
    summary = finished(wings_level(rudder=0.3, speed=0.5).data)

    assert summary.exit_code == 5
    assert "on ground" in texts(summary)["not_excited"]
    assert "--airborne all" in texts(summary)["not_excited"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", one_in(7, range(len(corpus_quiet.KINDS))), ids=list(corpus_quiet.KINDS)
)
def test_what_nobody_excited_is_not_usable(
    kind: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of each kind; tools/bench.py verdict judges fifteen of each."""
    unknown = {"dutch_roll": None, "dutch_roll_open_loop": None}  # a truth takes seconds
    monkeypatch.setattr("flights.fly.truth_lines", lambda *_: unknown)
    log = tmp_path / "quiet.tlog"
    log.write_bytes(corpus_quiet.unexcited(kind).log)

    assert not summarised(log, RunConfig()).deciding.usable


def test_a_log_in_which_nothing_could_be_estimated_is_refused_either_way() -> None:
    short = fly(lambda t: 0.1 * np.sin(2.0 * t), lambda t: 1500 + round(20 * t), 3.0)

    for config in (RunConfig(), OFF):
        summary = finished(short.data, config)
        assert summary.exit_code == 5
        assert summary.deciding.why == "not_excited"
