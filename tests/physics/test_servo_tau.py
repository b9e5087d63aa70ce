"""The yaw channel of a whole run: in its summary, in the rows of its file, by a servo named."""

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
    "--rate", 25, "--forgetting", 1, "--from", 86.5,
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


def test_a_servo_is_named_on_the_command_line_or_in_toml(capsys, tmp_path):
    settings = tmp_path / "run.toml"
    settings.write_text("servo-tau = 0.14\n", encoding="utf-8")

    by_option = replayed(capsys, tmp_path, "--servo-tau", 0.14)
    by_file = replayed(capsys, tmp_path, "--config", settings)
    elsewhere = replayed(capsys, tmp_path, "--servo-tau", 1.4)

    assert by_option["physics"]["servo_tau_s"]["value"] == pytest.approx(0.12, abs=0.01)
    assert by_file["physics"] == by_option["physics"]
    assert "physics" not in elsewhere  # no pole of the model is that slow
    assert elsewhere["dutch_roll"] == by_option["dutch_roll"]


@pytest.mark.parametrize("tau", ["0", "-0.1", "inf", "nan"])
def test_a_lag_that_is_none_is_refused(capsys, tmp_path, tau):
    code = main(["replay", str(SITL), "--out", str(tmp_path), f"--servo-tau={tau}"])

    assert code == 2
    assert capsys.readouterr().err.startswith("yawid: --servo-tau must be > 0 and finite")
