"""A turn in the manoeuvre: the bare airframe is the same as without one."""

from __future__ import annotations

import math

import pytest

pytest.importorskip("jsbsim")

from bench.lateral import motion
from flights.lateral import in_turn
from flights.moved import PLACES

from yawid.lateral.fit_airframe import fit_airframe


@pytest.mark.long
@pytest.mark.parametrize("name", ["T37", "737"])
def test_a_turn_moves_wn_by_less_than_3_percent(name: str):
    """Over the airspeed, which a turn with the nose held changes by up to 9 %."""
    place = [each[0] for each in PLACES].index(name)
    kappas = []
    for bank_deg in (0.0, 30.0, 45.0):
        of = motion(in_turn(place, math.radians(bank_deg), 5), 0)
        kappas.append(fit_airframe([of]).wn_rad_s.value / of.airspeed_m_s)

    assert [each / kappas[0] for each in kappas[1:]] == pytest.approx([1.0, 1.0], abs=0.03)
