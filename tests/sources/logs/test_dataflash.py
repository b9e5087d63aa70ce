"""Dataflash logs: the same flight as in a telemetry log, checked by pymavlink's own reader."""

from __future__ import annotations

import hashlib
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from flightlog import Samples, samples_of
from sources.logs.dataflash_flight import (
    GPS_MS,
    GPS_WEEK,
    PARAMETERS,
    UNIX_S,
    columns,
    flight,
    logged,
    telemetry,
    us,
    with_imu,
    written,
)
from sources.logs.dataflash_writer import DataflashLog
from sources.logs.onboard_flight import (
    assert_same_samples,
    flown,
    lateral_accelerations,
    samples_from,
)

from yawid.runs.job import open_log
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sources.logs.dataflash import DataflashReader


@pytest.fixture
def bin_file(tmp_path: Path) -> Path:
    return written(tmp_path, with_imu().data)


def samples(path: Path) -> Samples:
    return samples_from(DataflashReader(path))


def oracle(path: Path, name: str) -> list:
    """Return the messages of one name as pymavlink reads them."""
    from pymavlink.DFReader import DFReader_binary

    with DFReader_binary(str(path), zero_time_base=True) as log:
        found = []
        while (message := log.recv_match(type=[name], strict=True)) is not None:
            found.append(message)
        return found


def test_the_samples_are_those_of_the_telemetry_log_of_the_same_flight(bin_file: Path):
    assert_same_samples(samples(bin_file), samples_of(telemetry(flight()).data))


def test_rate_in_degrees_gives_the_same_within_its_precision(tmp_path: Path):
    theirs = samples_of(telemetry(flight()).data)
    for units in (True, False):
        path = written(tmp_path, logged(flight(), rates="RATE", units=units).data)
        mine = samples(path)

        np.testing.assert_array_equal(mine.u, theirs.u)
        np.testing.assert_allclose(mine.y, theirs.y, rtol=3e-7, atol=1e-8)


def test_the_replay_finds_what_the_replay_of_the_telemetry_log_finds(tmp_path: Path):
    tlog = written(tmp_path, telemetry(flight()).data, "flight.tlog")
    # Neither name nor suffix tells what a file is.
    dataflash = written(tmp_path, with_imu().data, "dataflash.tlog")
    found = {}
    for path in (tlog, dataflash):
        outputs = Outputs(tmp_path, path.stem)
        summary = replay(path, {"memory": math.inf}, outputs, StopFlag())
        verdict = summary.verdict
        found[path] = summary.to_json()
        assert verdict.exit_code == 0, verdict.reasons
    a, b = found[tlog], found[dataflash]

    assert a["vehicle"] == b["vehicle"] == {"sysid": 7, "compid": 1, "type": 1, "autopilot": 3}
    assert a["channels"] == b["channels"]
    assert b["sha256"] == hashlib.sha256(with_imu().data).hexdigest()
    for name, value in a["estimates"]["els"]["theta"].items():
        assert b["estimates"]["els"]["theta"][name] == pytest.approx(value, rel=1e-9, abs=1e-12)
    assert b["estimates"]["els"]["dutch_roll"]["wn_rad_s"] == pytest.approx(4.0, rel=0.02)


def test_every_row_is_what_pymavlink_reads(bin_file: Path):
    mine = columns(bin_file)
    servos, gyro = oracle(bin_file, "RCOU"), [m for m in oracle(bin_file, "IMU") if m.I == 0]
    parameters, speeds = oracle(bin_file, "PARM"), oracle(bin_file, "CTUN")

    np.testing.assert_array_equal(mine["SERVO_OUTPUT_RAW"]["time_usec"], [m.TimeUS for m in servos])
    for i in range(1, 15):
        np.testing.assert_array_equal(
            mine["SERVO_OUTPUT_RAW"][f"servo{i}_raw"], [getattr(m, f"C{i}") for m in servos]
        )
    for field, axis in zip(("rollspeed", "pitchspeed", "yawspeed"), "XYZ", strict=True):
        theirs = [getattr(m, f"Gyr{axis}") for m in gyro]
        np.testing.assert_array_equal(mine["ATTITUDE"][field], theirs)
    told = [(m.Name.encode(), m.Value) for m in parameters]
    assert mine["PARAM_VALUE"].tolist() == told
    assert set(mine["VFR_HUD"]["airspeed"]) == {m.As for m in speeds}


