"""Reasons are true of their record; ``replay`` and ``inspect`` give one log the same ones."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from flights.records import HZ, SAID, Leg, record

import yawid
from yawid.cli.main import main

OPTIONS = ["--units", "rad", "--rudder-unit", "half-travel", "--rudder-is", "commanded"]


@pytest.mark.parametrize("wn", [1.0, 2.0])
def test_a_slow_light_mode_that_is_right_is_not_said_to_be_of_another_rudder(wn: float) -> None:
    """A doublet, hands off, 50 Hz, noise of 3 % of the peak: wn and zeta are found to a percent."""
    leg = Leg(wn=wn, zeta=0.02 if wn == 1.0 else 0.03, unit_s=1.5 / wn, seconds=25.0 + 3.0 / wn)
    columns = record([leg], hz=50)
    rate = leg.yaw_rate(columns["rudder"], 50)
    noise = np.random.default_rng(1).standard_normal(len(rate))
    columns["r"] = rate + 0.03 * np.abs(rate).max() * noise

    [found] = yawid.replay(columns, **SAID, from_s=9.0).summary.manoeuvres

    assert found.dutch_roll.wn_rad_s == pytest.approx(wn, rel=0.01)
    assert found.dutch_roll.zeta == pytest.approx(leg.zeta, abs=0.002)
    assert not [r for r in found.verdict.reasons if "does not belong to this yaw rate" in r.text]
    assert found.verdict.usable


def test_a_movement_of_one_second_before_the_log_ends_does_not_decide() -> None:
    flown = yawid.replay(record([Leg(seconds=40.0, noise=0.3), Leg(seconds=11.0)]), **SAID)

    whole, *cut = flown.summary.manoeuvres
    assert not whole.verdict.usable
    assert all(each.to_s - each.from_s < 2.1 for each in cut)  # with the second of rest before
    for reason in flown.flight.verdict.reasons:
        assert not reason.text.startswith("manoeuvre 2, ")


def test_replay_and_inspect_refuse_a_log_for_the_same_reasons(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, columns = tmp_path / "noisy.csv", record([Leg(seconds=30.0, noise=0.3)] * 2)
    with log.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([columns, *zip(*columns.values(), strict=True)])
    said = []
    for command in (["replay", "--out", str(tmp_path / "out")], ["inspect"]):
        assert main([*command, str(log), *OPTIONS, "--json"]) == 5
        said.append(json.loads(capsys.readouterr().out))

    replayed, inspected = said[0]["verdict"], said[1]["verdict"]
    assert not inspected["usable"]
    assert inspected == replayed == said[0]["flight"]["verdict"]


@pytest.mark.parametrize(("noise", "seed"), [(0.15, 9), (0.165, 15), (0.165, 16)])
def test_next_to_a_vibration_an_answer_is_that_of_the_mode_or_none(noise: float, seed: int) -> None:
    """Several tries at it, each judged as if it were the only one, had let the wrong one pass."""
    doublets = 0.2 * np.where(np.arange(45 * HZ) // (HZ // 2) % 2, -1.0, 1.0)
    rudder = np.concatenate([np.zeros(10 * HZ), doublets, np.zeros(15 * HZ)])
    t, leg = np.arange(len(rudder)) / HZ, Leg(zeta=0.3)
    drift = 0.09 * np.cumsum(np.random.default_rng(3).standard_normal(len(t)))
    gyro = 0.2 * np.sin(37.7 * t + drift)
    gyro += noise * np.random.default_rng(seed).standard_normal(len(t))
    columns = {"t": t, "rudder": rudder, "r": leg.yaw_rate(rudder) + gyro}

    [found] = yawid.replay(columns, **SAID).summary.manoeuvres

    roll = found.dutch_roll
    if found.verdict.usable:
        assert abs(roll.wn_rad_s - leg.wn) < 2.0 * roll.wn_std
        assert abs(roll.zeta - leg.zeta) < 2.0 * roll.zeta_std
    else:
        assert [reason.id for reason in found.verdict.fatal] == ["mode_not_driven"]
