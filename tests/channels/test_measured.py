"""A record's rudder in deg or rad is measured: straight lines between its rows, not steps."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from yawid.blocks import RecordBlock, SampleBlock
from yawid.channels.stage import Channels
from yawid.runs.job import open_log

WN, ZETA, GAIN, LEAD = 2.5, 0.2, 1.0, 0.8
TS = 0.05


def flown(rudder: np.ndarray) -> np.ndarray:
    """Return eq. 23's yaw rate (n,) for a rudder (n,) on straight lines between its samples."""
    a = np.array([[0.0, 1.0], [-(WN**2), -2.0 * ZETA * WN]])
    full = np.zeros((4, 4))  # the state, the rudder, and its slope, which is constant
    full[:2, :2], full[1, 2], full[2, 3] = a, 1.0, 1.0
    step, c = expm(full * TS), GAIN * WN**2 * np.array([1.0, LEAD])
    state, found = np.zeros(2), np.zeros(len(rudder))
    for k in range(len(rudder) - 1):
        slope = (rudder[k + 1] - rudder[k]) / TS
        state = (step @ [*state, rudder[k], slope])[:2]
        found[k + 1] = c @ state
    return found


def written(path: Path, rudder_unit: str, unit: float = 1.0) -> Path:
    """Write the plant's response to a smooth rudder of 0.1 rad as a record of 60 s."""
    t = np.arange(0.0, 60.0, TS)
    tones = (0.7, 0.0, 1.0), (1.9, 1.0, 1.0), (2.9, 0.3, 1.0), (4.1, 2.0, 0.5)
    rudder = 0.1 * sum(size * np.sin(w * t + phase) for w, phase, size in tones)
    table = np.column_stack([t, rudder / unit, flown(rudder)])
    header = f"t [s],rudder [{rudder_unit}],r [rad/s]"
    np.savetxt(path, table, "%.17g", ",", header=header, comments="")
    return path


def samples_of(path: Path, **settings: object) -> tuple[SampleBlock, Channels]:
    source = open_log(path)
    channels = Channels(
        source.settled({"rudder_sign": "nose-right", "given": ("rudder_sign",), **settings})
    )
    assert source.record is not None
    assert source.record._rows is not None
    rows = RecordBlock.joined(list(source.record._rows.pieces()))
    return SampleBlock.joined(channels.feed_rows(rows) + channels.finish()), channels


def wn_of(samples: SampleBlock, nb: int = 3) -> float:
    """Return wn by least squares of an ARX(2, nb, 1) model: the poles without our estimator."""
    u, y = samples.u[:, 0], samples.y
    columns = [-np.roll(y, 1), -np.roll(y, 2), *(np.roll(u, 1 + i) for i in range(nb))]
    phi = np.stack(columns, axis=1)[nb:]
    theta = np.linalg.lstsq(phi, y[nb:], rcond=None)[0]
    s = np.log(np.roots([1.0, *theta[:2]]).astype(complex)) / TS
    return math.sqrt(abs(s[0] * s[1]))


@pytest.mark.parametrize(("unit", "size"), [("rad", 1.0), ("deg", math.pi / 180)])
def test_a_rudder_on_straight_lines_gives_the_plant_back_and_held_is_half_a_sample_off(
    tmp_path: Path, unit: str, size: float
) -> None:
    path = written(tmp_path / "a.csv", unit, size)
    measured, _ = samples_of(path)
    held, _ = samples_of(path, rudder_is="commanded")

    assert wn_of(measured) == pytest.approx(WN, rel=1e-6)
    # Half a sample late: d(k) stands where (d(k) + d(k+1)) / 2 belongs.
    np.testing.assert_allclose(
        measured.u[:-1, 0], (held.u[:-1, 0] + held.u[1:, 0]) / 2.0, atol=1e-12
    )
    assert wn_of(held) / WN - 1.0 == pytest.approx(-8e-4, rel=0.1)  # by a fit of these two alone


def test_the_unit_decides_what_the_column_is_and_the_option_the_header_or_an_export_overrules_it(
    tmp_path: Path,
) -> None:
    cases: list[tuple[str, dict[str, object], bool]] = [
        ("rad", {}, True),
        ("half-travel", {}, False),
        ("half-travel measured", {}, True),
        ("rad nose-right held", {}, False),
        ("rad nose-right held", {"rudder_is": "measured"}, True),
        ("deg", {"rudder_is": "commanded"}, False),
    ]
    t = np.arange(0.0, 20.0, TS)
    ramp = np.column_stack([t, 0.01 * t, 0.1 * np.sin(t)])
    for unit, options, measured in cases:
        header = f"t,rudder,r\ns,{unit},rad/s"
        np.savetxt(tmp_path / "a.csv", ramp, "%.6f", ",", header=header, comments="")
        samples, channels = samples_of(tmp_path / "a.csv", **options)
        size = math.pi / 180 if unit == "deg" else 1.0
        at = samples.boot_us[:-1] / 1e6 + (TS / 2 if measured else 0.0)  # the last row holds
        np.testing.assert_allclose(samples.u[:-1, 0], 0.01 * size * at, atol=1e-7, err_msg=unit)
        assert channels.surfaces[0].measured is measured
        assert channels.config.rudder_is == ("measured" if measured else "commanded")


def test_the_mean_is_that_of_the_line_at_any_rate_and_across_uneven_rows(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.choice([0.01, 0.02, 0.03], 900)).round(6)
    rudder, aileron = rng.uniform(-0.1, 0.1, (2, 900))
    table = np.column_stack([t, rudder, np.zeros(900), aileron])
    header = "t,rudder [rad],r [rad/s],aileron [half-travel]"
    np.savetxt(tmp_path / "a.csv", table, "%.17g", ",", header=header, comments="")
    samples, _ = samples_of(tmp_path / "a.csv", rate=7.0)

    edges = np.arange(samples.k[0], samples.k[-1] + 2) / 7.0
    assert len(samples) > 100
    for k, (low, high) in enumerate(pairwise(edges)):
        fine = np.union1d([low, high], t[(t > low) & (t < high)])
        line = np.trapezoid(np.interp(fine, t, rudder), fine) * 7.0
        before = aileron[np.searchsorted(t, fine[:-1], side="right") - 1]
        if high <= t[-1]:  # beyond it the last row holds
            assert samples.u[k, 0] == pytest.approx(line, abs=1e-12)
            assert samples.aileron[k] == pytest.approx(before @ np.diff(fine) * 7.0, abs=1e-12)
