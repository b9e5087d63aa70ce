"""Recorded flights that hold commands and outputs, and no rudder that moved the aircraft."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from places import SHARED_FLIGHTS as FLIGHTS
from printed import printed

from yawid.cli.main import main

pytestmark = pytest.mark.skipif(not FLIGHTS.is_dir(), reason="the recorded flights are not here")


def replay(capsys, tmp_path: Path, name: str, *options: object) -> tuple[int, dict[str, str]]:
    """Return the exit code and the texts of the reasons."""
    arguments = ["replay", FLIGHTS / name, "--out", tmp_path, "--json", *options]
    code = main([str(argument) for argument in arguments])
    summary: dict[str, Any] = printed("replay", capsys.readouterr().out)
    return code, {reason["id"]: reason["text"] for reason in summary["verdict"]["reasons"]}


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--rudder", "control:2"),
        ("--rudder", "rc:4", "--inputs", "rudder,aileron"),
    ],
)
def test_a_quadrotors_yaw_torque_is_no_rudder(options: tuple[object, ...], capsys, tmp_path: Path):
    code, said = replay(capsys, tmp_path, "px4_quad_bench.ulg", *options)

    assert code == 3
    assert "quadrotor (type 2) on PX4" in said["no_rudder"]
