"""``yawid diff``: real runs, and runs whose summary was given a flight, beside data sets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
from checks.judge_trend import START_US, flight, judge_diff
from finished_runs import replayed
from fleets import write_fleet
from forged_runs import forge
from hand_flights import four_of_a_flight
from places import C172P
from printed import printed

from yawid.cli.main import main
from yawid.sinks.mcap.reader import open_answered
from yawid.trend.days import DAY_US
from yawid.trend.diff import _facts

Made = Callable[..., Path]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("run"), "--manoeuvres", "off")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("flown"))


@pytest.fixture
def made(run: Path, tmp_path: Path) -> Made:
    """Make a run whose flight has the numbers given."""
    by_hand = four_of_a_flight().to_json()

    def make(name: str, zeta: float = 0.15, kappa: float = 0.12, **flight: Any) -> Path:
        def given(summary: Any) -> Any:
            own = by_hand["flight"] | {
                "loop": "airframe",
                "dutch_roll": {"wn_rad_s": kappa * 30.0, "wn_std": 0.06, "zeta": zeta,
                               "zeta_std": 0.006},
                "kappa_rad_m": {"value": kappa, "std": 0.002},
            }  # fmt: skip
            return summary | {"manoeuvres": by_hand["manoeuvres"], "flight": own | flight}

        return forge(run, tmp_path / name, summary=given)

    return make


def told(capsys: pytest.CaptureFixture[str], a: Path, b: Path) -> tuple[int, Any]:
    code = main(["diff", str(a), str(b), "--json"])
    return code, printed("diff", capsys.readouterr().out)


def numbers(said: Any) -> dict[str, Any]:
    return {each["quantity"]: each for each in said["numbers"]}


def fleet(folder: Path, zeta: float = 0.15, sysids: range = range(1, 2)) -> Path:
    rows = [
        flight(
            sysid, i, START_US + i * DAY_US, zeta=zeta + 0.005 * (-1) ** i, zeta_std=0.006,
            kappa_rad_m=0.12 + 0.001 * (-1) ** i, kappa_std=0.002,
        )
        for sysid in sysids
        for i in range(10)
    ]  # fmt: skip
    write_fleet(folder, rows)
    return folder


def test_a_run_beside_itself_is_no_change(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = told(capsys, flown, flown)

    assert code == 0
    assert said["facts"] == []
    assert {each["difference"] for each in said["numbers"]} == {0.0}
    assert set(numbers(said)) >= {"wn_rad_s", "zeta"}


def test_the_samples_of_a_file_are_there_as_often_as_they_are_asked_for(flown: Path) -> None:
    """Once for the models of its manoeuvres, and again for their decays"""
    facts = _facts(open_answered(flown))

    assert facts is not None
    models, decays = (facts.flown(facts.used) for _ in range(2))
    assert len(models) == len(facts.used) > 0
    assert [len(each.t) for each in decays] == [len(each.t) for each in models]


def test_runs_that_were_not_judged_are_not_compared(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = told(capsys, run, run)

    assert code == 5
    assert {each["not_judged"] for each in said["numbers"]} == {"A has no verdict"}


def test_a_difference_is_judged_by_the_total_sigmas_of_both(
    made: Made, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = told(capsys, made("a.mcap"), made("b.mcap", zeta=0.165))
    zeta = numbers(said)["zeta"]
    assert zeta["sigmas"] == pytest.approx(0.015 / (0.006 * 2**0.5))
    assert (code, zeta["changed"]) == (0, False)

    code, said = told(capsys, made("c.mcap"), made("d.mcap", zeta=0.12))
    zeta = numbers(said)["zeta"]
    assert zeta["sigmas"] == pytest.approx(-0.03 / (0.006 * 2**0.5))
    assert (code, zeta["changed"]) == (7, True)


def test_wn_goes_with_the_airspeed_and_another_loop_is_not_judged(
    made: Made, capsys: pytest.CaptureFixture[str]
) -> None:
    _, said = told(capsys, made("a.mcap"), made("b.mcap"))
    assert numbers(said)["wn_rad_s"]["not_judged"] == "varies with the airspeed: see wn/V"
    assert main(["diff", str(made("a.mcap")), str(made("b.mcap"))]) == 0
    printed = capsys.readouterr().out
    assert {"wn", "wn/V", "zeta"} <= set(printed.split())
    assert "wn/V in rad/m" in " ".join(printed.split())
    assert "wn_rad_s" not in printed

    c, d = made("c.mcap"), made("d.mcap", zeta=0.5, loop="with_roll_loop")
    code, said = told(capsys, c, d)
    assert {each["not_judged"] for each in said["numbers"]} == {"another loop"}
    assert main(["diff", str(c), str(d)]) == 5
    assert "nothing could be compared" in capsys.readouterr().out
    assert said["facts"][0] == {
        "what": "loop", "a": "airframe", "b": "with_roll_loop", "changed": False,
    }  # fmt: skip
    assert code == 5


def test_channels_and_verdict_are_changes_and_the_configuration_is_told(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def given(summary: Any) -> Any:
        summary["channels"]["rudder"]["source"] = "SERVO_OUTPUT_RAW.servo9_raw"
        return summary

    def configured(name: str, record: dict[str, str]) -> dict[str, str]:
        return record | {"memory": "0.5"} if name == "configuration" else record

    other = forge(flown, tmp_path / "o.mcap", metadata=configured)
    code, said = told(capsys, flown, other)
    assert code == 0
    assert [fact["what"] for fact in said["facts"]] == ["configuration memory"]

    other = forge(flown, tmp_path / "p.mcap", summary=given)
    assert main(["diff", str(flown), str(other)]) == 7
    out = capsys.readouterr().out
    assert "channel rudder: " in out
    assert "servo9_raw in B" in " ".join(out.split())


def test_a_run_beside_its_fleet_is_one_flight_more_of_its_own_vehicle(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dataset = fleet(tmp_path / "fleet")

    code, said = told(capsys, dataset, made("a.mcap", zeta=0.155))
    assert code == 0
    assert {each["vehicle"] for each in said["numbers"]} == {"sysid:1"}
    assert set(numbers(said)) == {"zeta", "kappa_rad_m"}
    assert numbers(said)["zeta"]["a"]["value"] == pytest.approx(0.15, abs=0.002)

    code, said = told(capsys, dataset, made("b.mcap", zeta=0.10))
    assert code == 7
    assert numbers(said)["zeta"]["changed"]
    assert not numbers(said)["kappa_rad_m"]["changed"]


def test_a_vehicle_that_is_not_in_the_fleet_is_compared_with_all(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = told(capsys, fleet(tmp_path / "fleet", sysids=range(2, 8)), made("a.mcap"))

    assert code == 0
    assert "zeta: compared with all 6 vehicles" in said["notes"]


def test_two_data_sets_are_compared_vehicle_by_vehicle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = fleet(tmp_path / "a", sysids=range(1, 4))
    after = fleet(tmp_path / "b", zeta=0.12, sysids=range(2, 4))

    code, said = told(capsys, before, after)

    assert code == 7
    found = {(e["vehicle"], e["quantity"]): e["changed"] for e in said["numbers"]}
    assert found == {
        (f"sysid:{i}", q): q == "zeta" for i in (2, 3) for q in ("zeta", "kappa_rad_m")
    }
    assert said["notes"] == ["only in A: sysid:1 (airframe)"]
    assert main(["diff", str(before), str(before)]) == 0
    assert main(["diff", str(before), str(tmp_path)]) == 6


@pytest.mark.parametrize("unlike", [{"airspeed_m_s": None}, {"airspeed_source": "ground speed"},
                                    {"airspeed_m_s": 31.0}])  # fmt: skip
def test_wn_without_kappa_is_judged_at_one_known_airspeed_alone(
    made: Made, capsys: pytest.CaptureFixture[str], unlike: dict[str, Any]
) -> None:
    bare = {"kappa_rad_m": None, "K_per_V": None, "airspeed_m_s": 30.0,
            "airspeed_source": "airspeed"}  # fmt: skip
    a = made("a.mcap", **bare)
    _, said = told(capsys, a, made("b.mcap", kappa=0.15, **bare))
    assert numbers(said)["wn_rad_s"]["changed"]

    code, said = told(capsys, a, made("c.mcap", kappa=0.15, **(bare | unlike)))
    assert "airspeed" in numbers(said)["wn_rad_s"]["not_judged"]
    assert code == 0, "zeta is judged, and agrees"


def test_a_run_that_is_not_usable_is_not_judged_and_its_verdict_is_said(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verdict = {"usable": False, "method": "rml", "reasons": [
        {"id": "not_excited", "weight": "fatal", "text": "the rudder is at rest"}]}  # fmt: skip
    bad = made("a.mcap", zeta=0.05, verdict=verdict)

    code, said = told(capsys, fleet(tmp_path / "fleet"), bad)

    assert code == 5
    assert {each["not_judged"] for each in said["numbers"]} == {"B is not usable: not_excited"}
    assert not any(each["changed"] for each in said["numbers"])


@pytest.mark.parametrize(
    ("days", "loop", "words"),
    [
        (2, "airframe", "has 2 flights of sysid:1 on 2 days, and 1 vehicles: to compare a run, 3"),
        (3, "unknown", "has flights of the loop unknown;"),
        (0, "airframe", "has no usable flight with a date"),
    ],
)
def test_where_nothing_can_be_compared_it_says_why_and_exits_5(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str], days: int, loop: str, words: str
) -> None:
    rows = [flight(1, i, START_US + i * DAY_US, loop=loop, zeta=0.15, zeta_std=0.01)
            for i in range(days)]  # fmt: skip
    write_fleet(tmp_path, rows)

    code, said = told(capsys, made("a.mcap"), tmp_path)

    assert (code, said["judged"], said["changed"]) == (5, 0, False)
    assert words in " ".join(said["notes"])


def test_a_run_is_judged_by_students_t_with_the_scatter_between_flights(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    zeta = np.array([0.150, 0.162, 0.141, 0.155])
    rows = [flight(1, i, START_US + i * DAY_US, zeta=z, zeta_std=0.001) for i, z in enumerate(zeta)]
    write_fleet(tmp_path / "four", rows)

    _, said = told(capsys, tmp_path / "four", made("a.mcap", zeta=0.100))

    # Alike in all, with sigmas far below the scatter: the t of one more of a normal sample.
    number = numbers(said)["zeta"]
    t = (0.100 - zeta.mean()) / (zeta.std(ddof=1) * (1.0 + 1.0 / 4.0) ** 0.5)
    assert number["sigmas"] == pytest.approx(t, rel=0.12)
    assert number["p"] == pytest.approx(2.0 * scipy.stats.t.sf(abs(number["sigmas"]), 3), rel=1e-6)


def test_p_is_of_all_numbers_judged(made: Made, capsys: pytest.CaptureFixture[str]) -> None:
    _, said = told(capsys, made("a.mcap"), made("b.mcap", zeta=0.165))

    zeta = numbers(said)["zeta"]
    assert said["judged"] >= 2
    one = 2.0 * scipy.stats.norm.sf(abs(zeta["sigmas"]))
    assert zeta["p"] == pytest.approx(said["judged"] * one, rel=1e-4)


def test_one_more_of_few_flights_is_seldom_called_changed() -> None:
    assert judge_diff(5, 60) <= 2


@pytest.mark.long
@pytest.mark.parametrize("flights", [3, 5, 8, 12, 30])
def test_of_four_thousand_one_in_fifty_at_most_is_called_changed(flights: int) -> None:
    assert judge_diff(flights, 4000) <= 80