def test_angles_are_those_of_att_where_it_has_a_row(bin_file: Path):
    mine = columns(bin_file)["ATTITUDE"]
    for message in oracle(bin_file, "ATT"):
        row = mine[mine["time_usec"] == message.TimeUS][0]
        assert row["roll"] == pytest.approx(math.radians(message.Roll), abs=1e-12)
        assert row["pitch"] == pytest.approx(math.radians(message.Pitch), abs=1e-12)
        turn = row["yaw"] - math.radians(message.Yaw)
        assert math.cos(turn) == pytest.approx(1.0, abs=1e-12)
    assert np.nanmax(np.abs(mine["yaw"])) <= np.pi
    # Behind the last row of ATT nothing is made up.
    known = mine["time_usec"] <= us(flight().t[-5])
    np.testing.assert_array_equal(np.isfinite(mine["roll"]), known)


def test_unix_time_is_that_of_gps(bin_file: Path):
    link = DataflashReader(bin_file).link
    boot_us = us(flight().t[0]) + 6000
    offset_us = us(UNIX_S) - boot_us

    assert link.first_us == us(flight().t[0]) + offset_us
    assert link.last_us is not None
    assert link.last_us - link.first_us == pytest.approx(60e6, abs=30_000)


def test_without_a_fix_the_times_are_boot_times(tmp_path: Path):
    log = DataflashLog()
    for k in range(20):
        log.add("RCOU", 1000 * k, 1500)
        log.add("GPS", 1000 * k + 1, 0, 1, GPS_MS, GPS_WEEK)
    link = DataflashReader(written(tmp_path, log.data)).link

    assert (link.first_us, link.last_us) == (0, 19_001)


def test_the_counts_name_messages_bytes_in_none_and_drops(tmp_path: Path):
    log = DataflashLog()
    for k in range(50):
        log.add("RCOU", 20_000 * k, 1500)
    log.add("DSF", 10**6, 17)
    link = DataflashReader(written(tmp_path, log.data + bytes(200))).link

    # The padding hides whether the last message ended where it should.
    assert link.frames == len(log.starts) - 1
    assert DataflashReader(written(tmp_path, log.data)).link.lost == 17
    assert link.skipped_bytes > 200


def test_the_vehicle_is_what_version_and_startup_text_say(tmp_path: Path):
    for build, text, kind in (
        (3, "", 1),
        (2, "ArduPlane", 2),
        (0, "ArduRover V4", 10),
        (0, "x", 0),
    ):
        log = DataflashLog()
        log.add("MSG", 1, text or "-")
        log.add("VER", 2, 0, 0, 4, 5, 7, 255, 0, "", 0, build)
        assert set(columns(written(tmp_path, log.data))["HEARTBEAT"]["type"]) == {kind}


def test_altitude_is_the_positions_or_that_of_gps(tmp_path: Path):
    log = DataflashLog()
    log.add("GPS", 1000, 0, 3, GPS_MS, GPS_WEEK, 12, 0.8, 0, 0, 500, 17.25)
    by_gps = columns(written(tmp_path, log.data))["VFR_HUD"]
    log.add("POS", 2000, 0, 0, 512.5, 30.0, 30.0)
    by_position = columns(written(tmp_path, log.data))["VFR_HUD"]

    assert by_gps["alt"].tolist() == [500.0]
    np.testing.assert_array_equal(by_position["alt"], [np.nan, 512.5])


def test_whether_it_believes_to_fly_comes_as_the_system_state(tmp_path: Path):
    log = DataflashLog()
    log.add("STAT", 1000, 0)
    log.add("STAT", 2000, 1)
    mine = columns(written(tmp_path, log.data))["EXTENDED_SYS_STATE"]
    assert mine["landed_state"].tolist() == [1, 2]


def test_modes_and_arming_are_told_where_they_change(tmp_path: Path):
    log = DataflashLog()
    log.add("MODE", 1, 2, 2, 0)
    log.add("ARM", 2, 1)
    log.add("MODE", 3, 10, 10, 0)
    log.add("ARM", 4, 0)
    beats = columns(written(tmp_path, log.data))["HEARTBEAT"]

    assert beats["custom_mode"].tolist() == [2, 2, 2, 10, 10]
    assert (beats["base_mode"] & 128).tolist() == [0, 0, 128, 128, 0]


