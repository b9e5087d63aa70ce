"""A turn in the manoeuvre: the bare airframe is the same as without one."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("jsbsim")

from checks.judge import replayed
from flights.flight import Hands
from flights.fly import flight_of
from flights.moved import PLACES, pulses
from flights.plan import excitation, plan_at
from flights.surgery import join
from flights.telemetry import Link, telemetry
from flights.truth import linear_dutch_rolls

from yawid.config.run import RunConfig
from yawid.lateral.fit_airframe import fit_airframe
from yawid.manoeuvre import bare_answer


@pytest.mark.long
@pytest.mark.parametrize("name", ["T37", "737"])
def test_a_turn_moves_wn_by_less_than_3_percent(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Over the airspeed, which a turn with the nose held changes by up to 9 %; gates may refuse."""
    fits = []

    def kept(*of: Any, **how: Any) -> Any:
        fits.append(fit_airframe(*of, **how))
        return fits[-1]

    monkeypatch.setattr(bare_answer, "fit_airframe", kept)
    plan = plan_at(next(each for each in PLACES if each[0] == name), seconds=45.0)
    wn = linear_dutch_rolls(plan)["dutch_roll"]["wn_rad_s"]
    plan = replace(plan, step_s=0.3 * math.tau / wn)
    rudder, link, log = excitation(plan), Link(25.0, 25.0, seed=5), tmp_path / "log.tlog"
    rolled_in = np.minimum(0.001 * np.arange(len(rudder)) / 3.0, 1.0)
    airspeeds = []
    for bank_deg in (0.0, 30.0, 45.0):
        aileron = pulses(np.random.default_rng(5), plan.seconds, 0.08, 0.4)
        hands = Hands(rudder, aileron, math.radians(bank_deg) * rolled_in)
        log.write_bytes(join(telemetry(link, flight_of(plan, link, hands))))
        [found] = replayed(log, RunConfig(lateral="auto")).manoeuvres
        airspeeds.append(found.airspeed_m_s)

    kappas = [fit.wn_rad_s.value / speed for fit, speed in zip(fits, airspeeds, strict=True)]
    assert [each / kappas[0] for each in kappas[1:]] == pytest.approx([1.0, 1.0], abs=0.03)
