"""The vehicle's clock, its leaps and boots; several vehicles, and stretches that are not there."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from flightlog import FlightLog, beat, every, finished, fly, samples_of
from flights.surgery import join, split
from hypothesis import given
from hypothesis import strategies as st
from places import REPLAY_LOGS
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.channels.series import unwrap_uint32_us
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.sinks.run_page import origin


@given(
    start=st.integers(0, 40 * 24 * 3600 * 1_000_000),
    steps=st.lists(st.integers(1, 100_000_000), min_size=1, max_size=50),
    skew=st.integers(-30_000_000, 30_000_000),
)
def test_unwrapping_beside_the_full_clock_inverts_the_wrap(start, steps, skew):
    true = start + 60_000_000 + np.cumsum(np.array(steps, np.int64))
    order = np.arange(len(true), dtype=np.int64)

    found = unwrap_uint32_us(true % 2**32, 2 * order + 1, true + skew, 2 * order)

    np.testing.assert_array_equal(found, true)


def still(seconds: float, start_s: float, attitude_s: float = 0.02, servo_s: float = 0.02) -> bytes:
    steps = {"start_s": start_s, "attitude_s": attitude_s, "servo_s": servo_s}
    return fly(lambda t: 0.1, lambda t: 1500, seconds, **steps).data


@pytest.mark.parametrize(
    ("by_s", "stamps_by_s", "steps", "gaps"),
    [
        (447.0, 0.0, 1, 0),
        (447.0, 447.0, 0, 1),  # a silence of the link
        (40.0, 0.0, 0, 1),
        (-1.4, -1.4, 1, 0),
        (-0.9, -0.9, 0, 0),
    ],
)
def test_a_leap_of_the_vehicle_s_clock_alone_is_reported(by_s, stamps_by_s, steps, gaps):
    after = (
        (stamp + round(1e6 * (stamps_by_s - by_s)), frame)
        for stamp, frame in split(still(20.0, 30.0 + by_s))
    )
    log = still(20.0, 10.0) + join(after)
    summary = finished(log, RunConfig(manoeuvres="off"))

    assert (summary.link.clock_steps, summary.link.gaps, summary.link.reboots) == (steps, gaps, 0)
    link = list(origin(summary))[-1].text
    assert ("the vehicle's clock jumped by 447 s" in link) == (by_s > 400.0 and steps == 1)


def test_a_servo_message_in_unix_time_is_brought_to_the_vehicles_clock():
    def controls(t: float) -> mavlink.MAVLink_message:
        stamp = 1_700_000_000_000_000 + round(1e6 * (10.0 + t))
        moved = [0.0, 0.0, 0.5 if t > 5.0 else 0.0, 0.5, *[0.0] * 4]
        return mavlink.MAVLink_actuator_control_target_message(stamp, 0, moved)

    more = every(0.02, 10.0, controls)
    log = fly(lambda t: 0.1, lambda t: 0, 10.0, servo_s=99.0, vehicle=beat(1, 12), more=more)
    found = samples_of(log.data)

    assert not found.held.any()
    assert abs(found.boot_us[np.argmax(found.u[:, 0] > 0.4)] - 15.0e6) < 0.06e6


MEAN_HZ = (200 + 500) / 68.0


@pytest.mark.parametrize(
    ("stretches", "expected"),
    [
        # A servo that is heard late: seconds, start, and the steps of both channels.
        ([(60.0, 10.0, 0.05, 99.0), (20.0, 70.0, 0.05, 0.05)], [(20.0, None), (20.0, None)]),
        ([(8.0, at, 0.1, 0.02) for at in (100.0, 140.0, 20.0)], [(10.0, None), (50.0, None)]),
        ([(8.0, 10.0, 0.04, 0.04), (60.0, 18.0, 0.12, 0.12)], [(MEAN_HZ, 25.0)] * 2),
    ],
)
def test_a_rate_is_of_the_time_in_which_the_channel_flowed_and_one_that_changes_has_the_first_too(
    stretches: list[tuple[float, ...]], expected: list[tuple[float, float | None]]
):
    log = b"".join(still(*stretch) for stretch in stretches)
    summary = finished(log, RunConfig(manoeuvres="off"))
    for name, (mean, first) in zip(("yaw", "rudder"), expected, strict=True):
        channel = summary.channels[name]
        assert channel.rate_hz == pytest.approx(mean, rel=0.01 if first else 1e-6)
        assert channel.first_rate_hz == (first and pytest.approx(first, rel=0.01))


STREAM = ("--manoeuvres", "off")
SPANS = {1: (300.0, 330.0), 2: (20.0, 60.0), 3: (10.0, 30.0)}


def boot(n: int) -> bytes:
    """Return a boot of 25 Hz, whose rudder moves further than that of the one before."""
    start_s, end_s = SPANS[n]
    return fly(
        lambda t: 0.1 * np.sin(2.0 * t),
        lambda t: 1500 + 20 * 2**n * (int(t) % 2),
        end_s - start_s,
        start_s=start_s,
        attitude_s=0.04,
        servo_s=0.04,
    ).data


LOG = boot(1) + boot(2) + boot(3)


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


def test_several_boots_are_named_as_inspect_does_and_cut_alike_only_with_a_warning(
    log: Path, tmp_path, capsys
):
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

    own = json.loads(said("--json")[0])["boots"]
    main(["inspect", str(log), "--json"])
    phases = json.loads(capsys.readouterr().out)["phases"]
    assert [each["boot"] for each in own] == [1, 2, 3]
    for name in ("boot", "from", "to"):
        assert [each[name] for each in own] == [each[name] for each in phases]
    log.write_bytes(boot(3))
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


def test_where_the_vehicle_asked_for_is_not_heard_it_is_said_who_was() -> None:
    log = FlightLog()
    for kind, sender in ((6, (255, 190)), (18, (51, 68)), (27, (1, 156)), (1, (7, 1))):
        log.heartbeat(9.0, kind, 8, sender)
    found = samples_of(log.data + LOG, RunConfig(sysid=9))

    assert len(found.blocks) == 0
    why = found.channels.lock.why_none()
    assert "255/190 ground station" in why
    assert "system id 9" in why
