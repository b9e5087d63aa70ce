"""The bench of the truth: what it counts of an estimate, and when a criterion is not met."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest
from bench import truth as bench
from bench.table import write_csv
from checks.judge import Row, compared
from flights.moved import PLACES, Draw
from hand_flights import estimate, manoeuvre, plain_summary, roll_of, verdict
from msgspec.structs import replace

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, DutchRoll, Flight, Manoeuvre

CONDITIONS: dict[str, Any] = {
    "aircraft": "c172p", "severity": 0, "gyro": "clean", "rate_hz": 25, "manoeuvre": "3211",
}  # fmt: skip


def warned(*reasons: str) -> Verdict:
    return verdict(*reasons, weight="warning")


def found(n: int, airspeed: float, wn: float, of: Verdict) -> Manoeuvre:
    """A manoeuvre whose RML has a total sigma of .05, .03 of noise; ELS found no Dutch roll."""
    roll = roll_of(wn, 0.2, 0.05, 0.04, (0.03, 0.01))
    both = {"rml": estimate("rml", roll), "els": estimate("els", None)}
    return manoeuvre(
        n, speed=airspeed, from_s=100.0 * n, to_s=100.0 * n + 40.0, duration_s=40.0, date="",
        loop="unknown", estimates=both, verdict=of,
    )  # fmt: skip


def rows_of(number: int, flight: Flight, *manoeuvres: Manoeuvre) -> list[Row]:
    """The rows of a flight: wn is 2.0 at 40 m/s and 2.5 at 50, zeta .2, each with its sigma."""
    truth = {
        "manoeuvres": [
            {"from_s": 100.0 * n, "to_s": 100.0 * n + 40.0, "dutch_roll": mode}
            for n, wn in ((1, 2.0), (2, 2.5))
            for mode in [{"wn_rad_s": wn, "wn_std": 0.04, "zeta": 0.2, "zeta_std": 0.03}]
        ]
    }
    summary = plain_summary(manoeuvres=list(manoeuvres), flight=flight)
    rows = compared(summary, truth)
    return [{"number": number} | CONDITIONS | row for row in rows]


def answered(wn: float, wn_std: float, *warnings: str) -> Flight:
    roll = DutchRoll(wn_rad_s=wn, wn_std=wn_std, zeta=0.2, zeta_std=0.04)
    return Flight(
        airspeed_m_s=45.0, dutch_roll=roll, used=[1, 2], disagree=[], verdict=warned(*warnings)
    )


def refused() -> Flight:
    return Flight(used=[], disagree=[], verdict=verdict("poor_fit"))


def test_each_estimate_is_held_to_its_own_truth_by_both_sigmas() -> None:
    pair = found(1, 40.0, 2.128, verdict()), found(2, 50.0, 2.5, verdict())

    rml, els, _, _, _, _, flight = rows_of(0, answered(2.295, 0.03), *pair)

    assert rml["wn_error_pct"] == pytest.approx(6.4)
    assert rml["wn_z"] == pytest.approx(0.128 / 0.0640312, rel=1e-5)  # .05 and the truth's .04
    assert rml["wn_z_noise"] == pytest.approx(0.128 / 0.05)  # .03 and .04
    assert els["wn"] is els["wn_z"] is None
    assert flight["wn_true"] == pytest.approx(2.25)  # at 45 m/s, as 2.0 at 40 and 2.5 at 50 say
    assert flight["wn_true_sigma"] == pytest.approx(0.0407, abs=0.001)
    assert flight["wn_error_pct"] == pytest.approx(2.0)


def test_the_bare_airframe_is_held_to_the_truth_without_the_roll_loop() -> None:
    roll = DutchRoll(wn_rad_s=1.9, wn_std=0.04, zeta=0.2, zeta_std=0.04)
    bare = Bare(dutch_roll=roll, used=[1], verdict=Verdict(usable=True, reasons=[]))
    summary = plain_summary(
        manoeuvres=[replace(found(1, 40.0, 2.1, verdict()), lateral=bare)], flight=refused()
    )
    loops = {"dutch_roll": 2.0, "dutch_roll_open_loop": 1.85}
    modes = {
        name: {"wn_rad_s": wn, "wn_std": 0.03, "zeta": 0.2, "zeta_std": 0.0}
        for name, wn in loops.items()
    }
    truth = {"manoeuvres": [{"from_s": 100.0, "to_s": 140.0, **modes}]}

    [row] = bench.of_kind(compared(summary, truth), "bare")

    assert row["usable"]
    assert row["wn_error_pct"] == pytest.approx(100.0 * 0.05 / 1.85)
    assert row["wn_z"] == pytest.approx(0.05 / 0.05)  # .04 and the truth's .03
    said = [row | CONDITIONS, row | CONDITIONS | {"usable": False}]
    assert next(each for each in bench.bare_lines(said) if "all" in each).startswith(
        "| all | 2 | 50 |"
    )


def test_the_figures_of_two_rows_are_those_by_hand() -> None:
    pair = found(1, 40.0, 2.128, verdict()), found(2, 50.0, 2.5, verdict())
    unfit = found(1, 40.0, 2.128, verdict("poor_fit"))
    rows = rows_of(0, answered(2.295, 0.03), *pair) + rows_of(1, refused(), unfit)

    line = bench.condition_line("two", rows)
    met = {what: is_met for what, _, _, is_met in bench.criteria(rows)}

    assert line == (
        "| two | 2 | 50 | 3.20 / 3.20 | +3.20 / +3.20 | 2.17 / 2.17 "
        "| 1.41 / 1.41 | 0.00 / 0.00 | 100 100 / 100 100 |"
    )
    assert not met["answered, calm"]
    assert not met["answer, RMS z of wn"]  # 1.4135
    assert not met["RML, RMS z of wn"]
    assert not met["ELS, RMS z of wn"]  # nothing was measured
    assert met["RML, wn within 2 sigma"]
    assert not met["answer, median sigma of wn, calm"]


def test_the_worst_answer_of_an_aircraft_is_named() -> None:
    pair = found(1, 40.0, 1.9, verdict()), found(2, 50.0, 2.525, verdict())

    lines = list(bench.worst_lines(rows_of(7, answered(2.2, 0.03), *pair)))

    assert lines[2:] == [
        "| c172p | 2 | -2.00 | 3.00 | -5.0 %, zeta +0.000: flight 7, 3211, severity 0, clean gyro, "
        "25 Hz, at 100 s |"
    ]


def test_a_wrong_flight_must_be_warned_of_or_refused_and_a_right_one_must_not() -> None:
    wrong = found(1, 40.0, 2.6, verdict())
    silent = rows_of(0, answered(2.6, 0.03), wrong)
    told = rows_of(1, answered(2.6, 0.03, "poor_fit"), wrong)
    gone = rows_of(2, refused(), wrong)
    right = rows_of(3, answered(2.26, 0.03), found(1, 40.0, 2.0, warned("coloured_residuals")))
    right_and_told = rows_of(4, answered(2.26, 0.03, "rate_low"), found(1, 40.0, 2.0, verdict()))

    said = list(bench.warning_criteria([*silent, *told, *gone, *right, *right_and_told]))

    assert [(measured, met) for _, _, measured, met in said] == [
        ("50 % (1 of 2)", False),
        ("67 % (2 of 3)", False),
        ("50 % (1 of 2)", True),  # by manoeuvres: told, not held to
        ("0 % (0 of 3)", True),
    ]
    assert [met for *_, met in bench.warning_criteria([*told, *gone, *right])][:2] == [True, True]


def test_a_flight_is_flown_once_and_has_a_row_for_every_estimate(tmp_path: Path) -> None:
    rows = bench.flight_rows(Draw(161, PLACES), False, tmp_path, 2)
    stamp = (tmp_path / "002.tlog").stat().st_mtime_ns
    again = bench.flight_rows(Draw(161, PLACES), False, tmp_path, 2)
    write_csv(tmp_path / "rows.csv", rows)

    streams = {"stream rml", "stream els"}
    assert {row["kind"] for row in rows} == {"rml", "els", "manoeuvre", "flight"} | streams
    assert again == rows
    assert (tmp_path / "002.tlog").stat().st_mtime_ns == stamp
    flight = next(row for row in rows if row["kind"] == "flight")
    assert flight["usable"]
    assert abs(flight["wn_error_pct"]) < 5.0
    assert 0.0 < flight["wn_true_sigma"] < 0.02 * flight["wn_true"]
    with (tmp_path / "rows.csv").open(encoding="utf-8") as file:
        assert [float(row["wn_true"]) for row in csv.DictReader(file)] == pytest.approx(
            [row["wn_true"] for row in rows], rel=1e-5
        )
    with pytest.raises(SystemExit, match="is flight 2 of seed 161"):
        bench.flight_rows(Draw(162, PLACES), False, tmp_path, 2)
