"""The rates of the whole run, counted over the time in which each channel flowed."""

from __future__ import annotations

import numpy as np
import pytest
from flightlog import FlightLog, fly, reason_ids, samples_of, summary_of
from hypothesis import given
from hypothesis import strategies as st

from yawid.channels.grid_rate import Flow


def log_of(attitude_s: list[float], servo_s: list[float]) -> bytes:
    """Return a log with messages at these times."""
    log = FlightLog()
    log.heartbeat(1.0)
    for t, kind in sorted([(t, 0) for t in attitude_s] + [(t, 1) for t in servo_s]):
        if kind == 0:
            log.attitude(t, 0.1 * np.sin(t))
        else:
            log.servos(t, [1500, 1500, 1500, 1500 + round(100 * (t % 2.0))])
    return log.data


def test_a_servo_stream_that_begins_late_has_not_changed_its_rate():
    attitude = np.arange(10.0, 160.0, 0.05).tolist()
    servos = np.arange(130.0, 160.0, 0.05).tolist()
    summary = summary_of(log_of(attitude, servos))

    assert summary["channels"]["yaw"]["rate_hz"] == pytest.approx(20.0)
    assert summary["estimates"]
    assert "rate_changed" not in reason_ids(summary)


def test_the_rate_told_is_that_of_the_whole_run_beside_the_one_that_chose_the_grid():
    fast, slow = np.arange(10.0, 18.0, 0.04), np.arange(18.0, 78.0, 0.12)
    both = np.concatenate([fast, slow]).tolist()
    summary = summary_of(log_of(both, [t + 0.01 for t in both]))

    mean = (len(both) - 1) / (both[-1] - both[0])
    for name in ("yaw", "rudder"):
        assert summary["channels"][name]["rate_hz"] == pytest.approx(mean, rel=0.01)
        assert summary["channels"][name]["first_rate_hz"] == pytest.approx(25.0, rel=0.01)
    assert summary["estimates"]["els"]["sample_time_s"] == pytest.approx(0.05)
    assert "rate_changed" in reason_ids(summary)


def test_an_even_rate_is_told_once():
    summary = summary_of(fly(lambda t: 0.1 * np.sin(t), lambda t: 1500, 20.0).data)
    assert summary["channels"]["yaw"]["rate_hz"] == 50.0
    assert "first_rate_hz" not in summary["channels"]["yaw"]


def test_a_silence_a_reboot_and_a_repeated_message_are_no_part_of_the_rate():
    flow = Flow()
    for start in (100.0, 140.0, 20.0):  # a gap, then a clock that starts anew
        flow.observe((1e6 * (start + np.repeat(np.arange(50), 2) * 0.1)).astype(np.int64))

    assert flow.rate_hz == pytest.approx(10.0)
    assert flow.flowed_us == 3 * 4_900_000


@given(
    steps=st.lists(
        st.sampled_from([0, 20_000, 40_000, -3000, -90_000_000, 5_000_000]), max_size=30
    ),
    cuts=st.lists(st.integers(0, 30), max_size=5),
)
def test_the_count_does_not_depend_on_the_cut(steps: list[int], cuts: list[int]):
    t_us = np.cumsum([10_000_000, *steps])
    whole, cut = Flow(), Flow()
    whole.observe(t_us)
    for piece in np.split(t_us, sorted(cuts)):
        cut.observe(piece)

    assert cut == whole


def test_the_flows_of_a_log_do_not_depend_on_the_cut():
    data = log_of([10.0 + 0.1 * i for i in range(300)], [12.0 + 0.11 * i for i in range(200)])
    flows = [samples_of(data, cuts=cuts).channels.flows for cuts in ((), range(0, len(data), 311))]
    assert flows[0] == flows[1]
