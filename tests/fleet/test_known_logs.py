"""Which logs a fleet knows: those of a data set that the same analysis answered as they are."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from data_sets import merge
from places import REPLAY_LOGS

from yawid.cli.main import main
from yawid.dataset.schema import ANALYSIS_VERSION
from yawid.fleet.spec import Spec


@pytest.mark.parametrize(
    ("other", "to_run"),
    [
        ({}, 0),
        ({"analysis_version": f"{ANALYSIS_VERSION}0"}, 1),
        ({"config_hash": "another"}, 1),
        ({"size_bytes": 1}, 1),
        ({"modified": "1"}, 1),
        ({"outcome": "failed"}, 1),
        ({"outcome": "timeout"}, 0),
    ],
)
def test_a_log_is_known_where_all_that_its_numbers_depend_on_is_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], other: dict[str, Any], to_run: int
) -> None:
    log = tmp_path / "logs" / "a.tlog"
    log.parent.mkdir()
    shutil.copy(REPLAY_LOGS / "no_rudder" / "log.tlog", log)
    row = {
        "path": str(log),
        "size_bytes": log.stat().st_size,
        "modified": str(log.stat().st_mtime_ns),
        "config_hash": Spec().config_hash,
        "analysis_version": ANALYSIS_VERSION,
        "outcome": "ok",
    }
    merge(tmp_path / "data", [{"logs": [row | other]}])

    assert main(["fleet", str(log.parent), "--out", str(tmp_path / "data"), "--dry-run"]) == 0
    assert capsys.readouterr().out.startswith(f"to run: {to_run} logs,")
