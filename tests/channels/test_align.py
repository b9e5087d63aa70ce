"""The grid of the contract: y at the instant, u as the mean over the interval that follows."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flightlog import fly, samples_of
from scipy.signal import lsim

from yawid.blocks import Held, RecordBlock, SampleBlock
from yawid.channels.stage import Channels
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.runs.job import open_log

START_S = 10.0


def test_yaw_rate_is_interpolated_to_the_instant():
    log = fly(lambda t: 0.1 * t, lambda t: 1500, 20.0, attitude_s=0.07)
    found = samples_of(log.data, RunConfig(rate=12.5))

    # time_boot_ms is whole milliseconds: 0.1 rad/s^2 * 0.5 ms.
    expected = 0.1 * (found.k * 0.08 - START_S)
    np.testing.assert_allclose(found.y, expected, atol=1e-4)
    np.testing.assert_array_equal(found.boot_us, found.k * 80_000)
    np.testing.assert_allclose(np.diff(found.unix_ns)[100:], 8e7, atol=1e3)


def test_the_rudder_is_the_mean_of_the_held_value_over_the_interval_that_follows():
    pwm = {0: 1500, 1: 1600, 2: 1500, 3: 1900}

    def rudder(t: float) -> int:
        return pwm[int(t) % 4]

    log = fly(lambda t: 0.0, rudder, 20.0)
    found = samples_of(log.data, RunConfig(rate=10.0))

    # Servo messages come at 4 ms + n * 20 ms and hold until the next.
    fine = np.arange(0.0, 20.1, 1e-3)
    sent = np.floor((fine - 0.004 + 1e-9) / 0.02) * 0.02 + 0.004
    held = np.array([(rudder(max(t, 0.0)) - 1500) / 400 for t in sent])
    for k, u in zip(found.k, found.u[:, 0], strict=True):
        first = round((k * 0.1 - START_S) * 1000)
        assert u == pytest.approx(held[first : first + 100].mean(), abs=1e-9)


def test_a_rudder_that_steps_within_a_sample_is_marked_and_one_that_steps_at_an_instant_is_not():
    # Servo messages come at 10 s + n * 20 ms: at 13 s, an instant, and at 15.04 s, between two.
    log = fly(lambda t: 0.0, lambda t: 1500 + 99 * (t > 3.0) + 99 * (t > 5.03), 9.0, start_s=9.996)
    found = samples_of(log.data, RunConfig(rate=20.0))

    assert (found.boot_us[found.rudder_moves == 1.0] / 1e6).tolist() == [15.0]
    assert set(found.rudder_moves.tolist()) == {0.0, 1.0}


def test_a_gap_is_a_break_and_never_filled():
    log = fly(lambda t: t, lambda t: 1500, 20.0, skip=lambda t: 7.0 < t < 8.0)
    found = samples_of(log.data)

    held = np.flatnonzero(found.held)
    assert found.held[held].tolist() == [Held.GAP]
    assert found.k[held[0] + 1] - found.k[held[0]] == pytest.approx(20, abs=2)
    assert np.isnan(found.y[held]).all()
    assert found.channels.aligner.gaps == 1


def test_one_lost_message_is_no_gap():
    lost = {5.0, 9.0, 13.0}
    log = fly(lambda t: t, lambda t: 1500, 20.0, skip=lambda t: round(t, 3) in lost)
    assert not samples_of(log.data).held.any()


@pytest.mark.parametrize(("attitude_s", "servo_s", "rate"), [(0.1, 0.2, 5.0), (0.02, 0.02, 20.0)])
def test_the_default_rate_is_20_hz_or_the_slower_channels_above_which_none_is_taken(
    attitude_s: float, servo_s: float, rate: float
):
    log = fly(lambda t: t, lambda t: 1500, 20.0, attitude_s=attitude_s, servo_s=servo_s)

    assert 1.0 / samples_of(log.data).blocks[0].sample_time_s == pytest.approx(rate)
    most = 1.0 / max(attitude_s, servo_s)
    with pytest.raises(ConfigError, match=rf"--rate {most:g} or less$"):
        samples_of(log.data, RunConfig(rate=1.1 * most))


def wn_of(u: np.ndarray, y: np.ndarray) -> float:
    """Return by least squares wn of the ARX(2, 3, 1) model of u and y (n,)."""
    columns = [-np.roll(y, 1), -np.roll(y, 2), *(np.roll(u, 1 + i) for i in range(3))]
    theta = np.linalg.lstsq(np.stack(columns, axis=1)[3:], y[3:], rcond=None)[0]
    poles = np.roots([1.0, *theta[:2]]).astype(complex)
    return math.sqrt(abs(np.prod(np.log(poles)))) / TS


TS, WN, ZETA, GAIN, LEAD = 0.05, 2.5, 0.2, 1.0, 0.8
PLANT = [GAIN * WN**2 * LEAD, GAIN * WN**2], [1.0, 2.0 * ZETA * WN, WN**2]
"""Eq. 23, from the rudder to the yaw rate."""


def of_record(
    path: Path, header: str, *columns: np.ndarray, **settings: object
) -> tuple[SampleBlock, Channels]:
    """Write a record; return its samples, and the channels."""
    np.savetxt(path, np.column_stack(columns), "%.17g", ",", header=header, comments="")
    source = open_log(path)
    given: dict[str, Any] = {"rudder_sign": "nose-right", "given": ("rudder_sign",), **settings}
    channels = Channels(source.settled(given))
    rows = RecordBlock.joined([rows for _, rows in source.record.read() if rows])
    return SampleBlock.joined(channels.feed_rows(rows) + channels.finish()), channels


@pytest.mark.parametrize(("unit", "size"), [("rad", 1.0), ("deg", math.pi / 180)])
def test_a_rudder_on_straight_lines_gives_the_plant_back_and_held_is_half_a_sample_off(
    tmp_path: Path, unit: str, size: float
) -> None:
    t = np.arange(0.0, 60.0, TS)
    tones = (0.7, 0.0, 1.0), (1.9, 1.0, 1.0), (2.9, 0.3, 1.0), (4.1, 2.0, 0.5)
    rudder = 0.1 * sum(size * np.sin(w * t + phase) for w, phase, size in tones)
    _, rate, _ = lsim(PLANT, rudder, t)  # on straight lines between its samples
    header = f"t [s],rudder [{unit}],r [rad/s]"
    measured, held = (
        of_record(tmp_path / "a.csv", header, t, rudder / size, rate, **options)[0]
        for options in ({}, {"rudder_is": "commanded"})
    )

    assert wn_of(measured.u[:, 0], measured.y) == pytest.approx(WN, rel=1e-6)
    # Half a sample late: d(k) stands where (d(k) + d(k+1)) / 2 belongs.
    np.testing.assert_allclose(
        measured.u[:-1, 0], (held.u[:-1, 0] + held.u[1:, 0]) / 2.0, atol=1e-12
    )
    by_a_fit_of_these_two_alone = -8e-4
    assert wn_of(held.u[:, 0], held.y) / WN - 1.0 == pytest.approx(
        by_a_fit_of_these_two_alone, rel=0.1
    )


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
    samples, channels = of_record(
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
    samples, _ = of_record(tmp_path / "a.csv", header, *table, rate=7.0)

    edges = np.arange(samples.k[0], samples.k[-1] + 2) / 7.0
    assert len(samples) > 100
    for k, (low, high) in enumerate(pairwise(edges)):
        fine = np.union1d([low, high], t[(t > low) & (t < high)])
        line = np.trapezoid(np.interp(fine, t, rudder), fine) * 7.0
        before = aileron[np.searchsorted(t, fine[:-1], side="right") - 1]
        if high <= t[-1]:  # beyond it the last row holds
            assert samples.u[k, 0] == pytest.approx(line, abs=1e-12)
            assert samples.aileron[k] == pytest.approx(before @ np.diff(fine) * 7.0, abs=1e-12)
