"""What a person is shown is the answer of the method that answers, and it says nothing absurd."""

from __future__ import annotations

import io
import re
from pathlib import Path

import hand_flights
import msgspec
import pytest
from finished_runs import replayed
from hand_flights import (
    flight,
    four_of_a_flight,
    manoeuvre,
    mixed_loops,
    none_usable,
    without_airspeed,
)
from hand_flights import summary as flight_summary
from places import C172P
from report_page import Page, first_screen

from yawid.answers.model_parts import Fit
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll, MethodSummary, RunSummary
from yawid.report.write import report
from yawid.sinks.answers import cards, headline, use
from yawid.sinks.mcap.reader import open_run
from yawid.sinks.pages import to_text
from yawid.sinks.run_page import print_summary, summary_page
from yawid.sinks.words import percent

LONG = (
    "the natural frequency went from 3.1 to 9.4 rad/s in the last third while its sigma was 0.02 "
    "rad/s; if it was flown differently there, as in a turn, choose a stretch by --from and --to"
)


def test_a_run_whose_manoeuvres_were_not_looked_for_is_shown_as_not_judged(tmp_path: Path) -> None:
    run = open_run(replayed(C172P, tmp_path, "--manoeuvres", "off"))
    roll = run.summary.estimates["els"].dutch_roll
    text = first_screen(report(run))
    assert "It was not judged." in text
    assert f"ωn {roll.wn_rad_s:.3f} rad/s ± {roll.wn_std:.3f}" in text
    out = io.StringIO()
    print_summary(run.summary, out)
    assert "verdict  not judged" in out.getvalue()
    assert "NOT USABLE" not in out.getvalue()
    assert to_text(summary_page(run.summary)).startswith("verdict  not judged\n")


def estimate(wn: float) -> MethodSummary:
    roll = DutchRoll(wn_rad_s=wn, wn_std=0.01, zeta=0.2, zeta_std=0.01)
    return hand_flights.estimate("els", roll)


def summary_of(reason: str | None = None) -> RunSummary:
    reasons = [Reason("not_converged", reason, weight="fatal")] if reason else []
    return hand_flights.plain_summary(
        estimates={"els": estimate(2.0), "rml": estimate(3.0)},
        verdict=Verdict.of(reasons),
    )


def test_without_a_flight_the_first_estimate_of_the_stream_is_shown() -> None:
    frequency = cards(summary_of())[0]
    assert frequency.answer == "2.000 rad/s"


def test_what_is_not_usable_is_said_so_on_its_card() -> None:
    assert [use(summary_of(reason)).answer for reason in (None, "it moved")] == ["Yes", "No"]


def test_the_headline_has_the_whole_reason_and_the_stretch_that_was_looked_at() -> None:
    said = headline(summary_of(LONG))
    assert said == f"This log cannot say how the yaw answers the rudder: {LONG}."
    part = headline(summary_of(LONG), (None, 61.5))
    assert part.startswith("This stretch of the log, to 61.5 s, cannot say how")


def test_a_refused_flight_names_what_of_it_can_be_used() -> None:
    fatal = Verdict(
        usable=False, reasons=[Reason("manoeuvres_disagree", "they disagree", weight="fatal")]
    )
    told = four_of_a_flight()
    refused = msgspec.structs.replace(told.flight, verdict=fatal, used=[])
    said = headline(msgspec.structs.replace(told, flight=refused, verdict=fatal))
    assert "By itself this can be used: manoeuvre 1 (35 to 67 s); manoeuvre 2 (" in said


def test_a_fit_of_an_exploding_model_is_no_number() -> None:
    out = io.StringIO()
    fits = Fit(one_step_pct=97.0, simulation_pct=-1000.0)
    exploded = msgspec.structs.replace(estimate(2.0), fit=fits)
    summary = msgspec.structs.replace(summary_of("it fits badly"), estimates={"els": exploded})
    print_summary(summary, out)
    assert out.getvalue().count("< -1000") == 1
    assert "e+" not in out.getvalue()
    assert percent(-999.0, ".0f") == "-999"


@pytest.mark.slow
def test_a_run_that_explodes_is_reported_without_a_warning_or_an_absurd_number(
    tmp_path: Path,
) -> None:
    options = ("--orders", "30,30,20,1", "--memory", "inf", "--method", "rml")
    options = (*options, "--manoeuvres", "off", "--to", 60)
    run = open_run(replayed(C172P, tmp_path, *options))
    assert run.summary.estimates["rml"].fit.simulation_pct == -1000.0
    text = Page(report(run)).text
    assert "< -1000" in text
    assert not re.findall(r"[1-9]e\+\d\d", text)


def test_what_was_held_is_said_once(tmp_path: Path) -> None:
    """Samples without enough before them teach nothing either, but nothing holds them."""
    run = open_run(replayed(C172P, tmp_path, "--rate", 10))
    text = Page(report(run)).text
    counts = [run.summary.estimates[method].held for method in ("els", "rml")]
    assert min(counts) > 0
    assert f"not used: held, or too few before them {counts[0]} {counts[1]}" in text
    assert "samples held, by reason any no sample" in text
    assert "none held" not in text


def test_the_cards_are_those_of_the_flight_where_there_is_one() -> None:
    frequency, damping, can_use = cards(four_of_a_flight())

    assert (frequency.answer, frequency.spread) == ("10.21 rad/s", "± 0.16")
    assert tuple(frequency.notes[1:]) == (
        "at 22.0 m/s (airspeed) and 102 m altitude",
        "ωn = 0.4634 ± 0.0077 · V",
        "the aircraft with its roll loop",
    )
    assert damping.answer == "0.624"
    assert can_use.notes == [
        "from 2 of 4 manoeuvres",
        "left out, as they disagree: 3",
        "the models alone explain 91 % of the yaw rate",
        "estimated from 65 s of flight",
    ]
    assert can_use.answer == "Yes"  # the stream of this run is not usable


def test_the_headline_says_whose_number_it_is_and_where() -> None:
    said = headline(four_of_a_flight())

    assert said.startswith("The yaw answers the rudder with a Dutch roll of 10.2 rad/s (1.6 Hz)")
    assert said.endswith(
        "It holds for the aircraft with its roll loop, at 22.0 m/s (airspeed) and 102 m altitude, "
        "from 2 of 4 manoeuvres."
    )
    assert headline(mixed_loops()).endswith("from 1 of 3 manoeuvres.")
    assert "roll loop, from 2 of 2 manoeuvres." in headline(without_airspeed())


def test_a_flight_without_a_usable_manoeuvre_is_refused() -> None:
    refused = none_usable()

    assert headline(refused).startswith(
        "This flight cannot say how the yaw answers the rudder: the n"
    )
    assert [card.answer for card in cards(refused)] == [
        "none found",
        "none found",
        "No",
    ]


@pytest.mark.parametrize(
    ("loop", "words", "levelled"),
    [
        ("airframe", "the airframe", True),
        ("with_roll_loop", "the aircraft with its roll loop", False),
        ("unknown", "the aircraft as flown (the flight mode is not known)", False),
    ],
)
def test_only_the_airframe_has_a_level(loop: str, words: str, levelled: bool) -> None:
    level_1 = msgspec.structs.replace(flight().dutch_roll, level=1)
    run = flight_summary([manoeuvre(1, loop=loop)], flight(used=[1], loop=loop, dutch_roll=level_1))
    frequency, damping = cards(run)[:2]

    assert frequency.notes[-1] == words
    assert ("MIL-F-8785C level 1" in damping.notes[0]) == levelled
