"""Reasons that are true of their record, and of the manoeuvre that they name."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from flights.records import SAID, Leg, record

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
    assert found.verdict.usable


def test_a_movement_of_one_second_before_the_log_ends_does_not_decide() -> None:
    flown = yawid.replay(record([Leg(seconds=40.0, noise=0.3), Leg(seconds=11.0)]), **SAID)

    whole, *cut = flown.summary.manoeuvres
    assert not whole.verdict.usable
    assert all(each.to_s - each.from_s < 2.1 for each in cut)  # with the second of rest before
    for reason in flown.flight.verdict.reasons:
        assert not reason.text.startswith("manoeuvre 2, ")


@pytest.mark.xfail(strict=True, reason="The upper house")
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

    replayed, inspected = said[0]["flight"]["verdict"], said[1]["verdict"]
    assert not inspected["usable"]
    assert inspected["reasons"] == replayed["reasons"]
