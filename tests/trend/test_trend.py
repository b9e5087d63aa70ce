"""``yawid trend`` on data sets on disk, written as ``yawid fleet`` writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
from checks.judge_trend import START_US, Plan, flight
from fleets import FALLS, draw_fleet, write_fleet
from printed import printed

from yawid.cli.main import main
from yawid.trend.days import DAY_US, HOUR_US, YEAR_US
from yawid.trend.trend import trend


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


def told(capsys: pytest.CaptureFixture[str], *argv: object) -> tuple[int, Any]:
    code = main([*map(str, argv), "--json"])
    return code, printed(str(argv[0]), capsys.readouterr().out)


def steady(vehicle: int, count: int, **more: Any) -> list[dict[str, Any]]:
    numbers = {"zeta": 0.15, "zeta_std": 0.01, "kappa_rad_m": 0.12, "kappa_std": 0.002,
               "K_per_V": 0.04, "K_per_V_std": 0.002}  # fmt: skip
    return [
        flight(vehicle, i, START_US + i * 7 * DAY_US, **(numbers | more | {
            "zeta": 0.15 + 0.01 * (-1) ** i}))
        for i in range(count)
    ]  # fmt: skip


def test_the_fall_is_found_nothing_else_is_and_the_exit_code_is_7(
    fallen: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = told(capsys, "trend", fallen)

    assert code == 7
    assert said["changed"] is True
    assert said["false_alarm_rate"] == 0.01
    assert said["histories_tested"] == 60
    assert said["numbers_tested"] == 3600
    changed = [each for each in said["followed"] if "change" in each]
    assert [(each["vehicle"], each["quantity"]) for each in changed] == [(FALLS, "zeta")]
    change = changed[0]["change"]
    assert change["kind"] == "slope"
    assert change["percent"] == pytest.approx(-20.0, abs=6.0)
    assert change["sigmas"] < -4.0
    assert change["p"] < 0.01
    assert change["measured_otherwise"] == ["config_hash: c before, d after"]
    slope = changed[0]["slope_per_year"]
    assert slope["value"] < -3.0 * slope["std"]
    assert changed[0]["beside"]["vehicles"] == 20
    outliers = [one for each in said["followed"] for one in each["outliers"]]
    assert 0.02 < len(outliers) / said["numbers_tested"] < 0.06


def test_one_vehicle_is_judged_among_all_and_exits_by_its_own_changes(
    fallen: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = told(capsys, "trend", fallen, "--vehicle", "sysid:2")

    assert code == 0
    assert {each["vehicle"] for each in said["followed"]} == {"sysid:2"}
    assert said["histories_tested"] == 60
    assert main(["trend", str(fallen), "--vehicle", "sysid:99"]) == 2
    assert "sysid:99: not in" in capsys.readouterr().err


def test_the_terminal_tells_what_changed_first_and_at_which_rate_it_errs(
    fallen: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["trend", str(fallen)]) == 7

    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "verdict  1 CHANGED"
    assert lines[2].startswith(f"  {FALLS} (airframe) zeta fell by ")
    assert all(len(line) <= 80 for line in lines[1:])
    assert "false alarms: 1 % of data" in " ".join(lines)


def test_the_page_stands_alone_and_shows_the_vehicle_that_changed_first(
    fallen: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "r.html"
    argv = ["trend", str(fallen), "--vehicle", FALLS, "-o", str(page)]
    assert main(argv) == 7
    assert main(argv) == 6, "it must not be overwritten"
    assert "--force" in capsys.readouterr().err

    text = page.read_text(encoding="utf-8")
    assert "1 of 3 histories changed." in text
    assert f"<b>{FALLS} ζ</b>fell by " in text
    assert text.count("<svg") == 1
    assert "<script" not in text


def test_what_cannot_be_followed_is_left_out_and_counted(tmp_path: Path) -> None:
    rows = steady(1, 14)
    for i, bad in enumerate(
        (
            {"zeta": 0.4, "zeta_std": 0.01, "usable": False},
            {"zeta": 0.4, "zeta_std": 0.01, "date": None},
            {"zeta": 0.4},
            {"zeta": None, "zeta_std": None},
        )
    ):
        rows.append(flight(1, 20 + i, START_US) | bad)
    write_fleet(tmp_path, rows)

    said, _ = trend(tmp_path)

    assert said.left_out == {
        "not usable": 1, "without a date": 1, "without a number and its sigma": 2,
    }  # fmt: skip
    assert [each.flights for each in said.followed] == [14, 14, 14]


def test_the_bare_airframe_has_a_history_of_its_own(tmp_path: Path) -> None:
    """Its zeta falls by a third while the aircraft flown with its roll loop stays as it was.

    A flight with answers of two loops has one airframe. Wn / V is by the equivalent airspeed: at
    2 000 m of the standard atmosphere, 0.9065 of the true one.
    """
    rows = steady(1, 30, loop="with_roll_loop", altitude_m=2000.0)
    for i, row in enumerate(rows):
        row |= {"bare_wn_rad_s": 2.4, "bare_wn_std": 0.05, "bare_airspeed_m_s": 50.0,
                "bare_zeta": (0.30 if i < 18 else 0.20) + 0.01 * (-1) ** i,
                "bare_zeta_std": 0.01}  # fmt: skip
    rows.append(rows[4] | {"loop": "airframe"})
    write_fleet(tmp_path, rows)

    said, _ = trend(tmp_path)

    bare = {each.quantity: each for each in said.followed if each.loop == "bare"}
    assert {name: each.flights for name, each in bare.items()} == {"kappa_rad_m": 30, "zeta": 30}
    equivalent = 50.0 * (1.0 - 0.0065 * 2000.0 / 288.15) ** (4.2559 / 2.0)
    assert bare["kappa_rad_m"].now.value == pytest.approx(2.4 / equivalent, rel=1e-3)
    changed = [(each.loop, each.quantity) for each in said.followed if each.change is not None]
    assert changed == [("bare", "zeta")]
    assert said.flights == 30


def test_ordinary_flights_have_a_history_of_their_own_without_any_manoeuvre(tmp_path: Path) -> None:
    """Their zeta falls by a third, and nobody ever moved a rudder."""
    nothing = {"loop": None, "wn_rad_s": None, "zeta": None, "kappa_rad_m": None, "K_per_V": None}
    rows = [row | nothing | {"usable": False, "answer": None} for row in steady(1, 30)]
    for i, row in enumerate(rows):
        row |= {"ordinary_wn_rad_s": 2.4, "ordinary_kappa_rad_m": 0.048,
                "ordinary_kappa_std": 0.001,
                "ordinary_zeta": (0.30 if i < 18 else 0.20) + 0.01 * (-1) ** i,
                "ordinary_zeta_std": 0.01}  # fmt: skip

    write_fleet(tmp_path, rows)
    said, _ = trend(tmp_path)

    assert {each.loop for each in said.followed} == {"ordinary"}
    found = {each.quantity: each for each in said.followed}
    assert found["kappa_rad_m"].now.value == pytest.approx(0.048)
    assert found["kappa_rad_m"].change is None
    assert found["zeta"].change is not None


def test_an_old_flight_without_kappa_still_tells_its_damping(tmp_path: Path) -> None:
    rows = steady(1, 3) + steady(2, 2, kappa_rad_m=None, kappa_std=None)
    rows[0] |= {"kappa_rad_m": None, "kappa_std": None}
    write_fleet(tmp_path, rows)

    said, _ = trend(tmp_path)

    found = {(each.vehicle, each.quantity): each.flights for each in said.followed}
    assert found == {
        ("sysid:1", "kappa_rad_m"): 2, ("sysid:1", "zeta"): 3, ("sysid:1", "K_per_V"): 3,
        ("sysid:2", "zeta"): 2, ("sysid:2", "K_per_V"): 2,
    }  # fmt: skip


def test_a_vehicle_with_two_flights_has_a_level_and_neither_slope_nor_test(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fleet(tmp_path, steady(1, 2))

    code, said = told(capsys, "trend", tmp_path)

    assert code == 5
    for each in said["followed"]:
        assert each["now"]["std"] > 0.0
        assert each["tested"] is False
        assert not {"slope_per_year", "between_std", "change"} & set(each)
    assert main(["trend", str(tmp_path), "-o", str(tmp_path / "r.html")]) == 5
    assert "too few days" in capsys.readouterr().out


@pytest.mark.parametrize("span_us", [3_000_000, 1092 * DAY_US])  # 3 s, 3 years
def test_a_page_has_dates_whatever_they_span_and_says_what_an_id_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], span_us: int
) -> None:
    rows = steady(1, 2)
    for row in rows:
        row["vehicle"] = "sysid:1"
    rows[1]["date"] = rows[0]["date"] + span_us
    write_fleet(tmp_path, rows)
    assert main(["trend", str(tmp_path), "-o", str(tmp_path / "r.html")]) == 5
    assert "several aircraft may share" in " ".join(capsys.readouterr().out.split())


def test_flights_that_agree_better_than_their_sigmas_are_known_no_better_than_those(
    tmp_path: Path,
) -> None:
    rows = steady(1, 16)
    for i, row in enumerate(rows):
        row |= {"zeta": 0.15 + (0.006 if i == 9 else 0.0001 * (-1) ** i)}
        row["date"] = START_US + i * DAY_US
    write_fleet(tmp_path, rows)

    said, _ = trend(tmp_path)

    zeta = next(each for each in said.followed if each.quantity == "zeta")
    assert zeta.outliers == []
    assert zeta.now.std == pytest.approx(0.01 / 16**0.5, rel=0.1)
    assert zeta.tested
    assert zeta.slope_per_flight is not None
    assert zeta.slope_per_year is None, "they were flown within a month"


def test_the_airframe_and_the_same_aircraft_with_its_roll_loop_are_two_histories(
    tmp_path: Path,
) -> None:
    rows = steady(1, 28)
    for row in rows[14:]:
        row |= {"loop": "with_roll_loop", "zeta": row["zeta"] * 1.5}
    write_fleet(tmp_path, rows)

    said, _ = trend(tmp_path)

    assert {each.loop for each in said.followed} == {"airframe", "with_roll_loop"}
    assert not said.changed


def test_a_vehicles_name_is_shown_and_never_obeyed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = steady(1, 2)
    for row in rows:
        row |= {"vehicle": "[red]:x:<b>\x1b[2J"}
    write_fleet(tmp_path, rows)

    assert main(["trend", str(tmp_path), "-o", str(tmp_path / "r.html")]) == 5
    out, page = capsys.readouterr().out, (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "[red]:x:<b>" in out
    assert "[red]:x:&lt;b&gt;" in page
    assert "\x1b" not in out + page
    assert "<b>" not in page


def test_a_folder_that_is_no_data_set_is_one_line_and_6_an_empty_one_is_5(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["trend", str(tmp_path)]) == 6
    assert "is not a data set" in capsys.readouterr().err
    write_fleet(tmp_path, [])
    assert main(["trend", str(tmp_path), "-o", str(tmp_path / "r.html")]) == 5
    assert "0 flights" in capsys.readouterr().out


def test_a_drawn_fleet_in_which_nothing_changes_is_not_changed(tmp_path: Path) -> None:
    write_fleet(tmp_path, draw_fleet(4, Plan()))
    assert not trend(tmp_path)[0].changed


def test_flights_of_one_day_are_one_number_and_no_history(tmp_path: Path) -> None:
    rows = steady(1, 16)
    for i, row in enumerate(rows):
        row |= {"date": START_US + i * HOUR_US, "zeta": 0.15 if i < 8 else 0.25}
    write_fleet(tmp_path, rows)

    said, _ = trend(tmp_path)

    assert [(each.flights, each.days, each.tested) for each in said.followed] == [
        (16, 1, False)
    ] * 3
    assert not said.changed


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
    code, said = told(capsys, "trend", tmp_path)

    zeta = said["followed"][0]
    assert (code, said["changed"], "change" in zeta, "season" in zeta) == (0, False, False, False)
    assert zeta["may_be_season"]["p"] < 0.01
    assert main(["trend", str(tmp_path), "-o", str(tmp_path / "r.html")]) == 0
    for words in (capsys.readouterr().out, (tmp_path / "r.html").read_text(encoding="utf-8")):
        assert "a season may do the same: two years of" in " ".join(words.split())


def test_a_fall_larger_than_a_season_is_an_alarm_and_a_quick_one_needs_not_be(
    tmp_path: Path,
) -> None:
    for name, rows in (
        ("large", yearly(24, 7, swing=0.0, fall=0.25)),
        ("quick", yearly(24, 1, swing=0.0, fall=0.06)),
    ):
        write_fleet(tmp_path / name, rows)
        assert trend(tmp_path / name)[0].changed, name


def test_two_years_show_the_season_and_what_changes_next_to_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fleet(tmp_path / "steady", yearly(110, 7, swing=0.1))
    code, said = told(capsys, "trend", tmp_path / "steady")
    zeta = said["followed"][0]
    assert code == 0
    assert not {"change", "may_be_season"} & set(zeta)
    assert zeta["season"]["amplitude"]["value"] == pytest.approx(0.015, abs=0.0006)
    assert zeta["season"]["amplitude"]["std"] == pytest.approx(0.0015 * (2 / 110) ** 0.5, rel=0.3)
    assert zeta["season"]["peak"] in ("12-30", "12-31", "01-01", "01-02", "01-03")
    assert zeta["now"]["value"] == pytest.approx(0.15, abs=0.001)

    write_fleet(tmp_path / "fallen", yearly(110, 7, swing=0.1, fall=0.05))
    change = trend(tmp_path / "fallen")[0].followed[0].change
    assert change is not None
    assert change.percent == pytest.approx(-5.0, abs=1.0)
    assert abs(change.from_flight - 55) <= 3


def test_the_page_says_what_trend_cannot_do(fallen: Path, tmp_path: Path) -> None:
    main(["trend", str(fallen), "--vehicle", "sysid:2", "-o", str(tmp_path / "r.html")])
    page = (tmp_path / "r.html").read_text(encoding="utf-8")

    assert "What this cannot do" in page
    for words in ("12 days flown", "count as one", "4 % either way", "a campaign, a pilot"):
        assert words in page, words


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
        assert each.followed.beside is not None
        p_one = 2.0 * scipy.stats.t.sf(abs(each.followed.beside.sigmas), 5)
        assert each.followed.beside.p == pytest.approx(min(1.0, 6 * p_one))
    assert said.numbers_tested == 66
