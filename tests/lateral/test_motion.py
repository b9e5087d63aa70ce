"""The motion of a manoeuvre: on its grids, with gaps left open, roll at the times of its rates."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lateral.flown import flown
from manoeuvre.streams import stream

from yawid.blocks import MotionBlock, StampedRows
from yawid.lateral.model import RUDDER
from yawid.lateral.motion import COMMAND_STEP_S, LEAD_S, Motion
from yawid.lateral.motion_store import MotionStore, angle_of_climb, motion_of
from yawid.lateral.record import Record
from yawid.quantities.airspeed import Kind

W = 2.0
"""The frequency of every sine here in rad/s."""


def rows(t_s: np.ndarray, *columns: Any) -> StampedRows:
    t_us = np.rint(1e6 * t_s).astype(np.int64)
    values = np.column_stack([np.broadcast_to(c, len(t_s)) for c in columns])
    return StampedRows(t_us, 1000 * t_us, values)


def attitude(t_s: np.ndarray) -> StampedRows:
    return rows(t_s, np.sin(W * t_s), 0.1, np.cos(W * t_s), 0.0, -np.sin(W * t_s))


def commands(t_s: np.ndarray, aileron: float = 0.0) -> StampedRows:
    return rows(t_s, np.sin(W * t_s), aileron, 0.0, 1.0)


NONE = rows(np.zeros(0), np.zeros(0), np.zeros(0))
SERVOS = commands(9.0 + 0.02 * np.arange(600) + 0.007)


def made(of: StampedRows, servos: StampedRows = SERVOS) -> Motion:
    motion = motion_of(of, servos, 20.0)
    assert isinstance(motion, Motion)
    return motion


def test_it_is_on_its_own_grids_from_its_first_attitude():
    motion = made(attitude(10.0 + 0.04 * np.arange(200)))

    t = 10.0 + motion.sample_time_s * np.arange(len(motion.p))
    fine = 10.0 + motion.command_times_s()
    assert motion.sample_time_s == pytest.approx(0.04)
    assert len(motion.p) == 200
    assert np.allclose(motion.roll, np.sin(W * t), atol=1e-5)
    assert np.allclose(motion.r, -np.sin(W * t), atol=1e-5)
    assert motion.commands_start_s == pytest.approx(-0.5)
    # On lines between stamps 20 ms apart a sine is wrong by (W 0.02)^2 / 8 at most.
    assert np.abs(motion.rudder - np.sin(W * fine)).max() < (W * 0.02) ** 2 / 8 + 1e-9


def test_times_that_jitter_are_put_on_the_grid_and_a_gap_stays_open():
    rng = np.random.default_rng(1)
    t = 10.0 + 0.04 * np.arange(200) + rng.uniform(-0.004, 0.004, 200)
    t = np.delete(t, slice(100, 110))

    motion = made(attitude(t))

    at = t[0] + motion.sample_time_s * np.arange(len(motion.p))
    lost = np.isnan(motion.p)
    inside = (at > t[99] + 0.02) & (at < t[100] - 0.02)
    assert 8 <= lost.sum() <= 11
    assert lost[inside].all()
    assert np.abs(motion.p - np.cos(W * at))[~lost].max() < 2e-3


def test_even_times_that_are_cut_to_whole_ms_are_even_again():
    """Every 19.93 ms: cut to ms, times are up to 1 ms early, and a sine of 5 rad/s 0.5 %."""
    exact = 10.0 + 0.01993 * np.arange(500)
    sent = attitude(exact)
    cut = StampedRows(sent.t_us // 1000 * 1000, sent.unix_ns, sent.values)
    lost = cut.select(np.r_[0:200, 230:500])

    for each in (cut, lost):
        motion = made(each)
        # Where it begins is known to a ms; the steps are even.
        t = motion.sample_time_s * np.arange(len(motion.p))
        known = np.isfinite(motion.roll)
        phase = np.unwrap(np.arctan2(motion.roll, motion.p)[known])
        late = phase / W - t[known]
        assert motion.sample_time_s == pytest.approx(0.01993, rel=1e-4)
        assert np.ptp(late) < 2e-4


def test_fast_attitudes_are_averaged_without_a_delay_and_slow_servos_set_the_step():
    """The mean of 9 values 2.5 ms apart around t is sin(W t) within 1 - (9 W 0.0025)^2 / 24.

    19.5 ms is the least step: 8 of 2.5 ms, neither 7 nor 9.
    """
    motion = made(
        attitude(10.0 + 0.0025 * np.arange(3000)), commands(9.0 + 0.005 * np.arange(2000))
    )
    slow = made(attitude(10.0 + 0.02 * np.arange(400)), commands(9.0 + 0.1 * np.arange(110)))

    t, inner = 10.0 + motion.sample_time_s * np.arange(len(motion.p)), slice(1, -1)
    assert (motion.sample_time_s, slow.sample_time_s) == pytest.approx((0.02, 0.1))
    assert np.abs(motion.roll - np.sin(W * t))[inner].max() < 1e-4


@pytest.mark.parametrize(
    ("servos", "why"),
    [
        (commands(10.5 + 0.02 * np.arange(600)), "do not cover"),
        (commands(9.0 + 0.02 * np.arange(60)), "do not cover"),
        (commands(np.delete(9.0 + 0.02 * np.arange(600), slice(100, 150))), "no servo message for"),
    ],
)
def test_commands_that_are_missing_are_the_cause(servos: StampedRows, why: str):
    motion = motion_of(attitude(10.0 + 0.04 * np.arange(200)), servos, 20.0)

    assert isinstance(motion, str)
    assert why in motion


def test_an_aileron_that_nothing_reports_is_not_known():
    t = 10.0 + 0.04 * np.arange(200)
    unknown, known = (made(attitude(t), commands(9.0 + 0.02 * np.arange(600), a))
                      for a in (np.nan, 0.3))  # fmt: skip

    assert (unknown.aileron_known, known.aileron_known) == (False, True)
    assert np.all(unknown.aileron == 0.0)
    assert np.allclose(known.aileron, 0.3)


def test_the_angle_of_climb_is_that_of_altitude_and_airspeed():
    """2 m/s at 20 m/s; without an altitude, level flight is assumed."""
    t_s = np.arange(200) * 0.05
    climbing = stream(0.0 * t_s, altitude=100.0 + 2.0 * t_s)

    assert angle_of_climb(climbing, 20.0) == pytest.approx(math.asin(0.1), rel=1e-6)
    assert angle_of_climb(stream(0.0 * t_s, altitude=np.nan), 20.0) == 0.0


@pytest.mark.parametrize("kind", [Kind.EQUIVALENT, Kind.TRUE])
def test_the_airspeed_is_the_true_one_whatever_kind_the_source_gave(kind: Kind):
    """Samples have the equivalent one: at 4000 m the air has .6689 of its density at sea level"""
    store = MotionStore(120.0)
    store.feed(MotionBlock(attitude(10.0 + 0.02 * np.arange(400)), SERVOS, NONE))
    samples = stream(np.zeros(120), first_k=200, airspeed=20.0, altitude=4000.0)
    found = store.cut(replace(samples, airspeed_kind=np.full(len(samples), float(kind))))

    assert isinstance(found, Motion)
    assert found.airspeed_m_s == pytest.approx(20.0 / math.sqrt(0.6689), rel=1e-3)


def motion(**changed: Any) -> Motion:
    """Return one second of rest at 10 Hz with commands from half a second before."""
    zero = np.zeros(10)
    commands = np.zeros(round(1.5 / COMMAND_STEP_S))
    given: dict[str, Any] = {
        "sample_time_s": 0.1, "p": zero, "r": zero, "roll": zero, "pitch": zero, "q": zero,
        "commands_start_s": -0.5, "rudder": commands, "aileron": commands, "airspeed_m_s": 40.0,
    }  # fmt: skip
    return Motion(**(given | changed))


@pytest.mark.parametrize("lag_s", [0.0, 0.002, 0.05])
@pytest.mark.parametrize("delay_s", [0.0, 0.0099, 0.0101])
def test_what_a_late_jump_adds_is_that_of_jumps_anywhere_in_a_sample(
    lag_s: float, delay_s: float
) -> None:
    """A regression on the lateness of jumps that are spread evenly over a sample of 0.1 s."""
    times = np.arange(round(1.5 / COMMAND_STEP_S)) * COMMAND_STEP_S - LEAD_S
    late = (np.arange(20) - 9.5) * COMMAND_STEP_S
    line = np.interp(times, [0.5, 0.6], [0.0, 1.0])
    jumps = [np.interp(times - 0.55 - x, [-0.0025, 0.0025], [0.0, 1.0]) for x in late]

    inputs = np.array([Record(motion(rudder=u)).inputs(lag_s, delay_s) for u in jumps])
    expected = np.tensordot(late, inputs, 1) / np.sum(late**2)
    expected -= expected[0]  # of the commands' mean, which is taken away

    record = Record(motion(rudder=line))
    surface, [first], added = record.later(lag_s, delay_s)
    assert [surface] == [jump[0] for jump in record.jumps] == [RUDDER]
    mean, slope = np.zeros((2, len(expected)))
    end, last = first + added.shape[2], added[:, 0, -1]
    mean[first:end], slope[first:end] = added[:, 0]
    fades = np.exp(-0.1 * np.arange(1, len(mean) - end + 1) / max(lag_s, 1e-9))
    mean[end:], slope[end:] = last[0] * fades, last[1] * fades
    np.testing.assert_allclose(mean, expected[:, RUDDER], atol=0.1)
    np.testing.assert_allclose(slope, expected[:, 4 + RUDDER], atol=2.0)


def test_a_roll_angle_of_another_time_than_its_rates_is_taken_in_time() -> None:
    """Roll is 10 ms early, as where the gyros are filtered; taken as it is, it is 3e-3 rad off."""
    fine = flown(seconds=12.0, rate_hz=200.0, amplitude=0.3)
    n = len(fine.p) // 4 - 1

    def sampled(early: int) -> Record:
        its = {x: getattr(fine, x)[: 4 * n : 4] for x in ("p", "r", "pitch", "q")}
        roll = fine.roll[early : 4 * n + early : 4]
        return Record(replace(fine, sample_time_s=0.02, roll=roll, **its))

    early, in_time = sampled(2), sampled(0)

    assert in_time.roll_delay_s == 0.0
    assert early.roll_delay_s == pytest.approx(-0.010, abs=0.001)
    np.testing.assert_allclose(early.y[2:-2, 2], in_time.y[2:-2, 2], atol=2e-5)


def test_noise_is_no_other_time_of_the_roll_angle() -> None:
    """The aircraft hardly moves, so that only noise says when roll is measured."""
    for seed in range(8):
        assert Record(flown(seed, amplitude=0.003, aileron=0.0)).roll_delay_s == 0.0
