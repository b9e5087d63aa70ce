"""``yawid trend`` on data sets on disk, written as ``yawid fleet`` writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
from checks.judge_trend import START_US, Plan, flight
from fleets import FALLS, draw_fleet, write_fleet
from printed import answered

import yawid
from yawid.cli.main import main
from yawid.trend.days import DAY_US, HOUR_US, YEAR_US
from yawid.trend.trend import Trend, trend


@pytest.fixture(scope="module")
def fallen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fleet of 20 aircraft with 40 flights, one of whose zeta falls by 20 %."""
    folder = tmp_path_factory.mktemp("fallen")
    rows = draw_fleet(3, Plan(falls=True))
    for row in rows:
        if row["vehicle"] == FALLS and row["date"] > START_US + 25 * DAY_US:
            row["config_hash"] = "d"
    write_fleet(folder, rows)
    return folder


def steady(vehicle: int, count: int, **more: Any) -> list[dict[str, Any]]:
    numbers = {"zeta": 0.15, "zeta_std": 0.01, "kappa_rad_m": 0.12, "kappa_std": 0.002,
               "K_per_V": 0.04, "K_per_V_std": 0.002}  # fmt: skip
    return [
        flight(vehicle, i, START_US + i * 7 * DAY_US, **(numbers | more | {
            "zeta": 0.15 + 0.01 * (-1) ** i}))
        for i in range(count)
    ]  # fmt: skip


