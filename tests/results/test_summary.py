"""The fit on held-back data: a model is asked about samples it had not seen."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete, lfilter

from yawid.blocks import SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.bank import REMEMBERED, Bank
from yawid.estimation.fit import fit_percent, simulate
from yawid.results.judge_estimate import estimate_reasons
from yawid.results.summary import method_summary

TS = 0.1
KEEPS_ALL = RunConfig(forgetting=1.0)


def flown(n: int, wn: float = 2.4, seed: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Rudder and yaw rate of eq. 23 (zeta 0.25, T 0.8 s) with one percent of noise."""
    b, a, _ = cont2discrete((wn**2 * np.array([0.8, 1.0]), [1.0, 0.5 * wn, wn**2]), TS)
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-0.2, 0.2], n // 5 + 1), 5)[:n]
    y = lfilter(np.ravel(b), a, u)
    return u, y + 0.01 * y.std() * rng.standard_normal(n)


def samples(u: np.ndarray, y: np.ndarray) -> SampleBlock:
    k, zero = np.arange(len(y)), np.zeros(len(y))
    stamp = (k * TS * 1e6).astype(np.int64)
    columns = [k, stamp, 1000 * stamp, stamp, u[:, None], y, *[zero] * 4, *[np.zeros_like(k)] * 3]
    columns += [np.full(len(y), np.nan)] * 4
    return SampleBlock(TS, *columns)


def bank_of(u: np.ndarray, y: np.ndarray, config: RunConfig, cuts: list[int] = ()) -> Bank:
    whole, bank = samples(u, y), Bank(config, TS)
    for first, last in pairwise(sorted({0, *cuts, len(y)})):
        bank.run(whole.select(slice(first, last)))
    return bank


def held_back_pct(bank: Bank, method: str = "els") -> float | None:
    return method_summary(bank, method)[0].fit.simulation_held_back_pct


@pytest.mark.parametrize("method", ["els", "rml"])
def test_it_is_the_model_at_two_thirds_run_free_over_the_rest(method):
    u, y = flown(900)
    y[100:110] = np.nan

    found = held_back_pct(bank_of(u, y, KEEPS_ALL), method)

    split = 10 + int(2 / 3 * 890) // REMEMBERED * REMEMBERED
    split -= split % REMEMBERED
    armax = RecursiveArmax(KEEPS_ALL.estimator(method, TS))
    armax.run(u[:split], y[:split])
    simulated = simulate(armax.theta, armax.config.orders, True, u[split:, None], y[split:])
    assert found == pytest.approx(fit_percent(y[split:], simulated), abs=1e-9)
    assert 90.0 < found < 100.0


def test_what_comes_after_does_not_change_the_model_it_is_tried_on():
    u, y = flown(900)
    other = y.copy()
    other[620:] = np.random.default_rng(7).standard_normal(280)

    one, two = (bank_of(u, values, KEEPS_ALL).earlier(600) for values in (y, other))

    assert one is not None
    assert two is not None
    assert one.first == two.first <= 600
    np.testing.assert_array_equal(one.theta["els"], two.theta["els"])
    assert held_back_pct(bank_of(u, other, KEEPS_ALL)) < 20.0


@given(cuts=st.lists(st.integers(1, 699), max_size=8), memory=st.sampled_from([None, 15.0]))
@settings(max_examples=20, deadline=None)
def test_it_does_not_depend_on_how_the_stream_was_cut(cuts, memory):
    u, y = flown(700)
    config = RunConfig(memory=memory)

    whole, parts = bank_of(u, y, config), bank_of(u, y, config, cuts)

    assert held_back_pct(whole) == held_back_pct(parts)
    assert method_summary(whole, "rml")[1].before == pytest.approx(
        method_summary(parts, "rml")[1].before, abs=0.0
    )


def test_where_there_is_too_little_to_hold_back_there_is_no_such_figure():
    assert held_back_pct(bank_of(*flown(150), KEEPS_ALL)) is None
    assert held_back_pct(bank_of(*flown(300), KEEPS_ALL)) is not None


def test_where_the_rudder_rests_in_the_last_third_there_is_nothing_to_try_the_model_on():
    """The yaw rate there is noise, of which no model tells anything; it was -1000 % and refused."""
    u, y = flown(900)
    u[500:] = 0.0
    y[560:] = 1e-3 * np.random.default_rng(3).standard_normal(340)

    assert held_back_pct(bank_of(u, y, KEEPS_ALL)) is None
    u[850:870] = 0.2
    assert held_back_pct(bank_of(u, y, KEEPS_ALL)) is not None


def test_a_model_that_forgets_is_tried_on_the_last_of_what_it_remembers():
    """Three memories are kept, 600 samples: what lay before the change of plant is forgotten."""
    (u, before), (_, after) = flown(2000, wn=1.5), flown(2000, wn=2.4)
    y = np.concatenate([before[:1000], after[1000:]])

    bank = bank_of(u, y, RunConfig(memory=20.0))

    assert held_back_pct(bank) > 90.0
    earlier = bank.earlier(400)
    assert earlier is not None
    assert 384 < earlier.first <= 400


def test_a_long_session_keeps_no_more_models_than_a_short_one():
    u, y = flown(20_000)
    config = RunConfig(memory=5.0, also="none")
    whole, bank, kept = samples(u, y), Bank(config, TS), []
    for first in range(0, len(y), 10):
        bank.run(whole.select(slice(first, first + 10)))
        kept.append(sum(ring.nbytes for ring in bank._thetas._rings))

    assert max(kept[1000:]) == max(kept[:1000])


def test_an_estimate_that_still_moves_is_not_converged():
    u, y = flown(1200)
    moving = y.copy()
    moving[1000:] = flown(1200, wn=3.4)[1][1000:]

    def reasons(values: np.ndarray) -> set[str]:
        evidence = method_summary(bank_of(u, values, RunConfig()), "els")[1]
        return {reason.id for reason in estimate_reasons("els", evidence)}

    assert "not_converged" not in reasons(y)
    assert "not_converged" in reasons(moving)
