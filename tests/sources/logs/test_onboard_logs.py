"""Logs of ArduPlane and PX4 of one flight: as its telemetry log has it, torn, and damaged."""

from __future__ import annotations

import contextlib
import hashlib
import io
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from drawn import examples
from hypothesis import example, given
from hypothesis import strategies as st
from printed import why_invalid
from sources.logs import dataflash_flight, ulog_flight
from sources.logs.onboard_flight import (
    columns,
    flight,
    flown,
    us,
    written,
)

from yawid.config.run import RunConfig
from yawid.errors import SourceError
from yawid.pipeline import Pipeline
from yawid.runs.job import open_log
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay

FORMATS = (dataflash_flight, ulog_flight)
ALL = pytest.mark.parametrize("of", FORMATS, ids=("dataflash", "ulog"))


@ALL
def test_the_replay_finds_what_the_replay_of_the_telemetry_log_finds(
    of: ModuleType, tmp_path: Path
):
    found = []
    # Neither name nor suffix decides what a file is.
    for name, data in (("a.bin", of.telemetry(flight()).data), ("b.tlog", of.whole())):
        path = written(tmp_path, data, name)
        outputs = Outputs(tmp_path, path.stem)
        summary = replay(path, {"memory": math.inf, "ordinary": "off"}, outputs, StopFlag())
        assert summary.verdict.exit_code == 0, summary.verdict.reasons
        assert summary.sha256 == hashlib.sha256(data).hexdigest()
        assert why_invalid("replay", summary.to_json()) == ""
        found.append(summary)
    theirs, mine = found

    assert theirs.vehicle == mine.vehicle
    assert (mine.vehicle.sysid, mine.vehicle.compid, mine.vehicle.type) == (7, 1, 1)
    assert theirs.channels == mine.channels
    rudder = mine.channels["rudder"]
    assert (rudder.min_us, rudder.trim_us, rudder.max_us) == (1100, 1500, 1900)
    assert mine.estimates["els"].theta == pytest.approx(theirs.estimates["els"].theta, rel=1e-9)
    assert mine.estimates["els"].dutch_roll.wn_rad_s == pytest.approx(4.0, rel=0.02)


@ALL
def test_order_rises_through_the_log_and_a_parameter_holds_from_where_it_changes(
    of: ModuleType, tmp_path: Path
):
    log = of.logged(flown(4.0))
    of.change(log, us(30.0))
    blocks = [frames.messages for _, frames in of.READER(written(tmp_path, log.data)).read()]
    orders = [np.sort(np.concatenate([m.order for m in each.values()])) for each in blocks]
    assert (np.diff(np.concatenate(orders)) > 0).all()
    told = [each["PARAM_VALUE"] for each in blocks if "PARAM_VALUE" in each]
    *first, last = np.concatenate([each.order for each in told]).tolist()
    assert len(first) == len(of.PARAMETERS)
    assert max(first) < 10 < 200 < last < orders[-1][-1]
    assert told[-1].fields["param_value"][-1] == 2000.0


@ALL
def test_unix_time_is_that_of_gps(of: ModuleType, tmp_path: Path):
    link = of.READER(written(tmp_path, of.whole())).link
    first_us = {
        dataflash_flight: us(dataflash_flight.UNIX_S) - 6000,
        ulog_flight: us(ulog_flight.UNIX_S + flight().t[0]) - 600,
    }
    assert link.first_us == first_us[of]
    assert link.last_us - link.first_us == pytest.approx(60e6, abs=30_000)


@pytest.mark.parametrize("cut", [1, 3, 50, 100, 20_001, 90_000])
@ALL
def test_a_torn_log_gives_what_came_before_the_tear(of: ModuleType, cut: int, tmp_path: Path):
    complete, torn = (
        columns(of.READER(written(tmp_path, data)))["SERVO_OUTPUT_RAW"]
        for data in (of.whole(), of.whole()[:-cut])
    )
    assert 0 <= len(complete) - len(torn) <= 1 + cut // 100
    assert (torn == complete[: len(torn)]).all()


@given(seed=st.integers(0, 2**32 - 1))
@example(173264)  # a NaN that signals
@examples(6)
@ALL
def test_flipped_bytes_are_read_or_refused_in_silence(of: ModuleType, tmp_path: Path, seed: int):
    rng = np.random.default_rng(seed)
    data = np.frombuffer(of.logged(flown(2.0)).data, np.uint8).copy()
    where = rng.choice(np.arange(8, len(data)), 30, replace=False)
    data[where] ^= rng.integers(1, 256, 30, np.uint8)
    said, pipeline = io.StringIO(), Pipeline(RunConfig())
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        with contextlib.suppress(SourceError):
            for _, frames in of.READER(written(tmp_path, data.tobytes())).read():
                pipeline.feed(frames)
        pipeline.finish()
    assert said.getvalue() == ""


OF_OTHER_TOPICS = ulog_flight.ULogFile({})
OF_OTHER_TOPICS.add("unrelated_topic", 5)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"\xa3\x95", "holds no readable message"),
        (b"\xa3\x95\x80" + bytes(50), "holds no readable message"),
        (b"\xa3\x95" * 500, "holds no readable message"),
        (OF_OTHER_TOPICS.data, "none of the topics"),
        (OF_OTHER_TOPICS.data[:9], "cannot be read"),
    ],
)
def test_a_file_that_only_begins_like_a_log_is_refused_in_one_line(
    data: bytes, text: str, tmp_path: Path
):
    (tmp_path / "log").write_bytes(data)
    with pytest.raises(SourceError, match=text) as caught:
        open_log(tmp_path / "log")
    assert "\n" not in str(caught.value)
