"""A log may have several boots, several vehicles, and not the stretch that is asked for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from flightlog import FlightLog, fly, samples_of
from places import REPLAY_LOGS

from yawid.channels.survey import Survey
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.runs.job import feed_all, open_log

STREAM = ("--manoeuvres", "off")
SPANS = {1: (300.0, 330.0), 2: (20.0, 60.0), 3: (10.0, 30.0)}


def boots(*numbers: int) -> bytes:
    """Return boots of 25 Hz, the rudder of each moved further than that of the one before."""
    logs = []
    for n in numbers:
        start_s, end_s = SPANS[n]
        half = 20 * 2**n

        def pulse(t: float, half: int = half) -> int:
            return 1500 + half * (int(t) % 2)

        spaced = {"start_s": start_s, "attitude_s": 0.04, "servo_s": 0.04}
        logs.append(fly(lambda t: 0.1 * np.sin(2.0 * t), pulse, end_s - start_s, **spaced).data)
    return b"".join(logs)


LOG = boots(1, 2, 3)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.tlog"
    path.write_bytes(LOG)
    return path


@pytest.mark.parametrize(
    ("settings", "span", "largest"),
    [
        ({"boot": 1}, SPANS[1], 0.1),
        ({"boot": 2}, SPANS[2], 0.2),
        ({"boot": 3}, SPANS[3], 0.4),
        ({}, (10.0, 330.0), 0.4),
        ({"boot": 2, "from_s": 25.0, "to_s": 31.0}, (25.0, 31.0), 0.2),
        ({"boot": 2, "band": (0.2, 3.0)}, SPANS[2], None),
    ],
)
def test_only_the_boot_and_the_part_asked_for_give_samples(settings, span, largest):
    found = samples_of(LOG, RunConfig(**settings))

    assert found.boot_us.min() / 1e6 == pytest.approx(span[0], abs=0.2)
    assert found.boot_us.max() / 1e6 == pytest.approx(span[1], abs=0.2)
    if largest is not None:
        assert np.nanmax(found.u) == pytest.approx(largest, abs=0.01)


def test_the_numbers_are_those_of_the_phases_that_inspect_shows(log: Path):
    survey, pipeline = Survey(), Pipeline(RunConfig())
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
    for text in ("3 boots", "boot 2 from 20.0 to 60.0 s", "choose one by --boot"):
        assert text in err
    _, err = said("--from", "22", "--boot", "2")
    assert "--boot" not in err

    out, _ = said("--json")
    assert [each["boot"] for each in json.loads(out)["boots"]] == [1, 2, 3]
    log.write_bytes(boots(3))
    assert "boots" not in json.loads(said("--json")[0])
    assert "the log, which covers 10.0 to 30.0 s since boot" in said("--from", "31")[1]


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
def test_what_the_log_does_not_cover_is_a_usage_error(options, text, log, tmp_path, capsys):
    for command in (["replay", str(log), "--out", str(tmp_path / "out")], ["inspect", str(log)]):
        assert main([*command, *options]) == 2
        assert text in capsys.readouterr().err
    assert not [*tmp_path.glob("out/*")]


@pytest.mark.parametrize(("sysid", "answered"), [([], "2/1"), (["--sysid", "1"], "1/1")])
def test_two_vehicles_are_named_and_the_one_that_is_answered(sysid, answered, tmp_path, capsys):
    log = str(REPLAY_LOGS / "two_vehicles" / "log.tlog")
    for command in (["replay", log, "--out", str(tmp_path), "--force"], ["inspect", log]):
        main([*command, *STREAM, *sysid])
        page = " ".join(capsys.readouterr().out.split())
        for text in (f"{answered} fixed wing (answered)", "1/1 fixed wing", "2/1 fixed wing"):
            assert text in page
        assert "choose another by --sysid" in page
        main([*command, *STREAM, *sysid, "--json"])
        assert [each["sysid"] for each in json.loads(capsys.readouterr().out)["vehicles"]] == [1, 2]


def crowd() -> bytes:
    """A ground station, a radio and an ADS-B receiver are heard before two aircraft."""
    log = FlightLog()
    for kind, sender in ((6, (255, 190)), (18, (51, 68)), (27, (1, 156))):
        log.heartbeat(9.0, kind, 8, sender)
    for sysid in (7, 3):
        log.heartbeat(9.5, sender=(sysid, 1))
    for i in range(400):
        log.sysid = 7 if i % 2 else 3
        log.attitude(10.0 + 0.02 * i, 0.01 * log.sysid)
        log.servos(10.0 + 0.02 * i, [1500] * 4)
    return log.data


def test_the_vehicle_is_the_first_aircraft_heard_or_the_one_asked_for():
    first, other, none = (samples_of(crowd(), RunConfig(sysid=n)) for n in (None, 3, 9))

    assert first.channels.lock.vehicle.sysid == 7
    assert [set(each.y.round(6)) for each in (first, other)] == [{0.07}, {0.03}]
    assert len(none.blocks) == 0
    why = none.channels.lock.why_none()
    assert "255/190 ground station" in why
    assert "system id 9" in why
