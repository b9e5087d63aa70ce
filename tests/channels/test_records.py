"""A record's rudder in deg or rad is measured: straight lines between its rows, not steps."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from least_squares import poles_of
from scipy.linalg import expm

from yawid.blocks import RecordBlock, SampleBlock
from yawid.channels.stage import Channels
from yawid.runs.job import open_log

WN, ZETA, GAIN, LEAD = 2.5, 0.2, 1.0, 0.8
TS = 0.05


def flown(rudder: np.ndarray) -> np.ndarray:
    """Return eq. 23's yaw rate (n,) for a rudder (n,) on straight lines between its samples."""
    full = np.zeros((4, 4))  # the state, the rudder, and its slope, which is constant
    full[:2, :2], full[1, 2], full[2, 3] = [[0.0, 1.0], [-(WN**2), -2.0 * ZETA * WN]], 1.0, 1.0
    step, c = expm(full * TS), GAIN * WN**2 * np.array([1.0, LEAD])
    state, found = np.zeros(2), np.zeros(len(rudder))
    for k, slope in enumerate(np.diff(rudder) / TS):
        state = (step @ [*state, rudder[k], slope])[:2]
        found[k + 1] = c @ state
    return found


def samples_of(
    path: Path, header: str, *columns: np.ndarray, **settings: object
) -> tuple[SampleBlock, Channels]:
    """Write a record; return its samples, and the channels."""
    np.savetxt(path, np.column_stack(columns), "%.17g", ",", header=header, comments="")
    source = open_log(path)
    given: dict[str, Any] = {"rudder_sign": "nose-right", "given": ("rudder_sign",), **settings}
    channels = Channels(source.settled(given))
    assert source.record is not None
    assert source.record._rows is not None
    rows = RecordBlock.joined(list(source.record._rows.pieces()))
    return SampleBlock.joined(channels.feed_rows(rows) + channels.finish()), channels


@pytest.mark.parametrize(("unit", "size"), [("rad", 1.0), ("deg", math.pi / 180)])
def test_a_rudder_on_straight_lines_gives_the_plant_back_and_held_is_half_a_sample_off(
    tmp_path: Path, unit: str, size: float
) -> None:
    t = np.arange(0.0, 60.0, TS)
    tones = (0.7, 0.0, 1.0), (1.9, 1.0, 1.0), (2.9, 0.3, 1.0), (4.1, 2.0, 0.5)
    rudder = 0.1 * sum(size * np.sin(w * t + phase) for w, phase, size in tones)
    header = f"t [s],rudder [{unit}],r [rad/s]"
    measured, held = (
        samples_of(tmp_path / "a.csv", header, t, rudder / size, flown(rudder), **options)[0]
        for options in ({}, {"rudder_is": "commanded"})
    )

    assert poles_of(measured.u[:, 0], measured.y, 3, TS)[0] == pytest.approx(WN, rel=1e-6)
    # Half a sample late: d(k) stands where (d(k) + d(k+1)) / 2 belongs.
    np.testing.assert_allclose(
        measured.u[:-1, 0], (held.u[:-1, 0] + held.u[1:, 0]) / 2.0, atol=1e-12
    )
    by_a_fit_of_these_two_alone = -8e-4
    wn, *_ = poles_of(held.u[:, 0], held.y, 3, TS)
    assert wn / WN - 1.0 == pytest.approx(by_a_fit_of_these_two_alone, rel=0.1)


@pytest.mark.parametrize(
    ("unit", "options", "measured"),
    [
        ("rad", {}, True),
        ("half-travel", {}, False),
        ("half-travel measured", {}, True),
        ("rad nose-right held", {}, False),
        ("rad nose-right held", {"rudder_is": "measured"}, True),
        ("deg", {"rudder_is": "commanded"}, False),
    ],
)
def test_the_unit_decides_what_the_column_is_and_the_option_the_header_or_an_export_overrules_it(
    tmp_path: Path, unit: str, options: dict[str, object], measured: bool
) -> None:
    t = np.arange(0.0, 20.0, TS)
    header = f"t,rudder,r\ns,{unit},rad/s"
    samples, channels = samples_of(
        tmp_path / "a.csv", header, t, 0.01 * t, 0.1 * np.sin(t), **options
    )
    size = math.pi / 180 if unit == "deg" else 1.0
    at = samples.boot_us[:-1] / 1e6 + (TS / 2 if measured else 0.0)  # the last row holds
    np.testing.assert_allclose(samples.u[:-1, 0], 0.01 * size * at, atol=1e-7)
    assert channels.surfaces[0].measured is measured
    assert channels.config.rudder_is == ("measured" if measured else "commanded")


def test_the_mean_is_that_of_the_line_at_any_rate_and_across_uneven_rows(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.choice([0.01, 0.02, 0.03], 900)).round(6)
    rudder, aileron = rng.uniform(-0.1, 0.1, (2, 900))
    header = "t,rudder [rad],r [rad/s],aileron [half-travel]"
    table = t, rudder, np.zeros(900), aileron
    samples, _ = samples_of(tmp_path / "a.csv", header, *table, rate=7.0)

    edges = np.arange(samples.k[0], samples.k[-1] + 2) / 7.0
    assert len(samples) > 100
    for k, (low, high) in enumerate(pairwise(edges)):
        fine = np.union1d([low, high], t[(t > low) & (t < high)])
        line = np.trapezoid(np.interp(fine, t, rudder), fine) * 7.0
        before = aileron[np.searchsorted(t, fine[:-1], side="right") - 1]
        if high <= t[-1]:  # beyond it the last row holds
            assert samples.u[k, 0] == pytest.approx(line, abs=1e-12)
            assert samples.aileron[k] == pytest.approx(before @ np.diff(fine) * 7.0, abs=1e-12)
