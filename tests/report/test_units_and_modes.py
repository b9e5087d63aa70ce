"""A run says the unit its rudder was estimated in, and names the flight modes, wherever it is read.

The log is an ArduPlane's with its HEARTBEATs in FBWA (custom_mode 5).
"""

from __future__ import annotations

from pathlib import Path

import pytest
from finished_runs import replayed
from places import REPLAY_LOGS
from report_page import Page
from sinks.mcap.mcap_reading import decoded
from sinks.rerun.rerun_reading import recorded, statics

from yawid.cli.main import main
from yawid.report.write import report
from yawid.sinks.mcap.reader import open_run

LOG = REPLAY_LOGS / "sitl_fbwa_50hz" / "log.tlog"
OPTIONS = ("--rate", 25, "--memory", "inf")


@pytest.fixture(scope="module")
def in_rad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(LOG, tmp_path_factory.mktemp("rad"), *OPTIONS, "--rudder-max-deg", 25)


@pytest.fixture(scope="module")
def in_half_travel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(LOG, tmp_path_factory.mktemp("half"), *OPTIONS, "--manoeuvres", "off")


def test_with_the_travel_in_degrees_no_place_speaks_of_half_travel(in_rad: Path) -> None:
    run = open_run(in_rad)
    assert run.grid is not None
    assert run.grid.rudder_unit == "rad"
    units = run.metadata["units"]
    named = {name for name, unit in units.items() if "half" in unit}
    assert named == {"Sample.u", "Sample.aileron", "Commands.aileron"}  # the aileron's stays
    assert units["Modes.K"].startswith("rad/s per rad")
    text = Page(report(run)).text
    assert "rad/s per rad" in text
    assert "1/s² per rad" in text
    assert "steps by 1 rad" in text
    assert "per half-travel" not in text


def test_without_it_every_place_does(in_half_travel: Path) -> None:
    run = open_run(in_half_travel)
    assert run.metadata["units"]["Modes.K"].startswith("rad/s per half-travel")
    text = Page(report(run)).text
    assert "rad/s per half-travel" in text
    assert "per rad" not in text


def test_a_run_estimated_again_and_one_viewed_keep_unit_and_names(
    in_rad: Path, tmp_path: Path
) -> None:
    assert main(["replay", str(in_rad), "--orders", "3,3,3,1", "--out", str(tmp_path)]) == 0
    again = tmp_path / "log.mcap"
    first, second = open_run(in_rad).grid, open_run(again).grid
    assert first is not None
    assert second is not None
    assert (second.rudder_unit, second.autopilot, second.vehicle_type) == ("rad", 3, 1)
    for path in (in_rad, again):
        assert [mode.name for _, mode in decoded(path)["/yawid/mode"]] == ["FBWA"]
    assert main(["view", str(again), "--out", str(tmp_path / "a.rrd")]) == 0
    assert statics(tmp_path / "a.rrd", "/input", "SeriesLines:names") == [["rudder [rad]"]]
    lane = recorded(tmp_path / "a.rrd")["/state/flight_mode"]
    assert lane["StateChange:state"] == [["FBWA"]]
