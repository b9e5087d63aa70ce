"""What the terminal says of a whole flight, and that it keeps within 80 columns."""

from __future__ import annotations

import io

import pytest
from hand_flights import (
    EVERY,
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
from rich.console import Console

from yawid.answers.run_summary import MethodSummary, RunSummary
from yawid.sinks.door import WIDTH
from yawid.sinks.pages import rich_table
from yawid.sinks.run_page import manoeuvre_grid, print_summary


def printed(run: RunSummary) -> list[str]:
    out = io.StringIO()
    print_summary(run, out)
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= WIDTH
    return lines


def text_of(run: RunSummary) -> str:
    return " ".join(" ".join(printed(run)).split())


def rows_of(run: RunSummary) -> list[list[str]]:
    """Return the rows of the manoeuvres in words."""
    lines = printed(run)
    [head] = [i for i, line in enumerate(lines) if "from-to s" in line]
    end = next(i for i, line in enumerate(lines) if line.startswith("± is one sigma"))
    return [line.split() for line in lines[head + 1 : end]]


def test_the_flight_has_the_verdict() -> None:
    lines = printed(four_of_a_flight())

    assert lines[1] == "verdict  usable"
    assert lines[2] == "  flight  wn 10.21 ± 0.16 rad/s, zeta 0.624 ± 0.021"
    assert lines[3].strip() == "noise alone: wn ± 0.03, zeta ± 0.004"
    assert lines[4].strip() == ("at 22.0 m/s (airspeed) and 102 m altitude, from 2 of 4 manoeuvres")
    assert lines[5].strip() == "this is the aircraft with its roll loop"
    assert lines[6].strip() == "wn = 0.4634 ± 0.0077 · V, where V is the equivalent airspeed"
    assert lines[7].startswith("   flown  2026-03-05 12:14:37 UTC, in FBWA, vehicle 1/1, fixed")
    assert not any("13.5" in line or "answers" in line for line in lines)


def test_the_streams_numbers_are_printed_only_without_a_flight() -> None:
    assert not any("fit one step" in line for line in printed(four_of_a_flight()))
    assert "fit one step" in text_of(summary([], None))


def test_sigma_is_the_total_and_that_of_the_stream_of_noise() -> None:
    assert "± is one sigma: noise, structure, scatter of manoeuvres; V is" in text_of(
        four_of_a_flight()
    )
    assert "± is one sigma of noise ELS RML" in text_of(summary([], None))


def test_each_manoeuvre_has_a_row_that_says_what_came_of_it() -> None:
    assert [" ".join(row) for row in rows_of(four_of_a_flight())] == [
        "1 35-67 FBWA roll 22.0 102 10.27±0.11 0.624±0.012 used",
        "2 95-127 FBWA roll 21.6 102 10.07±0.11 0.617±0.012 used",
        "3 155-187 FBWA roll 22.3 102 11.92±0.11 0.410±0.012 disagrees",
        "4 215-247 STABILIZE roll 22.9 102 12.40±0.11 0.330±0.012 not_converged",
    ]


def test_only_what_is_not_usable_is_dim() -> None:
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, color_system="standard", width=WIDTH)
    console.print(rich_table(manoeuvre_grid(four(), [flight()])))

    dim = [line for line in out.getvalue().splitlines() if line.startswith("\x1b[2m")]
    assert ["215-247" in line for line in dim] == [True]


def test_a_usable_one_that_the_flight_leaves_out_is_no_used_one() -> None:
    run = replace(four_of_a_flight(), flight=flight(used=[1], disagree=[3]))

    assert rows_of(run)[1][-3:] == ["usable,", "not", "used"]


def test_a_flight_without_a_usable_manoeuvre_says_so_and_keeps_its_table() -> None:
    lines = printed(none_usable())

    assert lines[1] == "verdict  NOT USABLE"
    assert lines[2].startswith(f"  {NOT_CONVERGED.id}: ")
    assert "  flight  no answer, from none of 2 manoeuvres" in lines
    assert [row[-3:] for row in rows_of(none_usable())] == [
        ["12.40±0.11", "0.620±0.012", "not_converged"],
        ["none", "none", "not_converged"],
    ]


def test_without_an_airspeed_nothing_is_said_to_go_with_it() -> None:
    text = text_of(without_airspeed())

    assert "no airspeed is known" in text
    assert " m/s " not in text.replace("V m/s", "")
    assert "· V" not in text
    assert rows_of(without_airspeed())[0][4:6] == ["-", "-"]


def test_of_many_the_first_and_the_last_stand_there() -> None:
    numbers = [row[0] for row in rows_of(forty())]

    assert numbers == [*map(str, range(1, 11)), "..", *map(str, range(31, 41))]
    assert "20 more are in --json" in text_of(forty())


def test_each_row_says_which_aircraft_it_is_of_and_whose_speed() -> None:
    rows = rows_of(mixed_loops())
    text = text_of(mixed_loops())

    assert [row[2:5] for row in rows] == [
        ["MANUAL", "bare", "22.0"],
        ["FBWA", "roll", "22.0*"],
        ["-", "?", "22.0"],
    ]
    assert "* V is the ground speed" in text
    assert "bare is the airframe" in text
    assert "? is the aircraft as flown (the flight mode is not known)" in text
    assert [" ".join(row[8:]) for row in rows] == ["used", "used", "used"]


def test_the_date_of_every_row_follows_from_the_boots() -> None:
    second = [
        replace(each, n=each.n + 4, date=each.date.replace("T12:", "T17:")) for each in four()
    ]
    run = summary([*four(), *second], flight())

    assert "seconds since boot at 2026-03-05 12:14:02 UTC" in text_of(four_of_a_flight())
    assert "seconds of 1 to 4 since boot at 2026-03-05 12:14:02 UTC" in text_of(run)
    assert "seconds of 5 to 8 since boot at 2026-03-05 17:14:02 UTC" in text_of(run)
    odd = [
        replace(each, date=date)
        for each, date in zip(four(), ("", "9", "0001-01-01"), strict=False)
    ]
    assert "since boot" not in text_of(summary(odd, flight()))


def test_a_run_in_which_none_was_found_says_why_that_may_be() -> None:
    stream = "no manoeuvre was found: the rudder never moved by itself for long enough"

    assert stream in text_of(summary([], None))
    assert "the stream at its end" not in text_of(summary([], None))
    nothing = replace(summary([], None), estimates=None)
    assert "no stretch has both rudder and yaw rate" in text_of(nothing)


def test_a_run_in_which_nobody_looked_says_nothing_of_manoeuvres() -> None:
    text = text_of(summary(None, None))

    assert "manoeuvre was found" not in text
    assert "flight" not in text.replace("flights/", "")


@pytest.mark.parametrize("name", EVERY)
def test_every_flight_keeps_within_80_columns(name: str) -> None:
    assert printed(EVERY[name]())


def test_absurd_numbers_keep_within_80_columns() -> None:
    """An estimate that diverged, a clock that says anything, and the longest words there are."""
    reason = replace(NOT_CONVERGED, id="collinear_inputs")
    found: MethodSummary | None = manoeuvre(1).answer
    assert found is not None
    wild = [
        replace(found, dutch_roll=replace(roll_of(wn, zeta), wn_std=std, zeta_std=std))
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
    rows = "\n".join(printed(summary(every, none_usable().flight)))

    for value in ("1.00e+300", "-1.00e+300", "123.46±99", "99.90"):
        assert value in rows
