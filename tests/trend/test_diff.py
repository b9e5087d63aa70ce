"""``yawid diff``: real runs, and runs whose summary was given a flight, next to data sets."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
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
from printed import answered

from yawid.cli.main import main
from yawid.sinks.mcap.reader import open_answered
from yawid.trend.days import DAY_US
from yawid.trend.diff import _facts

Made = Callable[..., Path]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    options = ("--rate", 10, "--also", "none", "--manoeuvres", "off", "--to", 60)
    return replayed(C172P, tmp_path_factory.mktemp("run"), *options)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("flown"))


@pytest.fixture(scope="module")
def made(run: Path) -> Made:
    """Make a run whose flight has the numbers given; each one is made once."""
    by_hand, known = four_of_a_flight().to_json(), list[dict[str, Any]]()

    def make(**flight: Any) -> Path:
        given = {"zeta": 0.15, "kappa": 0.12} | flight
        if given not in known:
            known.append(given)
        path = run.with_name(f"{known.index(given)}.mcap")
        own = dict(given)
        kappa = own.pop("kappa")
        roll = {"wn_rad_s": kappa * 30.0, "wn_std": 0.06, "zeta": own.pop("zeta"),
                "zeta_std": 0.006}  # fmt: skip
        of = {"loop": "airframe", "dutch_roll": roll, "kappa_rad_m": {"value": kappa, "std": 0.002}}
        of = {"manoeuvres": by_hand["manoeuvres"], "flight": by_hand["flight"] | of | own}
        return path if path.exists() else forge(run, path, summary=lambda old: old | of)

    return make


def told(capsys: pytest.CaptureFixture[str], a: Path, b: Path) -> tuple[int, Any, dict[str, Any]]:
    """Return the exit code of a comparison, its JSON object and its numbers by their names."""
    code, said = answered(capsys, "diff", a, b)
    return code, said, {each["quantity"]: each for each in said["numbers"]}


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


def test_a_run_next_to_itself_is_no_change_and_one_without_a_verdict_is_not_compared(
    flown: Path, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said, numbers = told(capsys, flown, flown)
    assert (code, said["facts"]) == (0, [])
    assert {each["difference"] for each in said["numbers"]} == {0.0}
    assert set(numbers) >= {"wn_rad_s", "zeta"}

    code, said, _ = told(capsys, run, run)
    assert code == 5
    assert {each["not_judged"] for each in said["numbers"]} == {"A has no verdict"}


def test_the_samples_of_a_file_are_there_as_often_as_they_are_asked_for(flown: Path) -> None:
    """Once for the models of its manoeuvres, and again for their decays"""
    facts = _facts(open_answered(flown))
    models, decays = (facts.flown(facts.used) for _ in range(2))
    assert len(models) == len(facts.used) > 0
    assert [len(each.t) for each in decays] == [len(each.t) for each in models]


@pytest.mark.parametrize(("zeta", "code"), [(0.165, 0), (0.12, 7)])
def test_a_difference_is_judged_by_the_total_sigmas_of_both_over_all_numbers(
    made: Made, capsys: pytest.CaptureFixture[str], zeta: float, code: int
) -> None:
    exits, said, numbers = told(capsys, made(), made(zeta=zeta))

    found = numbers["zeta"]
    assert (exits, found["changed"]) == (code, code == 7)
    assert found["sigmas"] == pytest.approx((zeta - 0.15) / (0.006 * 2**0.5))
    one = 2.0 * scipy.stats.norm.sf(abs(found["sigmas"]))
    assert found["p"] == pytest.approx(said["judged"] * one, rel=1e-4)
    assert said["judged"] >= 2
    assert numbers["wn_rad_s"]["not_judged"] == "varies with the airspeed: see wn/V"
    assert main(["diff", str(made()), str(made(zeta=zeta))]) == code
    shown = " ".join(capsys.readouterr().out.split())
    assert {"wn", "wn/V", "zeta"} <= set(shown.split())
    assert "wn/V in rad/m" in shown
    assert "wn_rad_s" not in shown


def test_another_loop_is_not_judged(made: Made, capsys: pytest.CaptureFixture[str]) -> None:
    other = made(zeta=0.5, loop="with_roll_loop")
    code, said, _ = told(capsys, made(), other)

    assert code == 5
    assert {each["not_judged"] for each in said["numbers"]} == {"another loop"}
    assert said["facts"][0] == {
        "what": "loop", "a": "airframe", "b": "with_roll_loop", "changed": False,
    }  # fmt: skip
    assert main(["diff", str(made()), str(other)]) == 5
    assert "nothing could be compared" in capsys.readouterr().out


def test_channels_and_verdict_are_changes_and_the_configuration_is_said(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def given(summary: Any) -> Any:
        summary["channels"]["rudder"]["source"] = "SERVO_OUTPUT_RAW.servo9_raw"
        return summary

    def configured(name: str, record: dict[str, str]) -> dict[str, str]:
        return record | {"memory": "0.5"} if name == "configuration" else record

    code, said, _ = told(capsys, flown, forge(flown, tmp_path / "o.mcap", metadata=configured))
    assert code == 0
    assert [fact["what"] for fact in said["facts"]] == ["configuration memory"]

    assert main(["diff", str(flown), str(forge(flown, tmp_path / "p.mcap", summary=given))]) == 7
    out = " ".join(capsys.readouterr().out.split())
    assert "channel rudder: " in out
    assert "servo9_raw in B" in out


def test_a_run_and_its_fleet_are_compared_as_one_flight_more_of_its_own_vehicle(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dataset = fleet(tmp_path / "fleet")

    code, said, numbers = told(capsys, dataset, made(zeta=0.155))
    assert (code, set(numbers)) == (0, {"zeta", "kappa_rad_m"})
    assert {each["vehicle"] for each in said["numbers"]} == {"sysid:1"}
    assert numbers["zeta"]["a"]["value"] == pytest.approx(0.15, abs=0.002)

    code, _, numbers = told(capsys, dataset, made(zeta=0.10))
    assert code == 7
    assert {name: each["changed"] for name, each in numbers.items()} == {
        "zeta": True, "kappa_rad_m": False,
    }  # fmt: skip

    reason = {"id": "not_excited", "weight": "fatal", "text": "the rudder is at rest"}
    verdict = {"usable": False, "method": "rml", "reasons": [reason]}
    code, said, _ = told(capsys, dataset, made(zeta=0.05, verdict=verdict))
    assert (code, said["changed"]) == (5, False)
    assert {each["not_judged"] for each in said["numbers"]} == {"B is not usable: not_excited"}

    others = fleet(tmp_path / "others", sysids=range(2, 8))
    code, said, _ = told(capsys, others, made())
    assert code == 0
    assert "zeta: compared with all 6 vehicles" in said["notes"]


def test_two_data_sets_are_compared_vehicle_by_vehicle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = fleet(tmp_path / "a", sysids=range(1, 4))
    after = fleet(tmp_path / "b", zeta=0.12, sysids=range(2, 4))

    code, said, _ = told(capsys, before, after)

    assert (code, said["notes"]) == (7, ["only in A: sysid:1 (airframe)"])
    assert {(e["vehicle"], e["quantity"]): e["changed"] for e in said["numbers"]} == {
        (f"sysid:{i}", q): q == "zeta" for i in (2, 3) for q in ("zeta", "kappa_rad_m")
    }
    assert main(["diff", str(before), str(before)]) == 0
    assert main(["diff", str(before), str(tmp_path)]) == 6


@pytest.mark.parametrize("unlike", [{"airspeed_m_s": None}, {"airspeed_source": "ground speed"},
                                    {"airspeed_m_s": 31.0}])  # fmt: skip
def test_wn_without_kappa_is_judged_at_one_known_airspeed_alone(
    made: Made, capsys: pytest.CaptureFixture[str], unlike: dict[str, Any]
) -> None:
    bare = {"kappa_rad_m": None, "K_per_V": None, "airspeed_m_s": 30.0,
            "airspeed_source": "airspeed"}  # fmt: skip
    assert told(capsys, made(**bare), made(kappa=0.15, **bare))[2]["wn_rad_s"]["changed"]

    code, _, numbers = told(capsys, made(**bare), made(kappa=0.15, **(bare | unlike)))
    assert "airspeed" in numbers["wn_rad_s"]["not_judged"]
    assert code == 0, "zeta is judged, and agrees"


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

    code, said, _ = told(capsys, made(), tmp_path)

    assert (code, said["judged"], said["changed"]) == (5, 0, False)
    assert words in " ".join(said["notes"])


def test_a_run_is_judged_by_students_t_with_the_scatter_between_flights(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    zeta = np.array([0.150, 0.162, 0.141, 0.155])
    rows = [flight(1, i, START_US + i * DAY_US, zeta=z, zeta_std=0.001) for i, z in enumerate(zeta)]
    write_fleet(tmp_path / "four", rows)

    number = told(capsys, tmp_path / "four", made(zeta=0.100))[2]["zeta"]

    # Alike in all, with sigmas far below the scatter: the t of one more of a normal sample.
    t = (0.100 - zeta.mean()) / (zeta.std(ddof=1) * (1.0 + 1.0 / 4.0) ** 0.5)
    assert number["sigmas"] == pytest.approx(t, rel=0.12)
    assert number["p"] == pytest.approx(2.0 * scipy.stats.t.sf(abs(number["sigmas"]), 3), rel=1e-6)


def test_a_run_is_compared_with_the_other_flights_and_not_with_its_own_log(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of wn / V of the four others mean and median are .13; of all five they are .144 and .14."""
    rows = [flight(1, i, START_US + i * 7 * DAY_US, kappa_rad_m=kappa, kappa_std=0.002)
            for i, kappa in enumerate((0.12, 0.16, 0.10, 0.14, 0.20))]  # fmt: skip
    rows[-1]["log_sha256"] = sha256(C172P.read_bytes()).hexdigest()
    write_fleet(tmp_path, rows)

    kappa = told(capsys, tmp_path, made(kappa=0.20))[2]["kappa_rad_m"]

    assert kappa["a"]["value"] == pytest.approx(0.13, abs=0.004)
    assert kappa["difference"] == pytest.approx(0.07, abs=0.004)


def test_one_more_of_few_flights_is_seldom_called_changed() -> None:
    assert judge_diff(5, 60) <= 2


@pytest.mark.long
@pytest.mark.parametrize("flights", [3, 5, 8, 12, 30])
def test_of_four_thousand_one_in_fifty_at_most_is_called_changed(flights: int) -> None:
    assert judge_diff(flights, 4000) <= 80
