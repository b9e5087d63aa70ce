"""What makes a record untrue without any noise: a wrong airspeed, a wrong unit, the log twice."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flights.records import HZ, SAID, Leg, record
from numpy.typing import NDArray
from places import C172P

import yawid
from yawid.cli.main import main

GRAVITY = 9.80665
TURN_S = 12
"""Seconds of a turn at the end of a leg, to the right and to the left in turn."""
BANK = math.radians(25.0)


def turning(true_m_s: float, reported_m_s: float, slip: float = 1.0) -> dict[str, Any]:
    """Return a record on one heading but for short turns, in still air without a ground speed.

    In a turn the yaw angle goes by g tan(bank) / V, over ``slip``. wn is 6 rad/s.
    """
    legs = [Leg(seconds=36.0), Leg(seconds=36.0), Leg(seconds=36.0), Leg(seconds=36.0)]
    columns = record(legs, seed=3)
    n = len(columns["t"]) // len(legs)
    turns = np.arange(n) >= n - TURN_S * HZ
    bank: NDArray[np.float64] = BANK * np.concatenate([turns * side for side in (1, -1, 1, -1)])
    rng = np.random.default_rng(4)
    columns["roll"] = bank + 0.01 * rng.standard_normal(len(bank))
    columns["yaw"] = np.cumsum(GRAVITY * np.tan(bank) / true_m_s / slip) / HZ
    return columns | {"airspeed": np.full(len(bank), reported_m_s)}


def reasons_of(run: Any) -> dict[str, str]:
    return {reason.id: reason.text for reason in run.flight.verdict.reasons}


@pytest.mark.parametrize(("slip", "told"), [(1.0, 10.0), (0.95, 20.0), (1.0, 20.0), (1.5, 20.0)])
def test_a_right_airspeed_gives_kappa_whether_the_aircraft_slips_or_not_and_half_of_it_none(
    slip: float, told: float
) -> None:
    """The altitude is unknown too, so that a true airspeed may be above the equivalent one."""
    found = yawid.replay(turning(20.0, told, slip), **SAID)

    said = reasons_of(found).get("airspeed_implausible", "")
    assert ("bank and turn rate imply" in said) == (told == 10.0)
    assert found.flight.verdict.usable
    kappa = found.flight.kappa_rad_m
    assert (kappa is None) == (told == 10.0)
    assert kappa is None or kappa.value == pytest.approx(6.0 / 20.0, abs=2.0 * kappa.std)


@pytest.mark.parametrize(("factor", "warned"), [(1.0, False), (math.degrees(1.0), True)])
def test_a_yaw_rate_in_deg_s_that_was_read_as_rad_s_is_warned_of(factor: float, warned: bool):
    columns = record([Leg(), Leg()])
    found = yawid.replay(columns | {"r": factor * columns["r"]}, **SAID)

    assert ("deg/s" in reasons_of(found).get("unit_assumed", "")) == warned
    assert found.flight.verdict.usable


def test_a_log_that_was_appended_to_itself_counts_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    twice = tmp_path / "twice.tlog"
    twice.write_bytes(2 * C172P.read_bytes())
    said = []
    for log in (C172P, twice):
        assert main(["replay", str(log), "--json", "--out", str(tmp_path / "out")]) == 0
        said.append(json.loads(capsys.readouterr().out))
    once, again = said

    assert again["link"]["frames"] == 2 * once["link"]["frames"]
    assert [each["n"] for each in again["manoeuvres"]] == [1]
    assert again["flight"]["dutch_roll"] == once["flight"]["dutch_roll"]
    assert "repeated" not in [reason["id"] for reason in once["flight"]["verdict"]["reasons"]]
    [reason] = [r for r in again["flight"]["verdict"]["reasons"] if r["id"] == "repeated"]
    assert reason["weight"] == "warning"
