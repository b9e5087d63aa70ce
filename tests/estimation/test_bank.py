"""What a bank remembers of the samples: the newest, as many as its models know something of."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from estimation.armax_plants import S1, simulate
from hypothesis import given
from hypothesis import strategies as st
from sinks.sink_blocks import SAMPLE_TIME_S, make_samples

from yawid.blocks import SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.bank import MEMORIES, Bank, Ring


@given(limit=st.integers(1, 40), cuts=st.lists(st.integers(0, 60), max_size=12))
def test_a_ring_holds_the_newest_rows_however_they_came(limit: int, cuts: list[int]) -> None:
    total = sum(cuts)
    rows, pairs = np.arange(float(total)), np.arange(2.0 * total).reshape(-1, 2)
    record = Ring(limit)
    at = 0
    for count in cuts:
        record.add(rows[at : at + count], pairs[at : at + count])
        at += count
    assert len(record) == min(total, limit)
    if cuts:
        for newest in (limit, 3):
            for kept, column in zip(record.joined(newest), (rows, pairs), strict=True):
                np.testing.assert_array_equal(kept, column[max(0, total - min(limit, newest)) :])


CONFIG = RunConfig(orders=(2, 2, 2, 1), forgetting=0.98)
KEPT = math.ceil(MEMORIES / (1.0 - 0.98))


def flown(n: int) -> SampleBlock:
    u, y = simulate(S1, n, 0)
    samples = make_samples(n, 1, np.random.default_rng(0))
    none = np.zeros(n, np.int64)
    return replace(samples, u=u.reshape(-1, 1), y=y, held=none, epoch=none)


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_a_bank_that_forgets_keeps_three_memories_however_the_samples_came(cut: int) -> None:
    samples, bank = flown(1000), Bank(CONFIG, SAMPLE_TIME_S)
    for first in range(0, 1000, cut):
        bank.run(samples.select(np.arange(first, min(first + cut, 1000))))
    history = bank.history()
    newest = slice(1000 - KEPT, None)
    np.testing.assert_array_equal(history.u, samples.u[newest])
    for name in ("y", "roll", "turn_rate", "airspeed"):
        np.testing.assert_array_equal(getattr(history, name), getattr(samples, name)[newest])
    whole = Bank(CONFIG, SAMPLE_TIME_S).run(samples)
    for method, y_hat in history.y_hat.items():
        np.testing.assert_array_equal(y_hat, whole[method].y_hat[newest])
