"""A sample of the damper's bench: predictions against JSBSim's linearisation, and its judge."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from bench import damper
from bench.frame import log_rows

import yawid

PLACE, LONG_PLACE = 7, 2
"""A T37, which JSBSim trims and linearises in half the time, and a C172P."""


def test_two_gains_are_predicted_from_a_flight_without_a_damper(tmp_path: Path) -> None:
    plan, lag_s, _ = damper.plan_of(PLACE)
    log = tmp_path / "flight.tlog"
    log.write_bytes(damper.flown(PLACE).log)

    found = yawid.replay(log, lateral="auto").damper(gains=[0.3, 0.5])

    assert found.report.aircraft == "airframe"
    rows = {gain.value: gain.at[0] for gain in found.report.gains}
    for gain in (0.3, 0.5):
        wn, zeta = damper.closed(plan, lag_s, gain)
        assert rows[gain].zeta == pytest.approx(zeta, abs=0.015)
        assert abs(rows[gain].zeta - zeta) <= 2.0 * rows[gain].zeta_std
        assert rows[gain].wn_rad_s == pytest.approx(wn, rel=0.05)
    # It was flown without, and what is advised damps, as the linearisation has it.
    advised = found.report.recommended
    gains = (0.0, advised.next, advised.low, advised.high)
    zeta = [damper.closed(plan, lag_s, gain)[1] for gain in gains]
    assert zeta == sorted(zeta)
    assert zeta[2] > 0.25
    assert zeta[3] < 0.45


@pytest.mark.long
def test_the_bench_holds_each_gain_to_the_linearisation_with_it(tmp_path: Path) -> None:
    """On the airframe, and by the answer as flown."""
    rows = log_rows(damper.gains, tmp_path, 0, "flight", partial(damper.flown, LONG_PLACE))

    assert all(row["right"] and row["within"] for row in rows)
    assert [row["of"] for row in rows] == ["airframe"] * 4 + ["as_flown"] * 4
    zeta = [row["zeta_true"] for row in rows]
    assert zeta[:4] == zeta[4:]
    assert min(np.diff(zeta[:4])) > 0.04
