"""The yaw channel of a whole run: in its summary, in the rows of its file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import REPLAY_LOGS
from sinks.mcap.mcap_reading import column, decoded

from yawid.cli.main import main
from yawid.quantities.table import YAW_CHANNEL

SITL = REPLAY_LOGS / "sitl_fbwa_50hz" / "log.tlog"
OPTIONS = (
    "--method", "rml", "--also", "none", "--manoeuvres", "off",
    "--rate", 25, "--memory", "inf", "--from", 86.5,
)  # fmt: skip


def replayed(capsys, folder: Path, *options: object) -> dict[str, Any]:
    arguments = ["replay", SITL, "--out", folder, "--force", "--json", *OPTIONS, *options]
    assert main([str(argument) for argument in arguments]) == 0
    summary: dict[str, Any] = json.loads(capsys.readouterr().out)
    return summary["estimates"]["rml"]


def test_the_file_holds_the_yaw_channel_with_sigma_at_every_sample(capsys, tmp_path):
    physics = replayed(capsys, tmp_path, "--to", 240)["physics"]

    rows = decoded(tmp_path / "log.mcap")["/yawid/modes"]

    for name in YAW_CHANNEL:
        values, sigmas = column(rows, name), column(rows, f"{name}_std")
        # The last whole second's, of an estimate that has come to rest.
        assert values[-1] == pytest.approx(physics[name]["value"], rel=0.01)
        assert sigmas[-1] == pytest.approx(physics[name]["std_noise"], rel=0.05)
        known = np.isfinite(values)
        assert known[2000:].all()
        np.testing.assert_array_equal(known, np.isfinite(sigmas))
