"""Samples, motion and facts are the same however the stream was cut into blocks."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from drawn import examples
from flightlog import beat, every, fly, hud, samples_of, told
from flights.surgery import join
from hypothesis import example, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held, MotionBlock, Noted, SampleBlock
from yawid.config.run import RunConfig


def outputs(t: float) -> list[int]:
    """The second rudder is servo 2, which stands still in the end; servo 5 is a lift motor."""
    rudder = round(200 * math.sin(2.5 * t))
    driven = 1600 if 8.0 < t < 9.0 else 1000
    return [1500 + rudder // 2, 1500 + rudder * (t < 5.0), 1500 - rudder, 1500 + rudder, driven]


def pulses(t: float) -> list[int]:
    """Return outputs that are off for a while."""
    return [0] * 8 if 3.0 < t < 3.6 else outputs(t)


def rate(t: float) -> float:
    return math.nan if 2.0 < t < 2.1 else 0.2 * math.sin(2.5 * t) + 0.05 * math.sin(52.0 * t)


def imu(t: float) -> Any:
    return mavlink.MAVLink_raw_imu_message(round(1e6 * (10.0 + t)), 0, 50, -1000, *[0] * 6)


def lives() -> bytes:
    """An ArduPlane takes off, hovers, changes its rudder, and boots again."""
    functions = {"SERVO2_FUNCTION": 21, "SERVO4_FUNCTION": 21, "SERVO5_FUNCTION": 33}
    more = [(0.0, told(name, value)) for name, value in functions.items()]
    more += every(0.2, 12.0, lambda t: hud(2.0 + 5.0 * t, 2.0 + 5.0 * t, 100.0 + 4.0 * t))
    more += every(1.0, 12.0, lambda t: beat(base_mode=128, mode=17 if 10.5 < t < 11.5 else 5))
    bank = {"roll": lambda t: 0.4 * math.sin(0.8 * t), "yaw": lambda t: 2.0 * t}
    first = fly(rate, outputs, 12.0, skip=lambda t: 6.0 < t < 7.5,
                more=[*more, *every(0.04, 12.0, imu)], **bank)  # fmt: skip
    gust = every(0.2, 8.0, lambda t: hud(30.0 if t > 6.0 else 22.0, 22.0))
    trim = fly(rate, pulses, 8.0, start_s=22.0, more=[(0.0, told("SERVO4_MAX", 2000)), *gust])
    names = [(0.0, told("SERVO2_FUNCTION", 0))]
    renamed = fly(rate, outputs, 8.0, start_s=30.01, more=names)
    return first.data + trim.data + renamed.data + fly(rate, outputs, 8.0, start_s=2.0).data


def controls(t: float) -> Any:
    us = round(1e6 * (10.0 + t))
    return mavlink.MAVLink_actuator_output_status_message(us, 8, [1500.0 + 10 * t] * 32)


def leap() -> bytes:
    """A PX4 sends its outputs by one message, then by two, then its clock leaps."""
    names = {"CA_SV_CS0_TYPE": 4, "PWM_MAIN_FUNC1": 201}
    more = [(0.0, told(name, value)) for name, value in names.items()]
    first = fly(rate, lambda t: [1600] * 4, 10.0, skip=lambda t: t < 2.0, vehicle=beat(1, 12),
                more=[*more, *every(0.02, 10.0, controls)])  # fmt: skip
    later = fly(rate, outputs, 8.0, start_s=467.0).records
    return join([*first.records, *((stamp - 447_000_000, frame) for stamp, frame in later)])


STILL = fly(lambda t: 0.1, lambda t: [1500 + (t > 4.0)] * 4, 8.0, vehicle=beat(1, 12)).data


def climb(t: float) -> Any:
    """A slow aircraft climbs, its altitude leaps, and it is fast for a second."""
    speed = 13.0 if 16.0 < t < 17.0 else 3.0
    return hud(speed, speed, 300.0 + 4.0 * t + 690.0 * (t > 10.0))


CLIMB = every(0.2, 20.0, climb)
SLOW = fly(rate, outputs, 20.0, more=[*CLIMB, *every(1.0, 20.0, lambda t: beat(base_mode=128))])
LOGS = {"lives": lives(), "leap": leap(), "still": STILL, "slow": SLOW.data}
CONFIGS = {
    "as they are": ("lives", RunConfig()),
    "without the turn, filtered and thinned": (
        "lives",
        RunConfig(rate=10.0, band=(0.02, 2.5), turn="remove"),
    ),
    "the yaw": ("lives", RunConfig(output="yaw")),
    "a part, with its motion": ("lives", RunConfig(lateral="auto", from_s=14.0, to_s=33.0)),
    "a boot": ("lives", RunConfig(boot=1, band=(0.2, 3.0))),
    "another clock": ("leap", RunConfig(from_s=12.0)),
    "a slow climb": ("slow", RunConfig(rudder="servo:4")),
    "outputs that stand still": ("still", RunConfig(rudder="servo:4", from_s=13.2, to_s=15.7)),
}


def facts(name: str, cuts: tuple[int, ...] = ()) -> dict[str, Any]:
    """Return all samples, all lateral motion, and what is counted over the stream."""
    log, config = CONFIGS[name]
    data = LOGS[log]
    found = samples_of(data, config, [cut % len(data) for cut in cuts])
    columns = {name: getattr(found, name) for name in SampleBlock.__slots__[1:]}
    if found.motion:
        motion = MotionBlock.joined(found.motion)
        for lane in MotionBlock.__slots__:
            rows = getattr(motion, lane)
            columns |= {f"{lane} {name}": getattr(rows, name) for name in rows.__slots__}
    channels = found.channels
    command, steps = channels.command, channels.segmenter
    return columns | {
        "counted": (channels.boots, channels.flows, channels.twins),
        "steps": (steps.reboots, steps.clock_steps, steps.leap_us, steps.silences),
        # Once the outputs have moved, what else they do is not looked at.
        "command": (command.moved or command.outputs, command.armed or command.disarmed),
    }


whole = cache(facts)


def test_the_logs_have_every_event():
    lives, leap = whole("as they are"), whole("another clock")
    held = np.bitwise_or.reduce(lives["held"])
    for why in (Held.GAP, Held.REBOOT, Held.YAW_INVALID, Held.RUDDER_INVALID, Held.RUDDER_CHANGED,
                Held.HOVER, Held.LIFT_MOTORS, Held.ON_GROUND):  # fmt: skip
        assert held & why, why
    noted = Noted.MODE_CHANGED | Noted.AIRSPEED_CHANGED | Noted.NOT_EXCITED
    assert np.bitwise_or.reduce(lives["noted"]) & noted == noted
    assert len(set(lives["epoch"])) == 2
    # Until it is 15 m high, again after the leap, and after it was fast.
    stands = (whole("a slow climb")["held"] & Held.ON_GROUND) != 0
    assert np.count_nonzero(np.diff(stands.astype(int))) == 4
    assert len(whole("outputs that stand still")["command"][0]) == 4
    assert len(whole("a part, with its motion")["acceleration t_us"]) > 100
    assert leap["steps"][1] == 1


@pytest.mark.parametrize("name", CONFIGS)
@examples(6)
@given(cuts=st.lists(st.integers(0, 10**6), max_size=25).map(tuple))
@example(cuts=tuple(range(0, 230_000, 1511)))  # in every record
def test_nothing_depends_on_how_the_stream_was_cut(name: str, cuts: tuple[int, ...]):
    np.testing.assert_equal(facts(name, cuts), whole(name))


def test_a_band_thins_the_samples_of_the_grid_and_invents_none():
    plain = samples_of(LOGS["lives"], RunConfig(rate=10.0, turn="remove"))
    thinned = whole("without the turn, filtered and thinned")
    for epoch in set(plain.epoch):
        used = [
            {*zip(k[good], us[good], strict=True)}
            for k, us, held, of in (
                [thinned[name] for name in ("k", "boot_us", "held", "epoch")],
                (plain.k, plain.boot_us, plain.held, plain.epoch),
            )
            for good in [(held == 0) & (of == epoch)]
        ]
        # At each break a sample of which a part is missing may be lost, none is invented.
        assert used[0] <= used[1]
        assert len(used[1] - used[0]) <= 9
    np.testing.assert_array_equal(thinned["boot_us"], np.rint(thinned["k"] * 1e5))
