"""``trend`` and ``diff`` where there is nothing to judge, or several aircraft share an id."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from checks.judge_trend import START_US, flight
from fleets import write_fleet
from printed import printed

import yawid
from yawid.cli.main import main

DAY_US = 86_400_000_000
SMALL = {"autopilot": 3, "airspeed_m_s": 22.0, "airspeed_source": "airspeed",
         "kappa_rad_m": 0.46, "kappa_std": 0.01, "zeta": 0.61, "zeta_std": 0.03}  # fmt: skip
LARGE = SMALL | {"airspeed_m_s": 50.0, "kappa_rad_m": 0.048, "kappa_std": 0.001, "zeta": 0.23}
"""Flights of a model aircraft and of a Cessna 172, as two that share sysid 1 have had them."""


def write(folder: Path, flights: list[dict[str, Any]], **more: Any) -> Path:
    """Write flights of sysid 1, one a day, as a data set."""
    days = enumerate(flights)
    write_fleet(folder, [flight(1, i, START_US + i * DAY_US, **each, **more) for i, each in days])
    return folder


def judged(capsys: pytest.CaptureFixture[str], *argv: object) -> tuple[int, Any, str]:
    """Return a command's exit code, its JSON object and its text in one line."""
    arguments = [*map(str, argv)]
    code = main([*arguments, "--json"])
    said = printed(arguments[0], capsys.readouterr().out)
    assert main(arguments) == code
    return code, said, " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("days", [0, 2, 11])
def test_a_trend_that_tested_nothing_is_not_steady_and_exits_5(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], days: int
) -> None:
    dataset, page = write(tmp_path / "data", [SMALL] * days), tmp_path / "r.html"

    code, said, text = judged(capsys, "trend", dataset)

    assert (code, said["changed"], said["judged"]) == (5, False, 0)
    needed = f"nothing was tested: 12 days flown are needed, there are {days}"
    assert f"verdict {needed}" in text
    for words in ("steady", "false alarms", "over all 0"):
        assert words not in text
    assert main(["trend", str(dataset), "-o", str(page)]) == 5
    shown = page.read_text(encoding="utf-8")
    assert f"N{needed[1:]}." in shown
    assert "Nothing changed" not in shown
    assert 'header class="unusable"' in shown


def test_twelve_days_are_tested_and_steady(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said, text = judged(capsys, "trend", write(tmp_path, [SMALL] * 12))

    assert (code, said["judged"], said["warnings"]) == (0, 2, [])
    assert "verdict steady" in text
    assert "over all 2 histories tested" in text


def test_several_aircraft_under_one_id_are_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = [SMALL, LARGE] * 6
    _, said, text = judged(capsys, "trend", write(tmp_path / "speeds", both))
    (warning,) = said["warnings"]
    assert (warning["id"], warning["weight"]) == ("several_aircraft", "warning")
    assert "sysid:1 may be several aircraft, at 22 m/s and 50 m/s: name them" in warning["text"]
    assert "--vehicle-from folder" in warning["text"]
    assert f"warning several_aircraft: {warning['text']}" in text

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
