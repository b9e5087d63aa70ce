"""The stage: what an autopilot flies is found and answered.

ArduPilot's plane-doublets.lua changes to MANUAL, pins the aileron to its trim and at once moves the
rudder, DOUBLET_TIME / 2 to either side, a third of its travel; the HEARTBEAT tells MANUAL up to a
second later. PX4's autotune adds steps or a sweep to the setpoint of its yaw-rate loop.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, WN, ZETA, rest, stream, yawing

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Floats, SampleBlock
from yawid.config.run import RunConfig
from yawid.manoeuvre.judge import ManoeuvreSetting
from yawid.manoeuvre.stage import Manoeuvres


def answers(samples: SampleBlock, autopilot: int = 3) -> list[Manoeuvre]:
    stage = Manoeuvres(ManoeuvreSetting(RunConfig(), TS_S, (20.0, 20.0), (autopilot, 1)))
    stage.feed(samples, {})
    stage.finish()
    return list(stage.ready())


FBWA, MANUAL, PX4_LOITER = 5.0, 0.0, 50_593_792.0
BEGIN = 30 * HZ


def by_script(time_s: float, late_s: float, before: float = FBWA) -> SampleBlock:
    """A doublet by plane-doublets.lua, six seconds of MANUAL after it, then as before."""
    half, held = round(time_s / 2 * HZ), round((time_s + 6.0) * HZ)
    rudder = np.concatenate([np.full(half, -1 / 3), np.full(half, 1 / 3), rest(6.0)])
    level = 0.1 * np.convolve(np.random.default_rng(3).standard_normal(70 * HZ), np.ones(9) / 9)
    aileron = level[: BEGIN + held + 20 * HZ]
    aileron[BEGIN : BEGIN + held] = 0.0
    whole = np.concatenate([0.5 * aileron[:BEGIN], rudder, 0.5 * aileron[BEGIN + held :]])
    mode, told = np.full(len(whole), before), BEGIN + round(late_s * HZ)
    mode[told : told + held] = MANUAL
    y = yawing(whole, 0.2 * aileron, noise=0.002)
    return stream(whole, aileron=aileron, mode=mode, y=y)


def by_autotune(signal: Floats) -> SampleBlock:
    """A signal added to the setpoint of the yaw-rate loop, which feeds the measured rate back."""
    setpoint = np.concatenate([rest(30), signal, rest(20)])
    rudder = 0.3 * setpoint
    for _ in range(30):  # u = FF s + P (s - r), r of the u before: it contracts
        rudder = 0.3 * setpoint + 0.05 * (setpoint - yawing(rudder, noise=0.002))
    return stream(rudder, aileron=0.0, mode=PX4_LOITER, y=yawing(rudder, noise=0.002))


def assert_right(each: Manoeuvre) -> None:
    roll = each.dutch_roll
    assert each.verdict.usable, each.verdict.reasons
    assert roll.wn_rad_s == pytest.approx(WN, rel=0.02)
    assert roll.zeta == pytest.approx(ZETA, abs=0.02)


@pytest.mark.parametrize("late_s", [0.0, 0.3, 0.6, 0.95])
def test_a_doublet_by_the_script_is_one_manoeuvre_in_manual(late_s: float):
    [each] = answers(by_script(0.5, late_s))

    assert_right(each)
    assert (each.mode, each.loop) == ("MANUAL", "airframe")
    assert (BEGIN - HZ) * TS_S <= each.from_s < BEGIN * TS_S
    # zeta * WN = 1.8: the envelope of the yaw rate is a tenth 1.3 s after the doublet of .5 s,
    # and 4 s later, in whole seconds, the 5 s of rest have passed too.
    assert each.to_s == pytest.approx(30.0 + math.ceil(0.5 + 1.3 + 4.0) - TS_S)


@pytest.mark.parametrize("kind", ["steps", "sweep"])
def test_px4s_autotune_is_a_manoeuvre(kind: str):
    t = np.arange(10 * HZ) / HZ
    signal = np.sin(2 * np.pi * (t + 0.45 * t**2))  # 1 to 10 Hz in 10 s, as by default
    if kind == "steps":
        lengths = [5, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 5, 4, 3, 2, 1]  # of 0.1 s, 1 and 0 in turn
        steps = np.repeat(np.arange(len(lengths)) % 2 == 0, np.multiply(lengths, 2)).astype(float)
        slow = np.convolve(steps, 0.25 * 0.75 ** np.arange(40))[: len(steps)]
        signal = steps - slow
    [each] = answers(by_autotune(signal), 12)

    assert_right(each)
    assert each.loop == "with_roll_loop"
