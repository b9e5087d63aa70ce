"""kill -9 costs at most the last second of either file, and the rest is as good as new."""

from __future__ import annotations

from pathlib import Path

import pytest
from bench.live_kill import kill_once
from live_link import frames


@pytest.mark.parametrize("moment_s", [pytest.param(1.9, marks=pytest.mark.long), 3.1])
def test_a_killed_session_loses_at_most_its_last_second(moment_s: float, tmp_path: Path):
    sent = frames(60.0)
    stamped = [(1_700_000_000_000_000 + 10_000 * i, frame) for i, frame in enumerate(sent)]

    loss = kill_once(stamped, moment_s, tmp_path, speed=5.0)

    assert loss.tlog_s <= 1.0
    assert loss.mcap_s <= 1.0
    assert loss.frames > 100
    assert loss.rows > 100
    assert loss.is_same
