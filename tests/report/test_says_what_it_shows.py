"""A page must not contradict its own answer, and every output says what it means in plain words."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from finished_runs import replayed
from PIL import Image
from places import C172P, REPLAY_LOGS, ROOT
from report_page import Page, first_screen
from sinks.mcap.mcap_reading import decoded
from sinks.rerun.rerun_reading import recorded, statics

import yawid
from yawid.cli.main import main
from yawid.report.write import report
from yawid.sinks.mcap.reader import open_run


def test_the_page_of_a_usable_flight_contradicts_nothing_and_numbers_every_manoeuvre(
    tmp_path: Path,
) -> None:
    """A flight with six manoeuvres."""
    log = REPLAY_LOGS / "c172p_three_speeds" / "log.tlog"
    run = yawid.load(replayed(log, tmp_path, "--to", 500))
    html = run.report(tmp_path / "R.html").read_text(encoding="utf-8")
    captions = re.findall(r"<figcaption.*?</figcaption>", html, re.DOTALL)
    (figure,) = re.findall(r'<figure id="whole">.*?</figure>', html, re.DOTALL)
    written = {text.strip() for text in re.findall(r"<text[^>]*>([^<]*)<", figure)}

    assert run.flight.method == "ct"
    assert "Can I use it? Yes" in first_screen(html)
    assert re.findall("raise nc|wrong order", Page("".join(captions)).text) == []
    assert {str(each.n) for each in run.summary.manoeuvres} - written == set()


def test_the_remedy_that_helps_comes_before_those_that_cannot(tmp_path: Path) -> None:
    """The rudder follows the aileron: neither more samples nor another order help."""
    run = yawid.replay(REPLAY_LOGS / "sitl_auto" / "log.tlog", ordinary="off")
    said = first_screen(run.report(tmp_path / "R.html").read_text(encoding="utf-8"))
    assert run.summary.verdict.reasons[0].id == "mixed_rudder"

    helps = said.index("Move the rudder without the aileron")
    vain = ("compare orders", "Choose a calmer stretch", "Choose a stretch of straight flight")
    assert [each for each in vain if 0 <= said.find(each) < helps] == []


def test_a_warning_is_called_one_wherever_it_stands(tmp_path: Path, capsys) -> None:
    log = REPLAY_LOGS / "c172p_gcs_rates" / "log.tlog"
    assert main(["replay", str(log), "--to", "80", "--out", str(tmp_path)]) == 0
    assert main(["report", str(tmp_path / "log.mcap")]) == 0

    assert "  warning rate_low: yaw comes at 10 Hz" in capsys.readouterr().out
    page = first_screen((tmp_path / "log.html").read_text(encoding="utf-8"))
    assert "warning rate_low" in page


@pytest.mark.parametrize("name", ["rerun", "report", "serve"])
def test_a_picture_of_the_readmes_shows_the_answer_that_is_given_today(
    name: str, tmp_path: Path
) -> None:
    """The one command that draws them writes into each what it shows: case, options, answer."""
    with Image.open(ROOT / "tools" / "pictures" / f"{name}.png") as image:
        sources = [json.loads(line) for line in image.info["yawid"].splitlines()]
    assert sources
    for source in sources:
        case = source["case"]
        run = open_run(replayed(REPLAY_LOGS / case / "log.tlog", tmp_path / case))

        shown, mode = source["dutch_roll"], run.summary.flight.dutch_roll
        assert source["options"] == {}
        for key in ("wn_rad_s", "wn_std", "zeta", "zeta_std"):
            assert shown[key] == pytest.approx(getattr(mode, key), rel=2e-3), (case, key)


def test_a_run_says_the_unit_of_its_rudder_and_its_modes_wherever_it_is_read(
    tmp_path: Path,
) -> None:
    in_rad = replayed(C172P, tmp_path / "rad", "--rate", 10, "--rudder-max-deg", 25, "--to", 80)
    assert main(["replay", str(in_rad), "--orders", "3,3,3,1", "--out", str(tmp_path)]) == 0
    again, screen = tmp_path / "log.mcap", tmp_path / "a.rrd"
    assert main(["view", str(again), "--out", str(screen)]) == 0

    runs = [open_run(path) for path in (in_rad, again)]
    for run in runs:
        grid, units = run.grid, run.metadata["units"]
        assert (grid.rudder_unit, grid.autopilot, grid.vehicle_type) == ("rad", 3, 1)
        assert [mode.name for _, mode in decoded(run.path)["/yawid/mode"]] == ["FBWA"]
        named = {name for name, unit in units.items() if "half" in unit}
        assert named == {"Sample.u", "Sample.aileron", "Commands.aileron"}  # the aileron's stays
        assert units["Modes.K"].startswith("rad/s per rad")
    text = Page(report(runs[0])).text
    assert all(each in text for each in ("rad/s per rad", "1/s² per rad", "steps by 1 rad"))
    assert "per half-travel" not in text
    assert statics(screen, "/input", "SeriesLines:names") == [["rudder [rad]"]]
    assert recorded(screen)["/state/flight_mode"]["StateChange:state"] == [["FBWA"]]