def test_a_log_that_tells_no_arming_is_one_of_an_armed_vehicle(tmp_path: Path):
    log = DataflashLog()
    log.add("MODE", 1, 5, 5, 0)
    assert set(columns(written(tmp_path, log.data))["HEARTBEAT"]["base_mode"]) == {128}

    log.add("EV", 2, 11)
    log.add("EV", 3, 25)
    log.add("EV", 4, 10)
    beats = columns(written(tmp_path, log.data))["HEARTBEAT"]
    assert (beats["base_mode"] & 128).tolist() == [128, 128, 0, 128]


def test_a_parameter_that_changes_in_flight_holds_from_there_on(tmp_path: Path):
    log = logged(flight())
    begins = len(log.data)
    log.add("PARM", us(flight().t[-1]) + 9000, "SERVO4_TRIM", 1520, 0)
    log.add("RCOU", us(flight().t[-1]) + 20_000, 1500)
    path = written(tmp_path, log.data)
    pieces = DataflashReader(path).read()
    blocks = [frames.messages["PARAM_VALUE"] for _, frames in pieces
              if frames is not None and "PARAM_VALUE" in frames.messages]  # fmt: skip
    order = np.concatenate([block.order for block in blocks])

    assert len(order) == len(PARAMETERS) + 1
    assert order[:-1].max() < 10
    assert order[-1] >= begins


def test_rate_that_is_only_logged_in_part_of_the_flight_gives_way_to_the_gyro(tmp_path: Path):
    log = DataflashLog()
    for k in range(500):
        log.add("IMU", 20_000 * k, 0, 0.0, 0.0, 0.5)
        if k < 100:
            log.add("RATE", 20_000 * k, 0, 0, 0, 0, 0, 0, 0, 1.0)
    assert set(columns(written(tmp_path, log.data))["ATTITUDE"]["yawspeed"]) == {0.5}


def test_without_rates_there_is_no_attitude(tmp_path: Path):
    assert "ATTITUDE" not in columns(written(tmp_path, logged(flight(), rates="").data))


def test_the_first_imu_s_lateral_acceleration_is_in_the_motion_at_its_own_times(tmp_path: Path):
    log = logged(flown(20.0), rates="RATE")
    for k in range(100):
        log.add("IMU", us(39.0) + 10_000 * k + 700, 0, 0.0, 0.0, 0.0, 1.0, 0.5 + k / 64, -9.8)
        log.add("IMU", us(39.0) + 10_000 * k + 800, 1, 0.0, 0.0, 0.0, 1.0, 99.0, -9.8)
        if k % 2 == 0:
            log.add("RATE", us(39.0) + 10_000 * k + 5000, *[0.0] * 12)
            log.add("RCOU", us(39.0) + 10_000 * k + 6000, *[1500] * 4)
    reader = DataflashReader(written(tmp_path, log.data))

    t_us, found = lateral_accelerations(reader)

    known = [each for each in zip(t_us, found, strict=True) if each[1] != 0.0]
    assert known == [(us(39.0) + 10_000 * k + 700, 0.5 + k / 64) for k in range(len(known))]
    assert len(known) > 90


def test_sticks_come_as_rc_channels(tmp_path: Path):
    log = DataflashLog()
    log.add("RCIN", 1000, *range(1001, 1015))
    log.add("RCIN", 2000, *range(1101, 1115))
    mine = columns(written(tmp_path, log.data))["RC_CHANNELS"]
    assert mine["chan14_raw"].tolist() == [1014, 1114]
    assert mine["time_usec"].tolist() == [1000, 2000]


def test_order_rises_through_the_log_whatever_the_message(bin_file: Path):
    low = -1
    for _, frames in DataflashReader(bin_file).read():
        orders = np.sort(np.concatenate([b.order for b in frames.messages.values()]))
        assert (np.diff(orders) > 0).all()
        assert orders[0] > low
        low = orders[-1]


def test_a_telemetry_log_is_still_read_as_one(tmp_path: Path):
    path = written(tmp_path, telemetry(flown(2.0)).data, "flight.bin")
    reader = open_log(path)
    assert sum(size for size, _ in reader.read()) == path.stat().st_size


def test_the_command_line_replays_a_dataflash_log(bin_file: Path, tmp_path: Path):
    command = [sys.executable, "-W", "error", "-m", "yawid", "replay", str(bin_file), "--json"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    summary = json.loads(done.stdout)
    assert summary["channels"]["rudder"]["source"] == "SERVO_OUTPUT_RAW.servo4_raw"
    assert summary["channels"]["yaw"]["rate_hz"] == pytest.approx(50.0)
