"""The bench of manoeuvres: its logs are what it says, its ratio is that of pairs run in turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench import manoeuvres as bench
from flightlog import run_through

from yawid.blocks import Floats
from yawid.config.run import RunConfig


def moving(log: Path) -> Floats:
    """The 5 s windows of a log (n,), 1 where the rudder moves within it."""
    pipeline, _ = run_through(log, RunConfig(manoeuvres="off", memory=600.0))
    assert pipeline.bank is not None
    u = pipeline.bank.history().u[:, 0]
    assert pipeline.bank.sample_time_s == 0.05
    windows = np.lib.stride_tricks.sliding_window_view(u, 100)[::100]
    return (np.ptp(windows, axis=1) > 0.02).astype(float)


def test_a_tenth_of_the_made_log_is_manoeuvres_with_their_ends(tmp_path: Path) -> None:
    bench.made_tenth(tmp_path / "tenth.tlog", 12.0)

    moved = moving(tmp_path / "tenth.tlog")

    assert np.count_nonzero(np.diff(moved)) in (3, 4)  # two stretches; the first may begin the log
    assert moved.mean() == pytest.approx(0.1, abs=0.03)


def test_a_rudder_that_moves_throughout_never_rests(tmp_path: Path) -> None:
    bench.made_throughout(tmp_path / "made.tlog", 4.0)
    bench.flown_throughout(tmp_path / "flown.tlog", 1.0)

    assert moving(tmp_path / "made.tlog").all()
    assert moving(tmp_path / "flown.tlog")[2:].all()  # after its lead-in


def test_a_replay_that_fails_ends_the_bench(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="missing"):
        bench.user_s(tmp_path / "missing.tlog", tmp_path / "out", "off")
