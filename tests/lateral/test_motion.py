"""A stretch of motion, and roll at the times of its rates."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lateral.flown import flown

from yawid.lateral.model import RUDDER
from yawid.lateral.motion import COMMAND_STEP_S, LEAD_S, Motion
from yawid.lateral.record import Record


def motion(**changed: Any) -> Motion:
    """Return one second of rest at 10 Hz with commands from half a second before."""
    zero = np.zeros(10)
    commands = np.zeros(round(1.5 / COMMAND_STEP_S))
    given: dict[str, Any] = {
        "sample_time_s": 0.1, "p": zero, "r": zero, "roll": zero, "pitch": zero, "q": zero,
        "commands_start_s": -0.5, "rudder": commands, "aileron": commands, "airspeed_m_s": 40.0,
    }  # fmt: skip
    return Motion(**(given | changed))


def test_the_commands_times_begin_before_the_measurements() -> None:
    times = motion().command_times_s()

    assert times[0] == -0.5
    assert times[100] == pytest.approx(0.0)


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
    mean[first : first + added.shape[2]], slope[first : first + added.shape[2]] = added[:, 0]
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
    for seed in range(20):
        assert Record(flown(seed, amplitude=0.003, aileron=0.0)).roll_delay_s == 0.0
