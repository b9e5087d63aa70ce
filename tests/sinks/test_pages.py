"""What a person is shown of a run: its page in each medium, its headline, its cards, its table."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path

import hand_flights
import pytest
from finished_runs import replayed
from hand_flights import (
    NOT_CONVERGED,
    flight,
    forty,
    four,
    four_of_a_flight,
    manoeuvre,
    mixed_loops,
    none_usable,
    roll_of,
    summary,
    without_airspeed,
)
from msgspec.structs import replace
from places import C172P
from report_page import Page, first_screen
from rich.console import Console

from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll, MethodSummary, RunSummary
from yawid.report.write import report
from yawid.sinks.answers import cards, headline, use
from yawid.sinks.door import WIDTH
from yawid.sinks.mcap.reader import open_run
from yawid.sinks.pages import (
    Grid,
    Note,
    Part,
    Said,
    rich_table,
    to_html,
    to_terminal,
    to_text,
    verdict_parts,
)
from yawid.sinks.run_page import manoeuvre_grid, whole_page
from yawid.sinks.words import Row, percent

HOSTILE = "a|b <script>\x1b[31m"
REASONS = [Reason("not_converged", HOSTILE, weight="fatal"), Reason("repeated", "twice")]
PAGE: list[Part] = [
    *verdict_parts(Verdict.of(REASONS)),
    Row("flight", f"wn 1.0 {'and so on ' * 20}"),
    Row("", "of noise alone", "dim"),
    Said("", "an advice"),
    Grid(("n", "mode"), [("1", HOSTILE), ("2", "FBWA")], ["dim", ""], texts=(1,)),
    Note("yawid replay " + "x" * 90, wraps=False),
]


def test_in_a_terminal_lines_are_80_wide_but_for_what_is_copied_and_no_text_is_a_command():
    out = io.StringIO()
    to_terminal(PAGE, out)
    *lines, command = out.getvalue().splitlines()

    assert lines[0] == "verdict  NOT USABLE"
    assert lines[1] == "  not_converged: a|b <script>\\x1b[31m"
    assert lines[2] == "  warning repeated: twice"
    assert lines[3].startswith("  flight  wn 1.0 and")
    assert lines[4].startswith(" " * 10 + "so on")
    assert max(map(len, lines)) <= WIDTH < len(command) == 103
    assert "\x1b" not in out.getvalue()


def test_in_html_texts_are_texts_and_none_is_lost():
    found = Page(to_html(PAGE))

    assert set(found.tags) == {"p", "b", "small", "table", "tr", "th", "td"}
    assert "NOT USABLE" in found.texts[1]
    assert (
        found.texts.count(HOSTILE.replace("\x1b", "\\x1b")) == 1
    )  # the cell; the reason has a space before
    assert found.texts[-1].endswith("x" * 90)


LONG = (
    "the natural frequency went from 3.1 to 9.4 rad/s in the last third while its sigma was 0.02 "
    "rad/s; if it was flown differently there, as in a turn, choose a stretch by --from and --to"
)


def test_a_run_whose_manoeuvres_were_not_looked_for_is_shown_as_not_judged_and_held_is_said_once(
    tmp_path: Path,
) -> None:
    """Samples without enough before them teach nothing either, but nothing holds them."""
    options = "--rate", 10, "--memory", "inf", "--manoeuvres", "off"  # as report/test_report.py
    run = open_run(replayed(C172P, tmp_path, *options))
    html = report(run)
    assert "It was not judged." in first_screen(html)
    shown = to_text(whole_page(run.summary))
    assert "verdict  not judged" in shown
    assert "NOT USABLE" not in shown
    text, counts = Page(html).text, [run.summary.estimates[name].held for name in ("els", "rml")]
    assert min(counts) > 0
    assert f"not used: held, or too few before them {counts[0]} {counts[1]}" in text
    assert "samples held, by reason any no sample" in text
    assert "none held" not in text


def estimate(wn: float) -> MethodSummary:
    roll = DutchRoll(wn_rad_s=wn, wn_std=0.01, zeta=0.2, zeta_std=0.01)
    return hand_flights.estimate("els", roll)


def summary_of(reason: str | None = None) -> RunSummary:
    reasons = [Reason("not_converged", reason, weight="fatal")] if reason else []
    return hand_flights.plain_summary(
        estimates={"els": estimate(2.0), "rml": estimate(3.0)},
        verdict=Verdict.of(reasons),
    )


def test_without_a_flight_the_first_estimate_of_the_stream_is_on_the_card_with_its_use() -> None:
    assert cards(summary_of())[0].answer == "2.000 rad/s"
    assert [use(summary_of(reason)).answer for reason in (None, "it moved")] == ["Yes", "No"]


@pytest.mark.slow
def test_a_run_that_explodes_is_reported_without_a_warning_or_an_absurd_number(
    tmp_path: Path,
) -> None:
    options = ("--orders", "30,30,20,1", "--memory", "inf", "--method", "rml")
    options = (*options, "--manoeuvres", "off", "--to", 60)
    run = open_run(replayed(C172P, tmp_path, *options))
    assert run.summary.estimates["rml"].fit.simulation_pct == -1000.0
    for text in (Page(report(run)).text, to_text(whole_page(run.summary))):
        assert "< -1000" in text
        assert not re.findall(r"[1-9]e\+\d\d", text)
    assert percent(-999.0, ".0f") == "-999"


def refused_flight() -> RunSummary:
    disagree = Reason("manoeuvres_disagree", "they disagree", weight="fatal")
    fatal, told = Verdict(usable=False, reasons=[disagree]), four_of_a_flight()
    return replace(told, flight=replace(told.flight, verdict=fatal, used=[]), verdict=fatal)


@pytest.mark.parametrize(
    ("run", "stretch", "pattern"),
    [
        (summary_of(LONG), (), f"This log cannot say how the yaw answers the rudder: {LONG}."),
        (summary_of(LONG), ((None, 61.5),), "This stretch of the log, to 61.5 s, cannot say how*"),
        (
            refused_flight(), (),
            "*By itself this can be used: manoeuvre 1 (35 to 67 s); manoeuvre 2 (*",
        ),
        (
            four_of_a_flight(), (),
            "The yaw answers the rudder with a Dutch roll of 10.2 rad/s (1.6 Hz)*"
            "It holds for the aircraft with its roll loop, at 22.0 m/s (airspeed) and 102 m "
            "altitude, from 2 of 4 manoeuvres.",
        ),
        (mixed_loops(), (), "*from 1 of 3 manoeuvres."),
        (without_airspeed(), (), "*roll loop, from 2 of 2 manoeuvres.*"),
        (none_usable(), (), "This flight cannot say how the yaw answers the rudder: the n*"),
    ],
)  # fmt: skip
def test_the_headline_says_whose_number_it_is_and_where_or_why_there_is_none(
    run: RunSummary, stretch: tuple[tuple[None, float], ...], pattern: str
) -> None:
    assert re.fullmatch(re.escape(pattern).replace(r"\*", ".*"), headline(run, *stretch))


def test_the_cards_are_those_of_the_flight_where_there_is_one() -> None:
    frequency, damping, can_use = cards(four_of_a_flight())

    assert (frequency.answer, frequency.spread) == ("10.21 rad/s", "± 0.16")
    assert tuple(frequency.notes[1:]) == (
        "at 22.0 m/s (airspeed) and 102 m altitude",
        "ωn = 0.4634 ± 0.0077 · V",
        "the aircraft with its roll loop",
    )
    # The stream of this run is not usable.
    assert (damping.answer, can_use.answer) == ("0.624", "Yes")
    assert can_use.notes == [
        "from 2 of 4 manoeuvres",
        "left out, as they disagree: 3",
        "the models alone explain 91 % of the yaw rate",
        "estimated from 65 s of flight",
    ]
    assert [card.answer for card in cards(none_usable())] == ["none found", "none found", "No"]


@pytest.mark.parametrize(
    ("loop", "words", "levelled"),
    [
        ("airframe", "the airframe", True),
        ("with_roll_loop", "the aircraft with its roll loop", False),
        ("unknown", "the aircraft as flown (the flight mode is not known)", False),
    ],
)
def test_only_the_airframe_has_a_level(loop: str, words: str, levelled: bool) -> None:
    level_1 = replace(flight().dutch_roll, level=1)
    run = summary([manoeuvre(1, loop=loop)], flight(used=[1], loop=loop, dutch_roll=level_1))
    frequency, damping = cards(run)[:2]

    assert frequency.notes[-1] == words
    assert ("MIL-F-8785C level 1" in damping.notes[0]) == levelled


Make = Callable[[], RunSummary]


def printed(run: RunSummary) -> list[str]:
    lines = to_text(whole_page(run)).splitlines()
    assert max(map(len, lines)) <= WIDTH
    return lines


def rows_of(run: RunSummary) -> list[str]:
    """Return the rows of the manoeuvres in words."""
    lines = printed(run)
    [head] = [i for i, line in enumerate(lines) if "from-to s" in line]
    end = next(i for i, line in enumerate(lines) if line.startswith("± is one sigma"))
    return [" ".join(line.split()) for line in lines[head + 1 : end]]


def of_two_boots() -> RunSummary:
    later = [replace(each, n=each.n + 4, date=each.date.replace("T12:", "T17:")) for each in four()]
    return summary([*four(), *later], flight())


def of_odd_dates() -> RunSummary:
    dates = zip(four(), ("", "9", "0001-01-01"), strict=False)
    return summary([replace(each, date=date) for each, date in dates], flight())


def of_absurd_numbers() -> RunSummary:
    """An estimate that diverged, a clock that says anything, and the longest words there are."""
    reason = replace(NOT_CONVERGED, id="collinear_inputs")
    wild = [
        replace(
            manoeuvre(1).answer, dutch_roll=replace(roll_of(wn, zeta), wn_std=std, zeta_std=std)
        )
        for wn, zeta, std in ((1e300, -1e300, 1e300), (123.456, -0.5, 99.0), (99.9, 0.1, None))
    ]
    every = [
        manoeuvre(
            1200 + i, from_s=123_456.0, to_s=123_576.0, mode="A MODE WITH A LONG NAME",
            altitude_m=12_345.0, speed=222.2, airspeed_source="ground speed", reason=reason,
            estimates={"ct": estimate}, date="9999-12-31T23:59:59Z",
        )
        for i, estimate in enumerate(wild)
    ]  # fmt: skip
    return summary(every, none_usable().flight)


SAID: list[tuple[Make, tuple[str, ...], tuple[str, ...]]] = [
    (
        four_of_a_flight,
        (
            "verdict usable flight wn 10.21 ± 0.16 rad/s, zeta 0.624 ± 0.021 "
            "noise alone: wn ± 0.03, zeta ± 0.004 "
            "at 22.0 m/s (airspeed) and 102 m altitude, from 2 of 4 manoeuvres "
            "this is the aircraft with its roll loop "
            "wn = 0.4634 ± 0.0077 · V, where V is the equivalent airspeed "
            "flown 2026-03-05 12:14:37 UTC, in FBWA, vehicle 1/1, fixed",
            "± is one sigma: noise, structure, scatter of manoeuvres; V is",
            "seconds since boot at 2026-03-05 12:14:02 UTC",
        ),
        ("13.5", "answers", "fit one step"),
    ),
    (
        lambda: summary([], None),
        (
            "no manoeuvre was found: the rudder never moved by itself for long enough",
            "fit one step",
            "± is one sigma of noise ELS RML",
        ),
        ("the stream at its end",),
    ),
    (
        lambda: replace(summary([], None), estimates=None),
        ("no stretch has both rudder and yaw rate",),
        (),
    ),
    (lambda: summary(None, None), (), ("manoeuvre was found", " flight ")),
    (
        none_usable,
        (
            f"verdict NOT USABLE {NOT_CONVERGED.id}: ",
            "flight no answer, from none of 2 manoeuvres",
        ),
        (),
    ),
    (without_airspeed, ("no airspeed is known",), ("22 m/s", "22.0", ") m/s", "· V")),
    (forty, ("20 more are in --json",), ()),
    (
        mixed_loops,
        (
            "* V is the ground speed",
            "bare is the airframe",
            "? is the aircraft as flown (the flight mode is not known)",
        ),
        (),
    ),
    (
        of_two_boots,
        (
            "seconds of 1 to 4 since boot at 2026-03-05 12:14:02 UTC",
            "seconds of 5 to 8 since boot at 2026-03-05 17:14:02 UTC",
        ),
        (),
    ),
    (of_odd_dates, (), ("since boot",)),
    (of_absurd_numbers, ("1.00e+300", "-1.00e+300", "123.46±99", "99.90"), ()),
]


@pytest.mark.parametrize(("make", "words", "never"), SAID, ids=lambda each: "")
def test_the_page_says_what_is_known_within_80_columns_and_nothing_else(
    make: Make, words: tuple[str, ...], never: tuple[str, ...]
) -> None:
    text = " ".join(" ".join(printed(make())).split())
    assert [each for each in words if each not in text] == []
    assert [each for each in never if each in text] == []


def test_each_manoeuvre_has_a_row_that_says_its_aircraft_its_speed_and_its_result() -> None:
    assert rows_of(four_of_a_flight()) == [
        "1 35-67 FBWA roll 22.0 102 10.27±0.11 0.624±0.012 used",
        "2 95-127 FBWA roll 21.6 102 10.07±0.11 0.617±0.012 used",
        "3 155-187 FBWA roll 22.3 102 11.92±0.11 0.410±0.012 disagrees",
        "4 215-247 STABILIZE roll 22.9 102 12.40±0.11 0.330±0.012 not_converged",
    ]
    one_used = replace(four_of_a_flight(), flight=flight(used=[1], disagree=[3]))
    assert rows_of(one_used)[1].endswith(" usable, not used")
    assert [row.split()[-3:] for row in rows_of(none_usable())] == [
        ["12.40±0.11", "0.620±0.012", "not_converged"],
        ["none", "none", "not_converged"],
    ]
    assert rows_of(without_airspeed())[0].split()[4:6] == ["-", "-"]
    numbers = [row.split()[0] for row in rows_of(forty())]
    assert numbers == [*map(str, range(1, 11)), "..", *map(str, range(31, 41))]
    mixed = [row.split() for row in rows_of(mixed_loops())]
    assert [[*row[2:5], *row[8:]] for row in mixed] == [
        ["MANUAL", "bare", "22.0", "used"],
        ["FBWA", "roll", "22.0*", "used"],
        ["-", "?", "22.0", "used"],
    ]


def test_only_what_is_not_usable_is_dim() -> None:
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, color_system="standard", width=WIDTH)
    console.print(rich_table(manoeuvre_grid(four(), [flight()])))
    dim = [line for line in out.getvalue().splitlines() if line.startswith("\x1b[2m")]
    assert ["215-247" in line for line in dim] == [True]
