"""A sample of the damper's bench: predictions against JSBSim's linearisation, and its judge."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from bench import damper

import yawid

PLACE, LONG_PLACE = 7, 2
"""A T37, which JSBSim trims and linearises in half the time, and a C172P."""


def test_two_gains_are_predicted_from_a_flight_without_a_damper(tmp_path: Path) -> None:
    plan, flown, _ = damper.plan_of(PLACE)
    log = tmp_path / "flight.tlog"
    log.write_bytes(damper.flown(PLACE).log)
    model = damper.linear(plan, flown.servo_lag_s)

    found = yawid.replay(log).damper(gains=[0.3, 0.5])

    rows = {gain.value: gain.at[0] for gain in found.report.gains}
    for gain in (0.3, 0.5):
        pole = model.dutch_roll(replace(flown, gain=gain))
        true = -pole.real / abs(pole)
        assert rows[gain].zeta == pytest.approx(true, abs=0.015)
        assert abs(rows[gain].zeta - true) <= 2.0 * rows[gain].zeta_std
        assert rows[gain].wn_rad_s == pytest.approx(abs(pole), rel=0.05)
    # It was flown without, and what is advised damps, as the linearisation has it.
    advised = found.report.recommended
    gains = (0.0, advised.next, advised.low, advised.high)
    poles = [model.dutch_roll(replace(flown, gain=gain)) for gain in gains]
    zeta = [-pole.real / abs(pole) for pole in poles]
    assert zeta == sorted(zeta)
    assert zeta[2] > 0.25
    assert zeta[3] < 0.45


@pytest.mark.long
def test_the_bench_holds_each_gain_to_the_linearisation_with_it(tmp_path: Path) -> None:
    rows = damper.place_rows(2, tmp_path, LONG_PLACE)

    assert len(rows) == 2
    assert rows[0]["zeta_true"] < rows[1]["zeta_true"] - 0.04
    for row in rows:
        assert damper.is_right(row)
        assert damper.is_within(row)
