"""``yawid diff``: real runs, and runs whose summary was given a flight, beside data sets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from finished_runs import replayed
from forged_runs import forge
from hand_flights import four_of_a_flight
from judge_trend import START_US, flight, write_fleet
from places import C172P
from printed import printed

from yawid.cli.main import main
from yawid.trend.days import DAY_US

Made = Callable[..., Path]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("run"), "--manoeuvres", "off")


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


def test_a_run_beside_itself_is_no_change(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = told(capsys, run, run)

    assert code == 0
    assert said["facts"] == []
    assert {each["difference"] for each in said["numbers"]} == {0.0}
    assert set(numbers(said)) == {"wn_rad_s", "zeta"}


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
    assert numbers(said)["wn_rad_s"]["not_judged"] == "goes with the airspeed: see ωn/V"

    code, said = told(capsys, made("c.mcap"), made("d.mcap", zeta=0.5, loop="with_roll_loop"))
    assert {each["not_judged"] for each in said["numbers"]} == {"another loop"}
    assert said["facts"][0] == {
        "what": "loop", "a": "airframe", "b": "with_roll_loop", "changed": False,
    }  # fmt: skip
    assert code == 0


def test_channels_and_verdict_are_changes_and_the_configuration_is_told(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def given(summary: Any) -> Any:
        summary["channels"]["rudder"]["source"] = "SERVO_OUTPUT_RAW.servo9_raw"
        return summary

    def configured(name: str, record: dict[str, str]) -> dict[str, str]:
        return record | {"forgetting": "0.5"} if name == "configuration" else record

    other = forge(run, tmp_path / "o.mcap", metadata=configured)
    code, said = told(capsys, run, other)
    assert code == 0
    assert [fact["what"] for fact in said["facts"]] == ["configuration forgetting"]

    other = forge(run, tmp_path / "p.mcap", summary=given)
    assert main(["diff", str(run), str(other)]) == 7
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
