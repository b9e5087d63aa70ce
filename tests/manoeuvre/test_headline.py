"""Which aircraft is the headline where a flight was flown with and without a roll loop."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest
from flights.records import SAID, Leg, record

import yawid
from yawid.cli.main import main

BARE, ROLL = Leg(zeta=0.2), Leg(zeta=0.35, mode="FBWA", noise=0.02)
FLOWN = [BARE, ROLL, ROLL, BARE, ROLL]
"""The aircraft with its roll loop was flown more often, and is known less well."""


def test_the_headline_is_the_loop_in_which_most_manoeuvres_were_flown() -> None:
    flown = yawid.replay(record(FLOWN), **SAID)

    loops = [(flight.loop, flight.used) for flight in flown.flights]
    assert loops == [("with_roll_loop", [2, 3, 5]), ("airframe", [1, 4])]
    first, other = (flight.dutch_roll for flight in flown.flights)
    assert first.wn_std > other.wn_std
    assert first.zeta == pytest.approx(ROLL.zeta, abs=3.0 * first.zeta_std)
    assert flown.flight == flown.flights[0]


def test_of_as_many_manoeuvres_in_each_loop_the_longer_ones_are_the_headline() -> None:
    """A Dutch roll of 2 rad/s with less damping decays for longer: its manoeuvre lasts longer."""
    light, heavy = Leg(wn=2.0, zeta=0.1), Leg(wn=2.0, zeta=0.5)
    for legs, first in (((heavy, light), "with_roll_loop"), ((light, heavy), "airframe")):
        bare, closed = legs
        flown = yawid.replay(record([bare, replace(closed, mode="FBWA")]), **SAID)

        lasted_s = {m.loop: m.to_s - m.from_s for m in flown.summary.manoeuvres}
        assert max(lasted_s, key=lasted_s.__getitem__) == first
        assert flown.flight.loop == first


def test_the_headline_stays_where_its_own_manoeuvres_disagree() -> None:
    """Another loop, flown once, is usable, and is named as what can be used."""
    slow, fast = Leg(wn=4.0, mode="FBWA"), Leg(wn=6.0, mode="FBWA")
    flown = yawid.replay(record([slow, fast, BARE]), **SAID)

    loops = [(flight.loop, flight.verdict.usable) for flight in flown.flights]
    assert loops == [("with_roll_loop", False), ("airframe", True)]
    assert flown.flight.verdict.reasons[0].id == "manoeuvres_disagree"


def test_terminal_and_page_show_both_aircraft_with_their_names(
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

    with_loop, bare = "the aircraft with its roll loop", "the airframe"
    assert f"this is {with_loop}" in said
    assert f"for {bare}, at 20.0 m/s" in said.partition(" also ")[2]
    sentence = (
        page.read_text(encoding="utf-8").partition('class="headline">')[2].partition("</p>")[0]
    )
    assert with_loop in sentence.partition(" Also: ")[0]
    assert f"for {bare}, at 20.0 m/s" in sentence.partition(" Also: ")[2]
