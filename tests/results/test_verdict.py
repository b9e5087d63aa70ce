"""A run has one verdict, the flight's or why there is none; reasons are true of the record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flightlog import FlightLog, finished, summarised
from flights import quiet as corpus_quiet
from flights.records import SAID, Leg, record
from gate import one_in
from places import C172P, REPLAY_LOGS
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import yawid
from yawid.config.run import RunConfig

AUTO, OFF = RunConfig(), RunConfig(manoeuvres="off")


def wings_level(
    seconds: float = 60.0,
    rudder: float = 0.0,
    aileron: float = 0.0,
    copies: float = 0.0,
    hz: float = 20.0,
    speed: float | None = None,
    yaw: bool = True,
) -> bytes:
    """Return a log in which the rudder (servo 4) swings by itself, and copies the aileron."""
    log = FlightLog()
    log.heartbeat(10.0)
    for t in np.arange(10.0, 10.0 + seconds, 1.0 / hz).tolist():
        if speed is not None:
            log.add(t, mavlink.MAVLink_vfr_hud_message(speed, speed, 0, 50, 0.0, 0.0))
        stick = aileron * np.sin(1.3 * t) * np.cos(0.4 * t)
        if yaw:
            log.attitude(t, 0.02 * np.sin(2.4 * t))
        own = rudder * np.sin(2.0 * t) + copies * stick
        log.servos(t + 0.004, [1500 + round(400 * stick), 1500, 1500, 1500 + round(400 * own)])
    return log.data


def test_of_a_flight_the_verdict_is_the_flights_whatever_the_settings_of_the_stream() -> None:
    other = RunConfig(memory=5.0, method="rml", also="none")
    usual, changed = (summarised(C172P, config) for config in (AUTO, other))

    assert usual.verdict == usual.flight.verdict == changed.verdict
    assert usual.verdict.usable
    assert usual.exit_code == 0
    assert set(usual.estimates) == {"els", "rml"}
    assert usual.estimates != changed.estimates
    assert "verdict" not in usual.to_json()["estimates"]["els"]


def test_without_a_search_for_manoeuvres_there_are_numbers_and_no_verdict() -> None:
    summary = summarised(C172P, OFF)

    assert summary.verdict is None
    assert "verdict" not in summary.to_json()
    assert (summary.exit_code, summary.deciding.word) == (0, "not judged")
    # By JSBSim's own linearisation.
    assert summary.dutch_roll.wn_rad_s == pytest.approx(2.404, rel=0.03)
    # An ArduPilot plane without parameters: servo 4 is only assumed.
    doubted = finished(wings_level(30.0, rudder=0.25), OFF)
    assert doubted.verdict is None
    assert [reason.id for reason in doubted.warnings] == ["disarmed", "rudder_assumed"]


@pytest.mark.parametrize(
    ("log", "configs", "code", "why", "says", "to_do"),
    [
        (REPLAY_LOGS / "no_rudder" / "log.tlog", (AUTO, OFF), 3, "no_rudder", "", ""),
        (wings_level(30.0, yaw=False), (AUTO, OFF), 3, "no_yaw", "", ""),
        (wings_level(hz=3.0), (AUTO, OFF), 4, "rate_too_low", "at least 5 Hz are needed",
         "SRn_EXTRA1"),
        (wings_level(3.0, rudder=0.02), (AUTO, OFF), 5, "not_excited", "", ""),
        (wings_level(rudder=0.02), (AUTO,), 5, "not_excited",
         "within 5 s is 4.0 % of half its travel: at least 10 % is needed", ""),
        (wings_level(aileron=0.5, copies=0.6), (AUTO,), 5, "mixed_rudder",
         "the rudder follows the aileron", "--card"),
        (wings_level(rudder=0.3, speed=0.5), (AUTO,), 5, "not_excited", "on ground", ""),
        (wings_level(rudder=0.3, speed=0.5), (AUTO,), 5, "not_excited", "--airborne all", ""),
    ],
    ids=["no rudder", "no yaw", "3 Hz", "short", "rests", "copies", "ground", "how to take it"],
)  # fmt: skip
def test_a_log_that_cannot_answer_is_refused_and_says_why_and_what_to_do(
    log: Path | bytes, configs: tuple[RunConfig, ...], code: int, why: str, says: str, to_do: str
) -> None:
    for config in configs:
        run = summarised if isinstance(log, Path) else finished
        summary = run(log, config)
        assert (summary.exit_code, summary.deciding.why, summary.flight) == (code, why, None)
        assert says in summary.deciding.reasons[0].text
        assert to_do in summary.deciding.next


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

    assert not summarised(log, AUTO).deciding.usable


@pytest.mark.parametrize("wn", [1.0, 2.0])
def test_a_slow_light_mode_that_is_right_is_not_said_to_be_of_another_rudder(wn: float) -> None:
    """A doublet, hands off, 50 Hz, noise of 3 % of the peak: wn and zeta are found to a percent."""
    leg = Leg(wn=wn, zeta=0.02 if wn == 1.0 else 0.03, unit_s=1.5 / wn, seconds=25.0 + 3.0 / wn)
    columns = record([leg], hz=50)
    rate = leg.yaw_rate(columns["rudder"], 50)
    noise = np.random.default_rng(1).standard_normal(len(rate))
    columns["r"] = rate + 0.03 * np.abs(rate).max() * noise

    [found] = yawid.replay(columns, **SAID, from_s=9.0).summary.manoeuvres

    assert found.dutch_roll.wn_rad_s == pytest.approx(wn, rel=0.01)
    assert found.dutch_roll.zeta == pytest.approx(leg.zeta, abs=0.002)
    assert not [r for r in found.verdict.reasons if "does not belong to this yaw rate" in r.text]
    assert found.verdict.usable


def test_a_movement_of_one_second_before_the_log_ends_does_not_decide() -> None:
    flown = yawid.replay(record([Leg(seconds=40.0, noise=0.3), Leg(seconds=11.0)]), **SAID)

    whole, *cut = flown.summary.manoeuvres
    assert not whole.verdict.usable
    assert all(each.to_s - each.from_s < 2.1 for each in cut)  # with the second of rest before
    for reason in flown.flight.verdict.reasons:
        assert not reason.text.startswith("manoeuvre 2, ")
