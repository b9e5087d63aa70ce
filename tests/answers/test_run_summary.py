"""The summary as JSON and back: today's keys and order, nothing that is not as yawid writes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import hand_flights
import numpy as np
import pytest
from hand_flights import four_of_a_flight
from hand_flights import plain_summary as summary
from places import REPLAY_LOGS

from yawid.answers.reasons import Reason
from yawid.answers.run_summary import DutchRoll, MethodSummary, RunSummary


def estimate(theta: dict[str, Any], roll: DutchRoll | None = None) -> MethodSummary:
    return hand_flights.estimate("els", roll, theta=theta, theta_std={})


@pytest.mark.parametrize(
    "path", sorted(REPLAY_LOGS.glob("*/expected.json")), ids=lambda p: p.parent.name
)
def test_every_reference_comes_back_with_its_keys_in_their_order(path: Path):
    before = {"log": "log.tlog"} | json.loads(path.read_text(encoding="utf-8"))
    after = RunSummary.from_json(json.dumps(before).encode()).to_json()

    assert after == before
    assert list(after) == list(before)


def test_what_does_not_apply_has_no_key_what_is_empty_has_and_numpys_numbers_are_numbers():
    found = summary(duration_s=np.float64(2.5), estimates={"els": estimate({"a1": np.float64(1)})})
    told = json.loads(json.dumps(found.to_json()))

    assert set(told) == {"log", "duration_s", "link", "channels", "estimates", "verdict"}
    assert told["link"] == {}
    assert "dutch_roll" not in told["estimates"]["els"]
    assert told["estimates"]["els"]["theta"] == {"a1": 1.0}
    assert told["estimates"]["els"]["theta_std"] == {}
    assert told["verdict"] == {"usable": True, "reasons": []}


def test_sigmas_and_the_first_method_come_back_and_keys_of_a_newer_version_are_left_out():
    roll = DutchRoll(wn_rad_s=2.0, zeta=0.1)
    both = summary(estimates={"rml": estimate({}, roll), "els": estimate({})})
    warned = summary(verdict=None, warnings=[Reason("rudder_assumed", "servo 4")])
    for found in (four_of_a_flight(), both, warned):
        newer = found.to_json() | {"weather": {"wind_m_s": 2.0}}
        assert RunSummary.from_json(json.dumps(newer).encode()) == found

    assert (both.answer, both.dutch_roll) == (both.estimates["rml"], roll)
    deciding = warned.deciding  # nothing was judged
    assert (warned.exit_code, deciding.usable, deciding.word) == (0, False, "not judged")
    assert deciding.reasons == warned.warnings


def test_a_dutch_roll_without_frequency_or_damping_is_none():
    assert DutchRoll.of([2.0, np.nan, 0.2, 0.01]) == DutchRoll(
        wn_rad_s=2.0, wn_std=None, zeta=0.2, zeta_std=0.01
    )
    for row in ([np.nan] * 4, [2.0, 0.1, np.nan, np.nan], [0.0, 0.1, 1.0, 0.1], [np.inf, 0, 0, 0]):
        assert DutchRoll.of(row) is None
