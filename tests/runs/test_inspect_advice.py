"""What ``yawid inspect`` says is to be recorded next time: message, rate, manoeuvre, parameter."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from flightlog import FlightLog
from inspecting import inspected


def flown(
    kind: int = 1, autopilot: int = 3, step_s: float = 0.05, servos: str = "", **parameters: float
) -> FlightLog:
    """A flight of 30 s; its servos are at ``rest``, ``mixed`` with the aileron, or not there."""
    log = FlightLog()
    log.heartbeat(10.0, kind=kind, autopilot=autopilot)
    for name, value in parameters.items():
        log.parameter(10.0, name, value)
    for t in np.arange(10.0, 40.0, step_s).tolist():
        stick = round(200 * np.sin(1.3 * t) * np.cos(0.4 * t)) if servos == "mixed" else 0
        log.attitude(t, 0.3 * np.sin(1.3 * t - 0.5))
        if servos:
            log.servos(t, [1500 + stick, 1500, 1500, 1500 + stick // 2])
    return log


def blind() -> FlightLog:
    log = FlightLog()
    log.heartbeat(1.0)
    log.servos(2.0, [1500] * 8)
    return log


def ground() -> FlightLog:
    log = FlightLog()
    for t in (1.0, 2.0):
        log.heartbeat(t, kind=6, autopilot=8)
    return log


RUDDER = ("--rudder", "servo:4")
SLOW = {"step_s": 0.3, "servos": "rest"}


@pytest.mark.parametrize(
    ("log", "options", "words"),
    [
        # A slow log is told the rates to ask its autopilot for.
        (partial(flown, **SLOW), RUDDER, ["SRn_EXTRA1 = 25"]),
        (partial(flown, autopilot=12, **SLOW), RUDDER, ["mavlink stream"]),
        (partial(flown, autopilot=0, **SLOW), RUDDER, ["MAV_CMD_SET_MESSAGE_INTERVAL"]),
        # What a log without a rudder is told depends on why.
        (partial(flown, kind=2), (), ["has no rudder: record an aircraft that has one"]),
        (partial(flown, SERVO4_FUNCTION=4.0), (), ["SERVOn_FUNCTION = 21"]),
        (flown, (), ["ask for SERVO_OUTPUT_RAW"]),
        (partial(flown, kind=0), (), ["download the parameters"]),
        # A rudder that only follows the aileron is told how to part them.
        (
            partial(flown, servos="mixed"), ("--inputs", "rudder,aileron"),
            ["KFF_RDDRMIX = 0", "3-2-1-1", "download the parameters"],
        ),
        (ground, (), ["HEARTBEAT"]),
        (blind, (), ["ATTITUDE (30)"]),
    ],
)  # fmt: skip
def test_the_advice_names_what_was_missing_and_where_to_ask_for_it(
    log: Callable[[], FlightLog], options: tuple[str, ...], words: list[str], tmp_path: Path, capsys
) -> None:
    code, report = inspected(log().data, tmp_path, capsys, *options)
    told = " | ".join(report["record"])
    assert [each for each in words if each not in told] == []
    if "KFF_RDDRMIX = 0" in words:
        assert (code, report["verdict"]["reasons"][0]["id"]) == (5, "mixed_rudder")
