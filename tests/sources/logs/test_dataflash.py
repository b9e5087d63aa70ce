"""What the messages of a dataflash log become, checked by pymavlink's own reader."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flightlog import samples_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.DFReader import DFReader_binary
from sources.logs.dataflash_flight import GPS_MS, GPS_WEEK, DataflashLog, logged, telemetry, whole
from sources.logs.onboard_flight import (
    columns,
    flight,
    flown,
    lateral_accelerations,
    samples_read,
    us,
    written,
)

from yawid.sources.logs.dataflash import DataflashReader

NAN = math.nan


def oracle(path: Path, name: str) -> list[Any]:
    """Return the messages of one name as pymavlink reads them."""
    with DFReader_binary(str(path), zero_time_base=True) as log:
        return [*iter(lambda: log.recv_match(type=[name], strict=True), None)]


def test_every_row_is_what_pymavlink_reads(tmp_path: Path):
    path = written(tmp_path, whole())
    mine = columns(DataflashReader(path))
    servos, gyro = oracle(path, "RCOU"), [m for m in oracle(path, "IMU") if m.I == 0]
    raw, attitude = mine["SERVO_OUTPUT_RAW"], mine["ATTITUDE"]

    np.testing.assert_array_equal(raw["time_usec"], [m.TimeUS for m in servos])
    for i in range(1, 15):
        np.testing.assert_array_equal(raw[f"servo{i}_raw"], [getattr(m, f"C{i}") for m in servos])
    for field, axis in zip(("rollspeed", "pitchspeed", "yawspeed"), "XYZ", strict=True):
        np.testing.assert_array_equal(attitude[field], [getattr(m, f"Gyr{axis}") for m in gyro])
    parameters = [(m.Name.encode(), m.Value) for m in oracle(path, "PARM")]
    assert mine["PARAM_VALUE"].tolist() == parameters
    assert set(mine["VFR_HUD"]["airspeed"]) == {m.As for m in oracle(path, "CTUN")}
    for message in oracle(path, "ATT"):
        row = attitude[attitude["time_usec"] == message.TimeUS][0]
        assert row["roll"] == pytest.approx(math.radians(message.Roll), abs=1e-12)
        assert row["pitch"] == pytest.approx(math.radians(message.Pitch), abs=1e-12)
        assert math.cos(row["yaw"] - math.radians(message.Yaw)) == pytest.approx(1.0, abs=1e-12)
    assert np.nanmax(np.abs(attitude["yaw"])) <= np.pi
    # Behind the last row of ATT nothing is made up.
    known = attitude["time_usec"] <= us(flight().t[-5])
    np.testing.assert_array_equal(np.isfinite(attitude["roll"]), known)


@pytest.mark.parametrize("units", [True, False])
def test_rate_in_degrees_gives_the_same_within_its_precision(units: bool, tmp_path: Path):
    theirs = samples_of(telemetry(flight()).data)
    path = written(tmp_path, logged(flight(), rates="RATE", units=units).data)
    mine = samples_read(DataflashReader(path))

    np.testing.assert_array_equal(mine.u, theirs.u)
    np.testing.assert_allclose(mine.y, theirs.y, rtol=3e-7, atol=1e-8)


def armed(beats: np.ndarray) -> np.ndarray:
    return beats["base_mode"] & 128


GPS = ("GPS", 1000, 0, 3, GPS_MS, GPS_WEEK, 12, 0.8, 0, 0, 500, 17.25)
POS = ("POS", 2000, 0, 0, 512.5, 30.0, 30.0)
MODES = [("MODE", 1, 2, 2, 0), ("ARM", 2, 1), ("MODE", 3, 10, 10, 0), ("ARM", 4, 0)]
EVENTS = [("MODE", 1, 5, 5, 0), ("EV", 2, 11), ("EV", 3, 25), ("EV", 4, 10)]
STICKS = [("RCIN", 1000, *range(1001, 1015)), ("RCIN", 2000, *range(1101, 1115))]
GYRO = [("IMU", 20_000 * k, 0, 0.0, 0.0, 0.5) for k in range(500)]
RATES = [("RATE", 20_000 * k, *[0] * 7, 1.0) for k in range(100)]


def outputs(shift_us: Callable[[int], int]) -> list[tuple[Any, ...]]:
    return [("RCOU", 20_000 * k + shift_us(k), 1500) for k in range(100)]


def version(text: str, build: int) -> list[tuple[Any, ...]]:
    return [("MSG", 1, text), ("VER", 2, 0, 0, 4, 5, 7, 255, 0, "", 0, build)]


@pytest.mark.parametrize(
    ("rows", "name", "read", "expected"),
    [
        ([GPS], "VFR_HUD", "alt", [500.0]),
        ([GPS, POS], "VFR_HUD", "alt", [NAN, 512.5]),
        ([("STAT", 1, 0), ("STAT", 2, 1)], "EXTENDED_SYS_STATE", "landed_state", [1, 2]),
        (MODES, "HEARTBEAT", "custom_mode", [2, 2, 2, 10, 10]),
        (MODES, "HEARTBEAT", armed, [0, 0, 128, 128, 0]),
        # A log without a word of arming is one of an armed vehicle.
        (EVENTS[:1], "HEARTBEAT", armed, [128, 128]),
        (EVENTS, "HEARTBEAT", armed, [128, 128, 0, 128]),
        (STICKS, "RC_CHANNELS", "chan14_raw", [1014, 1114]),
        (STICKS, "RC_CHANNELS", "time_usec", [1000, 2000]),
        # RATE that is only logged in a part of the flight gives way to the gyro.
        ([*GYRO, *RATES], "ATTITUDE", lambda rows: np.unique(rows["yawspeed"]), [0.5]),
        *[
            (version(text, build), "HEARTBEAT", lambda rows: np.unique(rows["type"]), [kind])
            for text, build, kind in (
                ("-", 3, 1), ("ArduPlane", 2, 2), ("ArduRover V4", 0, 10), ("x", 0, 0),
            )
        ],
        # A damaged time is left out, a pause of the log is none.
        (outputs(lambda k: 2**40 * (k == 40)), "SERVO_OUTPUT_RAW", "time_usec",
         [20_000 * k for k in range(100) if k != 40]),
        (outputs(lambda k: 10**9 * (k >= 40)), "SERVO_OUTPUT_RAW", "servo1_raw", [1500] * 100),
    ],
)  # fmt: skip
def test_rows_become_those_of_messages(
    rows: list[tuple[Any, ...]], name: str, read: Any, expected: list[float], tmp_path: Path
):
    log = DataflashLog()
    for row in rows:
        log.add(*row)
    mine = columns(DataflashReader(written(tmp_path, log.data)))[name]
    np.testing.assert_array_equal(read(mine) if callable(read) else mine[read], expected)


def test_without_rates_there_is_no_attitude_nor_by_a_column_whose_format_is_damaged(
    tmp_path: Path,
):
    # One bit turns the character f of a number into n, four letters of text.
    sound = logged(flown(2.0)).data
    damaged = sound.replace(b"QBffffffIIfBBHH", b"QBffnfffIIfBBHH")
    assert damaged != sound
    for data in (damaged, logged(flown(2.0), rates="").data):
        found = columns(DataflashReader(written(tmp_path, data)))
        assert "ATTITUDE" not in found
        assert len(found["SERVO_OUTPUT_RAW"]) == 100


def test_the_counts_are_of_messages_bytes_in_none_and_drops_and_times_those_of_boot(tmp_path: Path):
    log = DataflashLog()
    for k in range(50):
        log.add("RCOU", 20_000 * k, 1500)
        log.add("GPS", 20_000 * k + 1, 0, 1, GPS_MS, GPS_WEEK)  # without a fix
    log.add("DSF", 10**6, 17)
    padded, sound = (
        DataflashReader(written(tmp_path, log.data + bytes(n), f"{n}.bin")).link for n in (200, 0)
    )
    # The padding hides whether the last message ended where it should.
    assert padded.frames == len(log.starts) - 1
    assert padded.skipped_bytes > 200
    assert (sound.lost, sound.first_us, sound.last_us) == (17, 0, 980_001)


def test_the_first_imu_s_lateral_acceleration_is_in_the_motion_at_its_own_times(tmp_path: Path):
    log = logged(flown(20.0), rates="RATE")
    for k in range(100):
        log.add("IMU", us(39.0) + 10_000 * k + 700, 0, 0.0, 0.0, 0.0, 1.0, 0.5 + k / 64, -9.8)
        log.add("IMU", us(39.0) + 10_000 * k + 800, 1, 0.0, 0.0, 0.0, 1.0, 99.0, -9.8)
        if k % 2 == 0:
            log.add("RATE", us(39.0) + 10_000 * k + 5000, *[0.0] * 12)
            log.add("RCOU", us(39.0) + 10_000 * k + 6000, *[1500] * 4)

    t_us, found = lateral_accelerations(DataflashReader(written(tmp_path, log.data)))

    known = [each for each in zip(t_us, found, strict=True) if each[1] != 0.0]
    assert known == [(us(39.0) + 10_000 * k + 700, 0.5 + k / 64) for k in range(len(known))]
    assert len(known) > 90


@given(where=st.floats(0, 1), garbage=st.binary(min_size=1, max_size=200))
def test_garbage_costs_only_the_message_it_stands_in(tmp_path: Path, where: float, garbage: bytes):
    short = logged(flown(2.0))
    head = next(at for at, name in short.starts if name == "MSG")
    at = head + int(where * (len(short.data) - head))
    logs = (short.data, short.data[:at] + garbage + short.data[at:])
    sound, damaged = (
        columns(DataflashReader(written(tmp_path, log)))["SERVO_OUTPUT_RAW"] for log in logs
    )
    assert len(sound) - 1 <= len(damaged) <= len(sound)
    assert np.isin(damaged["time_usec"], sound["time_usec"]).all()
