"""The classic flight test, a doublet and hands off, through the whole tool, of aircraft drawn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from flights.records import SAID, drawn_airframe, release
from numpy.typing import NDArray

import yawid
from yawid.answers.run_summary import Manoeuvre

SEED = 44
SLOW = {25: 0.503, 7: 0.595}
"""wn in rad/s of two of its releases, for which half a doublet lasts 6.2 and 5.3 s."""


def answered(columns: dict[str, Any]) -> Manoeuvre:
    [found] = yawid.replay(columns, **SAID).summary.manoeuvres or []
    return found


@pytest.mark.parametrize("hz", [10, 20, 50])
@pytest.mark.parametrize(("number", "rolls"), [(25, False), (7, True), (1, True), (22, True)])
def test_a_release_is_answered_at_every_rate(number: int, rolls: bool, hz: int) -> None:
    """Of .503, .595, 1.30 and 5.12 rad/s, with zeta .04 to .12 and noise to 3 % of the peak"""
    columns, leg = release(SEED, number, hz, rolls=rolls)
    found = answered(columns)

    assert leg.wn == pytest.approx(SLOW.get(number, leg.wn), abs=0.001)
    assert found.verdict.usable
    roll = found.dutch_roll
    assert abs(roll.wn_rad_s - leg.wn) < 0.02 * leg.wn
    assert abs(roll.wn_rad_s - leg.wn) < 2.0 * (roll.wn_std or 0.0)
    assert abs(roll.zeta - leg.zeta) < 2.0 * (roll.zeta_std or 0.0)
    assert not any("clock" in reason.text for reason in found.verdict.reasons)


@pytest.mark.parametrize("rolls", [False, True])
@pytest.mark.parametrize(("wn", "zeta"), [(0.5, 0.02), (6.0, 0.15)])
def test_a_drawn_aircraft_has_the_dutch_roll_asked_for(wn: float, zeta: float, rolls: bool) -> None:
    A, B = drawn_airframe(np.random.default_rng(5), wn, zeta, 0.2, rolls=rolls)

    asked = wn * complex(-zeta, math.sqrt(1.0 - zeta**2))
    poles = np.linalg.eigvals(A)
    assert np.min(np.abs(poles - asked)) < 1e-9 * wn
    assert sum(pole.imag > 1e-6 for pole in poles) == 1
    assert bool(B[1]) == rolls


def late(rudder: NDArray[np.float64], rows: int) -> NDArray[np.float64]:
    return np.concatenate([np.zeros(rows), rudder[:-rows]])


@pytest.mark.parametrize("number", [4, 6])
def test_a_rudder_that_is_not_the_one_that_was_flown_is_refused(number: int) -> None:
    """Of 2.7 and 3.6 rad/s: the free decay alone has the right frequency"""
    columns, _ = release(SEED, number, 20, rolls=True)
    rudder = columns["rudder"]
    others = [release(SEED, number + 20, 20, rolls=True)[0]["rudder"], rudder[::-1]]

    assert answered(columns).verdict.usable
    for other in (*(np.resize(each, len(rudder)) for each in others), late(rudder, 8)):
        verdict = answered(columns | {"rudder": other}).verdict
        assert not verdict.usable
        assert "mode_not_driven" in {reason.id for reason in verdict.fatal}


def test_a_slow_mode_whose_rudder_is_late_by_a_twentieth_of_a_period_is_right_all_the_same() -> (
    None
):
    """0.4 s of 10.6 s, which a numerator explains: neither wn nor zeta is that of another mode."""
    columns, leg = release(SEED, 7, 20, rolls=True)
    found = answered(columns | {"rudder": late(columns["rudder"], 8)})

    roll = found.dutch_roll
    assert abs(roll.wn_rad_s - leg.wn) < 2.0 * (roll.wn_std or 0.0)
    assert abs(roll.zeta - leg.zeta) < 2.0 * (roll.zeta_std or 0.0)
