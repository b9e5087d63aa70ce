"""Records of linear aircraft through the whole tool: releases, several loops, untrue numbers."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from finished_runs import replayed
from flights.records import HZ, REST_S, SAID, Leg, record, release
from numpy.typing import NDArray
from places import C172P

import yawid
from yawid.answers.run_summary import Manoeuvre
from yawid.cli.main import main

SEED = 44
SLOW = {25: 0.503, 7: 0.595}
"""wn in rad/s of two of its releases, for which half a doublet lasts 6.2 and 5.3 s."""


def answered(columns: dict[str, Any]) -> Manoeuvre:
    [found] = yawid.replay(columns, **SAID).summary.manoeuvres or []
    return found


@pytest.mark.parametrize("hz", [10, 20, 50])
@pytest.mark.parametrize(("number", "rolls"), [(25, False), (7, True), (1, True), (22, True)])
def test_a_release_is_answered_at_every_rate(number: int, rolls: bool, hz: int) -> None:
    """Of .503, .595, 1.30 and 5.12 rad/s, with zeta .04 to .12 and noise to 3 % of the peak

    At .5 rad/s the rudder is held for 6.3 s to either side, longer than a rest.
    """
    columns, leg = release(SEED, number, hz, rolls=rolls)
    found = answered(columns)

    assert leg.wn == pytest.approx(SLOW.get(number, leg.wn), abs=0.001)
    assert found.verdict.usable
    assert REST_S - 2.0 <= found.from_s <= REST_S - 1.0
    roll = found.dutch_roll
    assert abs(roll.wn_rad_s - leg.wn) < 0.02 * leg.wn
    assert abs(roll.wn_rad_s - leg.wn) < 2.0 * (roll.wn_std or 0.0)
    assert abs(roll.zeta - leg.zeta) < 2.0 * (roll.zeta_std or 0.0)
    assert not any("clock" in reason.text for reason in found.verdict.reasons)


def late(rudder: NDArray[np.float64], rows: int) -> NDArray[np.float64]:
    return np.concatenate([np.zeros(rows), rudder[:-rows]])


@pytest.mark.parametrize("number", [4, pytest.param(6, marks=pytest.mark.long)])
def test_a_rudder_that_is_not_the_one_that_was_flown_is_refused(number: int) -> None:
    """Of 2.7 and 3.6 rad/s: the free decay alone has the right frequency"""
    columns, _ = release(SEED, number, 20, rolls=True)
    rudder = columns["rudder"]
    others = [release(SEED, number + 20, 20, rolls=True)[0]["rudder"], rudder[::-1]]

    assert answered(columns).verdict.usable
    for other in (*(np.resize(each, len(rudder)) for each in others), late(rudder, 8)):
        verdict = answered(columns | {"rudder": other}).verdict
        assert not verdict.usable
        assert "mode_not_driven" in {reason.id for reason in verdict.fatal}


def test_a_slow_mode_whose_rudder_is_late_by_a_twentieth_of_a_period_is_right_all_the_same() -> (
    None
):
    """0.4 s of 10.6 s, which a numerator explains: neither wn nor zeta is that of another mode."""
    columns, leg = release(SEED, 7, 20, rolls=True)
    found = answered(columns | {"rudder": late(columns["rudder"], 8)})

    roll = found.dutch_roll
    assert abs(roll.wn_rad_s - leg.wn) < 2.0 * (roll.wn_std or 0.0)
    assert abs(roll.zeta - leg.zeta) < 2.0 * (roll.zeta_std or 0.0)


BARE, ROLL = Leg(zeta=0.2), Leg(zeta=0.35, mode="FBWA", noise=0.02)
FLOWN = [BARE, ROLL, ROLL, BARE, ROLL]
"""The aircraft with its roll loop was flown more often, and is known less well."""


def test_the_headline_stays_where_its_own_manoeuvres_disagree() -> None:
    """Another loop, flown once, is usable, and is named as what can be used."""
    slow, fast = Leg(wn=4.0, mode="FBWA"), Leg(wn=6.0, mode="FBWA")
    flown = yawid.replay(record([slow, fast, BARE]), **SAID)

    loops = [(flight.loop, flight.verdict.usable) for flight in flown.flights]
    assert loops == [("with_roll_loop", False), ("airframe", True)]
    assert flown.flight.verdict.reasons[0].id == "manoeuvres_disagree"


def test_the_headline_is_the_loop_flown_most_and_terminal_and_page_have_both_by_their_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = record(FLOWN)
    log, page = tmp_path / "flight.csv", tmp_path / "flight.html"
    with log.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([columns, *zip(*columns.values(), strict=True)])
    asked = ["--units", "rad", "--rudder-unit", "half-travel", "--rudder-is", "commanded"]

    assert main(["replay", str(log), *asked, "--out", str(tmp_path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert main(["report", str(tmp_path / "flight.mcap"), "-o", str(page)]) == 0
    flown = yawid.load(tmp_path / "flight.mcap")

    loops = [(flight.loop, flight.used) for flight in flown.flights]
    assert loops == [("with_roll_loop", [2, 3, 5]), ("airframe", [1, 4])]
    assert flown.flight == flown.flights[0]
    first, other = (flight.dutch_roll for flight in flown.flights)
    assert first.wn_std > other.wn_std
    assert first.zeta == pytest.approx(ROLL.zeta, abs=3.0 * first.zeta_std)
    sentence = (
        page.read_text(encoding="utf-8").partition('class="headline">')[2].partition("</p>")[0]
    )
    for text, also in ((said, " also "), (sentence, " Also: ")):
        headline, _, rest = text.partition(also)
        assert "the aircraft with its roll loop" in headline
        assert "for the airframe, at 20.0 m/s" in rest


GRAVITY = 9.80665
TURN_S = 12
"""Seconds of a turn at the end of a leg, to the right and to the left in turn."""
BANK = math.radians(25.0)


def turning(true_m_s: float, reported_m_s: float, slip: float = 1.0) -> dict[str, Any]:
    """Return a record on one heading but for short turns, in still air without a ground speed.

    In a turn the yaw angle goes by g tan(bank) / V, over ``slip``. wn is 6 rad/s.
    """
    legs = [Leg(seconds=36.0)] * 3
    columns = record(legs, seed=3)
    n = len(columns["t"]) // len(legs)
    turns = np.arange(n) >= n - TURN_S * HZ
    bank: NDArray[np.float64] = BANK * np.concatenate([turns * side for side in (1, -1, 1)])
    rng = np.random.default_rng(4)
    columns["roll"] = bank + 0.01 * rng.standard_normal(len(bank))
    columns["yaw"] = np.cumsum(GRAVITY * np.tan(bank) / true_m_s / slip) / HZ
    return columns | {"airspeed": np.full(len(bank), reported_m_s)}


def reasons_of(run: Any) -> dict[str, str]:
    return {reason.id: reason.text for reason in run.flight.verdict.reasons}


@pytest.mark.parametrize(("slip", "told"), [(1.0, 10.0), (0.95, 20.0), (1.0, 20.0), (1.5, 20.0)])
def test_a_right_airspeed_gives_kappa_whether_the_aircraft_slips_or_not_and_half_of_it_none(
    slip: float, told: float
) -> None:
    """The altitude is unknown too, so that a true airspeed may be above the equivalent one."""
    found = yawid.replay(turning(20.0, told, slip), **SAID)

    said = reasons_of(found).get("airspeed_implausible", "")
    assert ("bank and turn rate imply" in said) == (told == 10.0)
    assert found.flight.verdict.usable
    kappa = found.flight.kappa_rad_m
    assert (kappa is None) == (told == 10.0)
    assert kappa is None or kappa.value == pytest.approx(6.0 / 20.0, abs=2.0 * kappa.std)


@pytest.mark.parametrize(("factor", "warned"), [(1.0, False), (math.degrees(1.0), True)])
def test_a_yaw_rate_in_deg_s_that_was_read_as_rad_s_is_warned_of(factor: float, warned: bool):
    columns = record([Leg(), Leg()])
    found = yawid.replay(columns | {"r": factor * columns["r"]}, **SAID)

    assert ("deg/s" in reasons_of(found).get("unit_assumed", "")) == warned
    assert found.flight.verdict.usable


def test_a_log_that_was_appended_to_itself_counts_once(tmp_path: Path) -> None:
    (tmp_path / "twice.tlog").write_bytes(2 * C172P.read_bytes())
    once, again = (
        yawid.load(replayed(log, tmp_path / "out", "--to", 80))
        for log in (C172P, tmp_path / "twice.tlog")
    )

    assert again.summary.link.frames == 2 * once.summary.link.frames
    assert [each.n for each in again.summary.manoeuvres] == [1]
    assert again.flight.dutch_roll == once.flight.dutch_roll
    assert "repeated" not in reasons_of(once)
    [reason] = [each for each in again.flight.verdict.reasons if each.id == "repeated"]
    assert reason.weight == "warning"
