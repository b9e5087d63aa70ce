"""Torn and damaged dataflash logs: what is intact is found, nothing is invented, nobody shouts."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sources.logs.dataflash_flight import columns, logged, with_imu, written
from sources.logs.dataflash_writer import DataflashLog
from sources.logs.onboard_flight import flown

from yawid.config.run import RunConfig
from yawid.errors import SourceError
from yawid.pipeline import Pipeline
from yawid.runs.job import open_log
from yawid.sources.logs.dataflash import DataflashReader


@pytest.mark.parametrize("cut", [3, 50, 20_001, 90_000])
def test_a_torn_log_gives_what_came_before_the_tear(tmp_path: Path, cut: int):
    whole = columns(written(tmp_path, with_imu().data))["SERVO_OUTPUT_RAW"]
    data = with_imu().data[:-cut]
    torn = columns(written(tmp_path, data))["SERVO_OUTPUT_RAW"]
    intact = sum(at + 40 <= len(data) for at, name in with_imu().starts if name == "RCOU")

    assert 0 <= intact - len(torn) <= 1
    assert (torn == whole[: len(torn)]).all()


@given(st.data())
def test_garbage_costs_only_the_message_it_stands_in(tmp_path: Path, data: st.DataObject):
    short = logged(flown(2.0))
    head = next(at for at, name in short.starts if name == "MSG")
    at = data.draw(st.integers(head, len(short.data)))
    garbage = data.draw(st.binary(min_size=1, max_size=200))
    whole = columns(written(tmp_path, short.data))["SERVO_OUTPUT_RAW"]
    damaged = short.data[:at] + garbage + short.data[at:]
    found = columns(written(tmp_path, damaged))["SERVO_OUTPUT_RAW"]

    assert len(whole) - 1 <= len(found) <= len(whole)
    assert np.isin(found["time_usec"], whole["time_usec"]).all()


FLIGHT = logged(flown(2.0)).data


@given(st.integers(0, 2**32 - 1))
def test_flipped_bytes_are_survived_in_silence(tmp_path: Path, seed: int):
    rng = np.random.default_rng(seed)
    data = np.frombuffer(FLIGHT, np.uint8).copy()
    where = rng.choice(np.arange(2, len(data)), 30, replace=False)
    data[where] ^= rng.integers(1, 256, 30, np.uint8)
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        pipeline = Pipeline(RunConfig())
        for _, frames in DataflashReader(written(tmp_path, data.tobytes())).read():
            pipeline.feed(frames)
        pipeline.finish()
    assert said.getvalue() == ""


def test_a_damaged_time_is_left_out(tmp_path: Path):
    log = DataflashLog()
    for k in range(100):
        log.add("RCOU", 20_000 * k + (2**40 if k == 40 else 0), 1500)
    times = columns(written(tmp_path, log.data))["SERVO_OUTPUT_RAW"]["time_usec"]
    np.testing.assert_array_equal(times, [20_000 * k for k in range(100) if k != 40])


def test_a_pause_of_the_log_is_no_damage(tmp_path: Path):
    log = DataflashLog()
    for k in range(100):
        log.add("RCOU", 20_000 * k + (10**9 if k >= 40 else 0), 1500)
    assert len(columns(written(tmp_path, log.data))["SERVO_OUTPUT_RAW"]) == 100


def test_a_file_that_only_begins_like_a_log_is_refused_in_one_line(tmp_path: Path):
    for data in (b"\xa3\x95", b"\xa3\x95\x80" + bytes(50), b"\xa3\x95" * 500):
        path = written(tmp_path, data)
        with pytest.raises(SourceError, match="holds no readable message") as caught:
            open_log(path)
        assert "\n" not in str(caught.value)


def test_a_column_whose_format_is_damaged_is_not_read(tmp_path: Path):
    # One bit turns the character f of a number into n, four letters of text.
    sound = logged(flown(2.0)).data
    damaged = sound.replace(b"QBffffffIIfBBHH", b"QBffnfffIIfBBHH")
    assert damaged != sound
    found = columns(written(tmp_path, damaged))

    assert "ATTITUDE" not in found
    assert len(found["SERVO_OUTPUT_RAW"]) == 100
