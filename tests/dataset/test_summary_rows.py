"""A summary's numbers as the rows of a data set have them, by hand."""

from __future__ import annotations

import pytest
from hand_flights import (
    by_ct,
    estimate,
    manoeuvre,
    mixed_loops,
    roll_of,
    summary,
)
from msgspec.structs import replace

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, DutchRoll, TimeConstant
from yawid.dataset.files import table_of
from yawid.dataset.schema import TABLES
from yawid.dataset.summary_rows import flight_rows, manoeuvre_rows


def test_kappa_and_k_over_v_and_all_their_sigmas_are_divided_by_the_airspeed() -> None:
    # wn 10.07, total sigma .11, of noise .03; K .308, .006, .002; V 21.6.
    (row,) = manoeuvre_rows(summary([manoeuvre(1, 10.07, speed=21.6)], None))

    expected = {
        "kappa_rad_m": 0.466_203_7,
        "kappa_std": 0.005_092_593,
        "kappa_std_noise": 0.001_388_889,
        "K_per_V": 0.014_259_26,
        "K_per_V_std": 0.000_277_777_8,
        "K_per_V_std_noise": 0.000_092_592_6,
    }
    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-5)
    for speed, source in ((21.6, "ground_speed"), (None, None)):
        (row,) = manoeuvre_rows(summary([manoeuvre(1, speed=speed, airspeed_source=source)], None))
        assert not expected.keys() & row.keys()


def test_each_loop_of_a_flight_is_a_row_and_its_headline_the_first() -> None:
    rows = flight_rows(mixed_loops(), 1, 268.0)

    assert [(row["loop"], row["wn_rad_s"], row["used"], row["usable"]) for row in rows] == [
        ("with_roll_loop", 10.21, [2], True),
        ("airframe", 10.4, [1], True),
        ("unknown", 10.3, [3], True),
    ]
    assert {row["manoeuvres"] for row in rows} == {3}
    assert [row["used"] for row in manoeuvre_rows(mixed_loops())] == [True] * 3
    [stream] = flight_rows(summary(None, None), 1, 268.0)
    assert (stream["answer"], stream["usable"]) == ("stream", False)


def test_the_bare_airframe_is_in_the_rows_of_its_flight_and_of_its_manoeuvre() -> None:
    usable = Verdict(usable=True, reasons=[])
    roll = DutchRoll(wn_rad_s=10.3, wn_std=0.2, zeta=0.63, zeta_std=0.02, level=1)
    bare = Bare(dutch_roll=roll, roll_mode=TimeConstant(0.1, 0.01), airspeed_m_s=22.7,
                used=[1], verdict=usable)  # fmt: skip
    refused = Bare(used=[2], verdict=Verdict(usable=False, reasons=[]))
    two = [replace(manoeuvre(1), lateral=bare), replace(manoeuvre(2), lateral=refused)]
    run = replace(summary(two, None), bare=bare)

    expected = {
        "bare_wn_rad_s": 10.3, "bare_wn_std": 0.2, "bare_zeta": 0.63, "bare_zeta_std": 0.02,
        "bare_level": 1, "bare_roll_mode_s": 0.1, "bare_roll_mode_std": 0.01,
        "bare_airspeed_m_s": 22.7,
    }  # fmt: skip
    first, second = manoeuvre_rows(run)
    for row in (flight_rows(run, 1, 268.0)[0], first):
        assert {name: row[name] for name in expected} == expected
        assert table_of(TABLES["flights"], [{name: row[name] for name in expected}]).num_rows == 1
    assert not [name for name in second if name.startswith("bare")]


def test_what_els_and_rml_had_at_the_end_of_a_manoeuvre_stands_under_their_own_names() -> None:
    els, rml = estimate("els", roll_of(9.7, 0.55)), estimate("rml", roll_of(10.4, 0.7))
    for order in ((els, rml), (rml, els)):
        answers = {"ct": by_ct(roll_of(10.2, 0.62))} | {each.method: each for each in order}
        flown = replace(manoeuvre(1), estimates=answers)
        (row,) = table_of(TABLES["manoeuvres"], manoeuvre_rows(summary([flown], None))).to_pylist()

        assert (row["wn_rad_s"], row["zeta"]) == (10.2, 0.62)
        assert (row["els_wn_rad_s"], row["els_zeta"]) == (9.7, 0.55)
        assert (row["rml_wn_rad_s"], row["rml_zeta"]) == (10.4, 0.7)

    alone = replace(manoeuvre(1), estimates={"ct": by_ct(roll_of(10.2, 0.62)), "els": els})
    (row,) = manoeuvre_rows(summary([alone], None))
    assert not [name for name in row if name.startswith("rml")]
