"""What a bank remembers of the samples: the newest, as many as its models know something of."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from estimation.armax_plants import S1, simulate
from hypothesis import given
from hypothesis import strategies as st
from sinks.sink_blocks import SAMPLE_TIME_S, make_samples

from yawid.blocks import EstimateBlock, SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.bank import HISTORY, MEMORIES, Bank

N = 1000
CONFIG = RunConfig(orders=(2, 2, 2, 1), forgetting=0.98)
KEPT = math.ceil(MEMORIES / (1.0 - 0.98))


@cache
def flown() -> tuple[SampleBlock, dict[str, EstimateBlock]]:
    """Samples, and what the methods make of all of them at once."""
    u, y = simulate(S1, N, 0)
    none = np.zeros(N, np.int64)
    samples = make_samples(N, 1, np.random.default_rng(0))
    samples = replace(samples, u=u.reshape(-1, 1), y=y, held=none, epoch=none)
    return samples, Bank(CONFIG, SAMPLE_TIME_S).run(samples)


@given(cuts=st.lists(st.integers(1, N - 1), max_size=30), newest=st.sampled_from([3, 40, HISTORY]))
def test_a_bank_that_forgets_keeps_three_memories_however_the_samples_came(cuts, newest) -> None:
    (samples, whole), bank = flown(), Bank(CONFIG, SAMPLE_TIME_S)
    for first, stop in pairwise(sorted({0, *cuts, N})):
        bank.run(samples.select(np.arange(first, stop)))
    history, rows = bank.history(newest), slice(N - min(newest, KEPT), None)
    for name in ("u", "y", "roll", "turn_rate", "airspeed", "aileron", "mode"):
        np.testing.assert_array_equal(getattr(history, name), getattr(samples, name)[rows])
    for method, y_hat in history.y_hat.items():
        np.testing.assert_array_equal(y_hat, whole[method].y_hat[rows])