def test_the_fall_is_found_and_said_first_nothing_else_is_and_the_exit_code_is_7(
    fallen: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = answered(capsys, "trend", fallen)

    assert (code, said["changed"], said["false_alarm_rate"]) == (7, True, 0.01)
    assert (said["histories_tested"], said["numbers_tested"]) == (60, 3600)
    (found,) = [each for each in said["followed"] if "change" in each]
    assert (found["vehicle"], found["quantity"]) == (FALLS, "zeta")
    change, slope = found["change"], found["slope_per_year"]
    assert change["kind"] == "slope"
    assert change["percent"] == pytest.approx(-20.0, abs=6.0)
    assert change["sigmas"] < -4.0
    assert change["p"] < 0.01
    assert change["measured_otherwise"] == ["config_hash: c before, d after"]
    assert slope["value"] < -3.0 * slope["std"]
    assert found["beside"]["vehicles"] == 20
    outliers = [one for each in said["followed"] for one in each["outliers"]]
    assert 0.02 < len(outliers) / said["numbers_tested"] < 0.06

    assert main(["trend", str(fallen)]) == 7
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "verdict  1 CHANGED"
    assert lines[2].startswith(f"  {FALLS} (airframe) zeta fell by ")
    assert all(len(line) <= 80 for line in lines[1:])
    assert "false alarms: 1 % of data" in " ".join(lines)


def test_one_vehicle_is_judged_among_all_and_its_page_stands_alone(
    fallen: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "r.html"
    of_falls = ["trend", str(fallen), "--vehicle", FALLS, "-o", str(page)]
    code, said = answered(capsys, "trend", fallen, "--vehicle", "sysid:2")

    assert (code, said["histories_tested"]) == (0, 60)
    assert {each["vehicle"] for each in said["followed"]} == {"sysid:2"}
    assert main(["trend", str(fallen), "--vehicle", "sysid:99"]) == 2
    assert "sysid:99: not in" in capsys.readouterr().err
    assert [main(of_falls) for _ in range(2)] == [7, 6]
    assert "--force" in capsys.readouterr().err
    text = page.read_text(encoding="utf-8")
    shown = ("1 of 3 histories changed.", f"<b>{FALLS} ζ</b>fell by ", "What this cannot do",
             "12 days flown", "count as one", "4 % either way", "a campaign, a pilot")  # fmt: skip
    assert [words for words in shown if words not in text] == []
    assert (text.count("<svg"), text.count("<script")) == (1, 0)


def test_the_page_of_two_aircraft_shows_them_next_to_each_other_in_each_number(
    tmp_path: Path,
) -> None:
    write_fleet(tmp_path / "two", [*steady(1, 12), *steady(2, 12)])

    assert main(["trend", str(tmp_path / "two"), "-o", str(tmp_path / "r.html")]) == 0
    over_flights, next_to = (
        (tmp_path / "r.html").read_text(encoding="utf-8").split("next to each other")
    )
    assert (over_flights.count("<svg"), next_to.count("<svg")) == (2, 3)
    assert [next_to.count(f"sysid:{i}</text>") for i in (1, 2)] == [3, 3]


def followed(folder: Path, rows: list[dict[str, Any]]) -> Trend:
    write_fleet(folder, rows)
    return trend(folder)[0]


def test_what_cannot_be_followed_is_left_out_and_counted(tmp_path: Path) -> None:
    bad = [
        {"zeta": 0.4, "zeta_std": 0.01, "usable": False},
        {"zeta": 0.4, "zeta_std": 0.01, "date": None},
        {"zeta": 0.4},
        {"zeta": None, "zeta_std": None},
    ]
    rows = [flight(1, 20 + i, START_US) | each for i, each in enumerate(bad)]
    old = steady(2, 2, kappa_rad_m=None, kappa_std=None)

    said = followed(tmp_path, steady(1, 14) + rows + old)

    assert said.left_out == {
        "not usable": 1, "without a date": 1, "without a number and its sigma": 2,
    }  # fmt: skip
    assert {(each.vehicle, each.quantity): each.flights for each in said.followed} == {
        ("sysid:1", "kappa_rad_m"): 14, ("sysid:1", "zeta"): 14, ("sysid:1", "K_per_V"): 14,
        ("sysid:2", "zeta"): 2, ("sysid:2", "K_per_V"): 2,
    }  # fmt: skip


def test_the_bare_airframe_and_ordinary_flight_have_histories_of_their_own(tmp_path: Path) -> None:
    """Their zeta falls by a third while that of vehicle 1, as flown, stays as it was.

    Vehicle 2 never had a manoeuvre. A flight with answers of two loops has one airframe. Wn / V is
    by the equivalent airspeed: at 2 000 m of the standard atmosphere, 0.9065 of the true one.
    """
    nothing = {"loop": None, "wn_rad_s": None, "zeta": None, "kappa_rad_m": None, "K_per_V": None,
               "usable": False, "answer": None}  # fmt: skip
    rows = steady(1, 30, loop="with_roll_loop", altitude_m=2000.0)
    others = [row | nothing for row in steady(2, 30)]
    for i, (row, other) in enumerate(zip(rows, others, strict=True)):
        zeta = (0.30 if i < 18 else 0.20) + 0.01 * (-1) ** i
        row |= {"bare_wn_rad_s": 2.4, "bare_wn_std": 0.05, "bare_airspeed_m_s": 50.0,
                "bare_zeta": zeta, "bare_zeta_std": 0.01}  # fmt: skip
        other |= {"ordinary_wn_rad_s": 2.4, "ordinary_kappa_rad_m": 0.048,
                  "ordinary_kappa_std": 0.001, "ordinary_zeta": zeta,
                  "ordinary_zeta_std": 0.01}  # fmt: skip

    said = followed(tmp_path, [*rows, rows[4] | {"loop": "airframe"}, *others])

    known = {(each.loop, each.quantity): each for each in said.followed}
    alone = [("bare", "kappa_rad_m"), ("bare", "zeta")]
    assert [known[each].flights for each in alone] == [30, 30]
    equivalent = 50.0 * (1.0 - 0.0065 * 2000.0 / 288.15) ** (4.2559 / 2.0)
    assert known["bare", "kappa_rad_m"].now.value == pytest.approx(2.4 / equivalent, rel=1e-3)
    assert known["ordinary", "kappa_rad_m"].now.value == pytest.approx(0.048)
    assert {each.loop for each in said.followed if each.vehicle == "sysid:2"} == {"ordinary"}
    changed = {(each.loop, each.quantity) for each in said.followed if each.change is not None}
    assert changed == {("bare", "zeta"), ("ordinary", "zeta")}
    assert said.flights == 60


def test_flights_that_agree_better_than_their_sigmas_are_known_no_better_than_those(
    tmp_path: Path,
) -> None:
    rows = steady(1, 16)
    for i, row in enumerate(rows):
        row |= {"zeta": 0.15 + (0.006 if i == 9 else 0.0001 * (-1) ** i)}
        row["date"] = START_US + i * DAY_US

    said = followed(tmp_path, rows)

    zeta = next(each for each in said.followed if each.quantity == "zeta")
    assert zeta.outliers == []
    assert zeta.now.std == pytest.approx(0.01 / 16**0.5, rel=0.1)
    assert zeta.tested
    assert zeta.slope_per_flight is not None
    assert zeta.slope_per_year is None, "they were flown within a month"


def test_two_loops_are_two_histories_and_flights_of_one_day_are_none(tmp_path: Path) -> None:
    loops, day = steady(1, 28), steady(2, 16)
    for row in loops[14:]:
        row |= {"loop": "with_roll_loop", "zeta": row["zeta"] * 1.5}
    for i, row in enumerate(day):
        row |= {"date": START_US + i * HOUR_US, "zeta": 0.15 if i < 8 else 0.25}

    said = followed(tmp_path, loops + day)

    of = {(each.vehicle, each.loop): (each.flights, each.days, each.tested)
          for each in said.followed}  # fmt: skip
    assert of == {
        ("sysid:1", "airframe"): (14, 14, True), ("sysid:1", "with_roll_loop"): (14, 14, True),
        ("sysid:2", "airframe"): (16, 1, False),
    }  # fmt: skip
    assert not said.changed
    assert not [each for each in said.followed if each.beside is not None]  # of too few vehicles


def yearly(days: int, apart: int, swing: float, fall: float = 0.0) -> list[dict[str, Any]]:
    """A history whose zeta swings with the year, highest at its end, and falls from the half on."""
    noise = np.random.default_rng(1).standard_normal(days)
    rows = []
    for i in range(days):
        date = START_US + i * apart * DAY_US
        turn = np.cos(2.0 * np.pi * date / YEAR_US)
        level = 0.15 * (1.0 + swing * turn) * (1.0 - fall * (i >= days // 2))
        rows.append(flight(1, i, date, zeta=level + 0.0015 * noise[i], zeta_std=0.0015))
    return rows


def test_what_a_season_may_do_is_no_alarm_before_two_years_are_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fleet(tmp_path, yearly(24, 7, swing=0.03))  # half a year
    code, said = answered(capsys, "trend", tmp_path)

    zeta = said["followed"][0]
    assert (code, said["changed"], "change" in zeta, "season" in zeta) == (0, False, False, False)
    assert zeta["may_be_season"]["p"] < 0.01
    assert main(["trend", str(tmp_path), "-o", str(tmp_path / "r.html")]) == 0
    for words in (capsys.readouterr().out, (tmp_path / "r.html").read_text(encoding="utf-8")):
        assert "a season may do the same: two years of" in " ".join(words.split())


@pytest.mark.parametrize(("apart", "fall"), [(7, 0.25), (1, 0.06)])
def test_a_fall_larger_than_a_season_is_an_alarm_and_a_quick_one_needs_not_be(
    tmp_path: Path, apart: int, fall: float
) -> None:
    assert followed(tmp_path, yearly(24, apart, swing=0.0, fall=fall)).changed


def test_two_years_show_the_season_and_what_changes_next_to_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fleet(tmp_path / "steady", yearly(110, 7, swing=0.1))
    code, said = answered(capsys, "trend", tmp_path / "steady")
    zeta = said["followed"][0]
    assert code == 0
    assert not {"change", "may_be_season"} & set(zeta)
    assert zeta["season"]["amplitude"]["value"] == pytest.approx(0.015, abs=0.0006)
    assert zeta["season"]["amplitude"]["std"] == pytest.approx(0.0015 * (2 / 110) ** 0.5, rel=0.3)
    assert zeta["season"]["peak"] in ("12-30", "12-31", "01-01", "01-02", "01-03")
    assert zeta["now"]["value"] == pytest.approx(0.15, abs=0.001)

    assert main(["trend", str(tmp_path / "steady"), "-o", str(tmp_path / "r.html")]) == 0
    assert f"highest on {zeta['season']['peak']}" in (tmp_path / "r.html").read_text(
        encoding="utf-8"
    )

    change = followed(tmp_path / "fallen", yearly(110, 7, swing=0.1, fall=0.05)).followed[0].change
    assert change.percent == pytest.approx(-5.0, abs=1.0)
    assert abs(change.from_flight - 55) <= 3


def test_outliers_and_who_stands_out_are_judged_over_all_numbers(tmp_path: Path) -> None:
    """Own arithmetic: of p over one number, n-fold for n numbers, or histories"""
    rng = np.random.default_rng(4)
    rows = []
    for sysid in range(1, 7):
        own = 0.15 * (1.0 + 0.02 * rng.standard_normal() + (0.2 if sysid == 3 else 0.0))
        for i in range(11):
            zeta = own + 0.002 * rng.standard_normal() + (0.0085 if sysid == i == 5 else 0.0)
            date = START_US + i * DAY_US
            rows.append(flight(sysid, i, date, zeta=zeta, zeta_std=0.002))
    write_fleet(tmp_path, rows)

    said, studied = trend(tmp_path)

    one = studied[4]
    p = 66 * 2.0 * scipy.stats.t.sf(np.abs(one.level.z), one.fitted.dof)
    assert 1e-4 < p[5] < 0.01
    assert [(each.flight, each.p) for each in one.followed.outliers] == [(6, pytest.approx(p[5]))]
    for each in studied:
        p_one = 2.0 * scipy.stats.t.sf(abs(each.followed.beside.sigmas), 5)
        assert each.followed.beside.p == pytest.approx(min(1.0, 6 * p_one))
    assert said.numbers_tested == 66


SMALL = {"autopilot": 3, "airspeed_m_s": 22.0, "airspeed_source": "airspeed",
         "kappa_rad_m": 0.46, "kappa_std": 0.01, "zeta": 0.61, "zeta_std": 0.03}  # fmt: skip
LARGE = SMALL | {"airspeed_m_s": 50.0, "kappa_rad_m": 0.048, "kappa_std": 0.001, "zeta": 0.23}
"""Flights of a model aircraft and of a Cessna 172, as two that share sysid 1 have had them."""


def write(folder: Path, flights: list[dict[str, Any]], **more: Any) -> Path:
    """Write flights of sysid 1, one a day, as a data set."""
    days = enumerate(flights)
    write_fleet(folder, [flight(1, i, START_US + i * DAY_US, **each, **more) for i, each in days])
    return folder


def judged(capsys: pytest.CaptureFixture[str], *argv: Any) -> tuple[int, Any, str]:
    """Return a command's exit code, its JSON object and its text in one line."""
    code, said = answered(capsys, *argv)
    assert main([*map(str, argv)]) == code
    return code, said, " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("days", "apart_us"), [(0, 0), (2, 3_000_000), (2, 1092 * DAY_US), (11, DAY_US)]
)
def test_a_trend_that_tested_nothing_is_not_steady_and_exits_5(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], days: int, apart_us: int
) -> None:
    """Of flights that are seconds or years apart, of a vehicle whose name is markup."""
    name, dataset, page = "[red]:x:<b>\x1b[2J", tmp_path / "data", tmp_path / "r.html"
    rows = [flight(1, i, START_US + i * apart_us, vehicle=name, **SMALL) for i in range(days)]
    write_fleet(dataset, rows)

    code, said, text = judged(capsys, "trend", dataset)

    flown = 1 if apart_us == 3_000_000 else days
    assert (code, said["changed"], said["judged"]) == (5, False, 0)
    needed = f"nothing was tested: 12 days flown are needed, there are {flown}"
    assert f"verdict {needed}" in text
    assert [words for words in ("steady", "false alarms", "over all 0") if words in text] == []
    for each in said["followed"]:
        assert each["now"]["std"] > 0.0
        assert each["tested"] is False
        assert not {"slope_per_year", "change"} & set(each)
    assert main(["trend", str(dataset), "-o", str(page)]) == 5
    shown = page.read_text(encoding="utf-8")
    assert f"N{needed[1:]}." in shown
    assert "Nothing changed" not in shown
    assert 'header class="unusable"' in shown
    assert ("[red]:x:<b>" in text) == ("[red]:x:&lt;b&gt;" in shown) == (days > 0)
    assert "\x1b" not in text + shown
    assert "<b>" not in shown


def test_twelve_days_are_tested_and_steady(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said, text = judged(capsys, "trend", write(tmp_path, [SMALL] * 12))

    assert (code, said["judged"], said["warnings"]) == (0, 2, [])
    assert "verdict steady" in text
    assert "over all 2 histories tested" in text
    assert "several aircraft may share" in text


def test_several_aircraft_under_one_id_are_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = [SMALL, LARGE] * 6
    speeds, page = write(tmp_path / "speeds", both), tmp_path / "r.html"
    _, said, text = judged(capsys, "trend", speeds)
    (warning,) = said["warnings"]
    assert (warning["id"], warning["weight"]) == ("several_aircraft", "warning")
    assert "sysid:1 may be several aircraft, at 22 m/s and 50 m/s: name them" in warning["text"]
    assert "--vehicle-from folder" in warning["text"]
    assert f"warning several_aircraft: {warning['text']}" in text
    assert main(["trend", str(speeds), "-o", str(page)]) == 0
    assert "warning several_aircraft" in page.read_text(encoding="utf-8")

    assert main(["explain", "several_aircraft"]) == 0
    assert "a gap of a factor of 1.5" in " ".join(capsys.readouterr().out.split())

    px4 = [SMALL, SMALL | {"autopilot": 12}] * 6
    _, said, _ = judged(capsys, "trend", write(tmp_path / "autopilots", px4))
    assert "on ArduPilot and a fixed wing on PX4" in said["warnings"][0]["text"]


def test_one_aircraft_over_its_airspeeds_and_named_ones_are_no_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    speeds = (39.0, 48.0, 55.0, 62.0) * 3  # of one flight of a Cessna 172
    own = [LARGE | {"airspeed_m_s": each} for each in speeds]
    unknown = [LARGE | {"airspeed_m_s": 9.0, "airspeed_source": "ground speed", "autopilot": None}]
    _, said, _ = judged(capsys, "trend", write(tmp_path / "one", own + unknown))
    assert said["warnings"] == []

    _, said, _ = judged(capsys, "trend", write(tmp_path / "named", [SMALL, LARGE], vehicle="plane"))
    assert said["warnings"] == []


def test_a_side_that_scatters_so_far_that_no_change_would_show_agrees_with_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small, large = SMALL | {"zeta": None}, LARGE | {"zeta": None}
    steady = write(tmp_path / "steady", [small] * 6)
    wide = write(tmp_path / "wide", [small, large, small, small, large, large])

    code, said, text = judged(capsys, "diff", steady, wide)

    (kappa,) = said["numbers"]
    percent = 100.0 * kappa["b"]["std"] / kappa["b"]["value"]
    assert percent > 20.0
    assert kappa["not_judged"] == f"cannot tell: B has a sigma of {percent:.0f} %"
    assert not kappa["changed"]
    assert "verdict cannot tell" in text
    assert "agrees" not in text
    assert "over all 0" not in text
    assert "warning several_aircraft in B: sysid:1" in text
    assert (code, said["judged"]) == (5, 0)
    found = yawid.diff(steady, wide)
    assert (found.changed, found.judged) == (False, 0)
    assert found.numbers[0].not_judged == kappa["not_judged"]


def test_a_rough_number_that_is_known_from_0_is_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rough = {"zeta": 0.2, "zeta_std": 0.06, "kappa_std": None}
    one = write(tmp_path / "one", [SMALL | rough] * 8)
    other = write(tmp_path / "other", [SMALL | rough | {"zeta": 0.6}] * 8)
    alike = write(tmp_path / "alike", [SMALL | rough | {"zeta": 0.22}] * 8)

    code, said, _ = judged(capsys, "diff", one, other)
    assert (code, said["judged"]) == (7, 1)
    code, said, text = judged(capsys, "diff", one, alike)
    assert (code, said["judged"]) == (0, 1)
    assert "agrees" in text
