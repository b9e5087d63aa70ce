"""A log may hold several boots, several vehicles, and not the stretch that is asked for."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from flightlog import FlightLog, run_through, samples_of
from places import ROOT

from yawid.channels.survey import Survey
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.config.settings import check_settings
from yawid.errors import ConfigError
from yawid.pipeline import Pipeline
from yawid.runs.job import feed_all, open_log

STREAM = ("--manoeuvres", "off")
TWO_VEHICLES = ROOT / "replay_logs" / "two_vehicles" / "log.tlog"


def one_boot(start_s: float, seconds: float, amplitude: float, sysid: int = 1) -> FlightLog:
    """Return a flight whose rudder moves by this much of half its travel."""
    log = FlightLog(sysid=sysid)
    log.heartbeat(start_s)
    for i in range(round(25 * seconds)):
        t = start_s + 0.04 * i
        log.attitude(t, 0.1 * np.sin(2.0 * t))
        log.servos(t + 0.01, [1500, 1500, 1500, 1500 + round(400 * amplitude * (i // 25 % 2))])
    return log


def three_boots() -> bytes:
    spans = ((300.0, 30.0, 0.1), (20.0, 40.0, 0.2), (10.0, 20.0, 0.4))
    return b"".join(one_boot(*span).data for span in spans)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.tlog"
    path.write_bytes(three_boots())
    return path


@pytest.mark.parametrize(("boot", "largest"), [(1, 0.1), (2, 0.2), (3, 0.4), (None, 0.4)])
@pytest.mark.parametrize("band", [None, (0.2, 3.0)])
def test_only_the_boot_asked_for_gives_samples(boot, largest, band):
    settings = {"boot": boot, "from_s": 10.0, "to_s": 400.0}
    found = samples_of(three_boots(), RunConfig(band=band, **settings))
    spans = {1: (300.0, 330.0), 2: (20.0, 60.0), 3: (10.0, 30.0)}
    low, high = (10.0, 330.0) if boot is None else spans[boot]

    assert (found.boot_us >= 1e6 * low - 1e5).all()
    assert (found.boot_us <= 1e6 * high).all()
    if band is None:
        assert np.nanmax(found.u) == pytest.approx(largest, abs=0.01)


def test_the_boots_do_not_depend_on_the_cut():
    data, config = three_boots(), RunConfig(boot=2)
    whole, cut = samples_of(data, config), samples_of(data, config, range(0, len(data), 1511))

    assert whole.channels.boots == cut.channels.boots
    for name in ("k", "u", "y", "held"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name))


def test_the_numbers_are_those_of_the_phases_that_inspect_shows(log: Path):
    survey = Survey()
    pipeline = Pipeline(RunConfig())
    pipeline.channels.watch = survey.note
    feed_all(open_log(log), pipeline)
    spans = {n: (a / 1e6, b / 1e6) for n, (a, b) in pipeline.channels.boots.spans_us.items()}

    assert {each.boot: (each.from_s, each.to_s) for each in survey.phases(3, 1)} == spans


def test_several_boots_are_named_and_cut_alike_only_with_a_warning(log: Path, tmp_path, capsys):
    def said(*options: str) -> tuple[str, str]:
        main(["replay", str(log), *STREAM, "--out", str(tmp_path), "--force", *options])
        return capsys.readouterr()

    out, err = said()
    assert "boots  1: 300 to 330 s, 2: 20 to 60 s, 3: 10 to 30 s" in out
    assert "--boot" not in err
    _, err = said("--from", "12")
    assert "3 boots" in err
    assert "boot 2 from 20.0 to 60.0 s" in err
    assert "choose one by --boot" in err
    _, err = said("--from", "22", "--boot", "2")
    assert "--boot" not in err


def test_the_summary_has_the_boots_only_where_there_are_several(log: Path, tmp_path, capsys):
    main(["replay", str(log), *STREAM, "--out", str(tmp_path), "--json"])
    boots = json.loads(capsys.readouterr().out)["boots"]
    assert [boot["boot"] for boot in boots] == [1, 2, 3]
    assert boots[1]["from"] == pytest.approx(20.0)

    log.write_bytes(one_boot(10.0, 20.0, 0.2).data)
    main(["replay", str(log), *STREAM, "--out", str(tmp_path), "--json", "--force"])
    assert "boots" not in json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--from", "2000"], "--from 2000 is outside the log, which covers boot 1 from 300.0"),
        (["--to", "5"], "--to 5 is outside the log"),
        (["--from", "100", "--to", "200"], "--from 100 --to 200 is outside"),
        (["--from", "200", "--boot", "3"], "--from 200 is outside"),
        (["--boot", "4"], "--boot 4 is not in the log, which holds 3 boots: boot 1 from 300.0 to"),
        (["--boot", "0"], "--boot must be a whole number from 1"),
    ],
)
@pytest.mark.parametrize("command", ["replay", "inspect", "orders"])
def test_what_the_log_does_not_cover_is_a_usage_error(
    command, options, text, log, tmp_path, capsys
):
    out = ["--out", str(tmp_path / "out")] if command == "replay" else []

    assert main([command, str(log), *out, *options]) == 2
    assert text in capsys.readouterr().err
    assert not [*tmp_path.glob("out/*")]


def test_a_log_of_one_boot_says_what_it_covers(tmp_path: Path):
    log = tmp_path / "log.tlog"
    log.write_bytes(one_boot(10.0, 20.0, 0.2).data)
    with pytest.raises(ConfigError, match=r"the log, which covers 10\.0 to 30\.0 s since boot"):
        run_through(log, RunConfig(from_s=31.0))


def test_the_boot_can_stand_in_a_file(tmp_path: Path):
    path = tmp_path / "options.toml"
    path.write_text("boot = 2\n", encoding="utf-8")
    config = RunConfig(**check_settings(tomllib.loads(path.read_text(encoding="utf-8")), str(path)))
    assert config.boot == 2
    path.write_text(config.to_toml(), encoding="utf-8")
    assert (
        RunConfig(**check_settings(tomllib.loads(path.read_text(encoding="utf-8")), str(path)))
        == config
    )


@pytest.mark.parametrize(("sysid", "answered"), [([], "2/1"), (["--sysid", "1"], "1/1")])
@pytest.mark.parametrize("command", ["replay", "inspect"])
def test_two_vehicles_are_named_and_the_one_that_is_answered(
    command, sysid, answered, tmp_path, capsys
):
    out = ["--out", str(tmp_path)] if command == "replay" else []
    main([command, str(TWO_VEHICLES), *STREAM, *out, *sysid])
    page = " ".join(capsys.readouterr().out.split())

    assert f"{answered} fixed wing (answered)" in page
    assert "1/1 fixed wing" in page
    assert "2/1 fixed wing" in page
    assert "choose another by --sysid" in page
    again = ["--json", *(["--force"] if out else [])]
    main([command, str(TWO_VEHICLES), *STREAM, *out, *sysid, *again])
    vehicles = json.loads(capsys.readouterr().out)["vehicles"]
    assert [vehicle["sysid"] for vehicle in vehicles] == [1, 2]


def test_a_log_of_one_vehicle_beside_its_ground_station_has_no_list_of_them():
    pipeline, _ = run_through(ROOT / "replay_logs" / "no_rudder" / "log.tlog", RunConfig())
    assert len(pipeline.channels.lock.senders) == 2
    assert len(pipeline.channels.lock.vehicles) == 1
