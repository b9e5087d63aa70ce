"""The bench behind the figures of tools/README.md on vibration, and so what ``--band`` is worth."""

from __future__ import annotations

import pytest
from bench.aliasing import errors


@pytest.mark.parametrize("raw_hz", [50.0, 200.0])
def test_vibration_falsifies_the_mode_unless_a_band_keeps_it_out(raw_hz):
    plain, grid_alone, band = (
        errors(raw_hz, 10.0, "tone", way, seed=1) for way in ("none", "grid", "band")
    )

    for wrong in (plain, grid_alone):
        assert all(abs(wn_pct) > 10.0 for wn_pct, _ in wrong)
    for wn_pct, zeta in band:
        assert abs(wn_pct) < 1.0
        assert abs(zeta) < 0.015


def test_a_band_costs_next_to_nothing_where_nothing_vibrates():
    for wn_pct, zeta in errors(50.0, 20.0, "nothing", "band", seed=1):
        assert abs(wn_pct) < 1.0
        assert abs(zeta) < 0.015
